"""The registry: every mechanism file below this folder, found by being there.

Drop a file into the folder of its slot and it takes part in runs, maps, fits and the generic
tests; no list is kept.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from cutbench.mechanisms.base import Blade, Bulk, Cut, Mechanism, Rig, Skin, Support

SLOTS = ("bulk", "cut", "blade", "skin", "support", "rig")


@cache
def registry() -> dict[str, Mechanism]:
    """All mechanisms by name, in the order of slots and, within a slot, of rank and name."""
    found: dict[str, Mechanism] = {}
    for slot in SLOTS:
        package = importlib.import_module(f"{__name__}.{slot}")
        here: list[Mechanism] = []
        for info in pkgutil.iter_modules(package.__path__):
            if info.name.startswith("_"):
                continue
            module = importlib.import_module(f"{package.__name__}.{info.name}")
            here += [
                item()
                for item in vars(module).values()
                if isinstance(item, type)
                and issubclass(item, Mechanism)
                and item.__module__ == module.__name__
            ]
        for mechanism in sorted(here, key=lambda m: (m.rank, m.name)):
            found[mechanism.name] = mechanism
    return found


__all__ = ["SLOTS", "Blade", "Bulk", "Cut", "Mechanism", "Rig", "Skin", "Support", "registry"]
