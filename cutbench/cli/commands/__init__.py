"""The commands, one a file, found by being there: a module's function of the module's own name."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator

#: In this order they stand in ``cutbench --help``; others follow by name.
FIRST = ("run2d", "run3d", "sweep", "plot", "materials", "mechanisms")


def commands() -> Iterator[Callable]:
    """The function of each command."""
    names = [info.name for info in pkgutil.iter_modules(__path__) if not info.name.startswith("_")]
    for name in sorted(names, key=lambda n: (FIRST.index(n) if n in FIRST else len(FIRST), n)):
        yield getattr(importlib.import_module(f"{__name__}.{name}"), name)
