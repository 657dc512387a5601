"""How far a computation is, in a notebook: one line below the cell, which goes when the computation ends."""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

from cutbench.base.progress import Clock, OnProgress, line

Call = TypeVar("Call", bound=Callable[..., Any])

#: Seconds between two looks of the line: more often a browser need not draw it.
EVERY_S = 0.3

_LINE_SHOWN = {"now": False}


def watched(unit: str) -> Callable[[Call], Call]:
    """Decorator of a function that takes ``on_progress`` by its name, and counts in this ``unit``: called
    without one in a notebook it shows a line."""

    def give(call: Call) -> Call:
        @functools.wraps(call)
        def wrapped(*args: Any, **kwargs: Any) -> Any:
            if "on_progress" in kwargs or _LINE_SHOWN["now"] or not in_notebook():
                return call(*args, **kwargs)
            with _line(call.__name__, unit) as on_progress:
                return call(*args, **kwargs, on_progress=on_progress)

        return cast(Call, wrapped)

    return give


def in_notebook() -> bool:
    """Whether this process is a notebook's kernel."""
    if "IPython" not in sys.modules:
        return False
    shell = sys.modules["IPython"].get_ipython()
    return shell is not None and type(shell).__name__ == "ZMQInteractiveShell"


@contextmanager
def _line(title: str, unit: str) -> Iterator[OnProgress]:
    display = sys.modules["IPython"].display
    handle = display.display(_StatusLine(f"{title} …"), display_id=True)
    clock, drawn = Clock(), 0.0

    def on_progress(done: float, total: float, text: str) -> None:
        nonlocal drawn
        said = line(title, done, total, unit, text, clock.left(done, total, text))
        if time.monotonic() - drawn >= EVERY_S:
            drawn = time.monotonic()
            handle.update(_StatusLine(said))

    _LINE_SHOWN["now"] = True
    try:
        yield on_progress
    finally:
        _LINE_SHOWN["now"] = False
        handle.update(_StatusLine(""))


class _StatusLine(str):
    """A text that notebooks show without quotes."""

    def __repr__(self) -> str:
        return str(self)
