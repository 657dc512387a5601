"""What is printed: tables, and whatever else rich can render."""

from __future__ import annotations

import logging
from collections.abc import Container, Iterable, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

#: A table with a line below its heads and no frame.
PLAIN: dict[str, Any] = {"box": box.SIMPLE_HEAD, "pad_edge": False}


#: How much is printed: 0 what was found, 1 tables and progress, 2 counters and the log, too.
_LOUD = {"level": 1}


def loudness(quiet: bool, loud: bool) -> None:
    """What ``-q`` and ``-v`` ask for, until it is said anew."""
    _LOUD["level"] = 0 if quiet else 2 if loud else 1
    logging.getLogger("cutbench").setLevel(logging.INFO if loud else logging.WARNING)
    if loud:
        logging.basicConfig(format="%(name)s: %(message)s")


def verbose() -> bool:
    return _LOUD["level"] > 1


def silenced() -> bool:
    return _LOUD["level"] < 1


def show(*parts: object) -> None:
    if silenced():
        return
    # Away from a terminal nobody can widen the window: do not cut numbers short.
    console = Console(width=None if Console().is_terminal else 160)
    for part in parts:
        console.print(part)


def table(
    heads: Sequence[str], rows: Iterable[Sequence[str]] = (), *, right: Container[str] = (), **look: Any
) -> Table:
    """``rows`` under ``heads``, those in ``right`` flush right; ``look`` is what rich's table takes."""
    made = Table(**{"title_justify": "left", **look})
    for head in heads:
        made.add_column(Text(head), justify="right" if head in right else "left", overflow="fold")
    for row in rows:
        made.add_row(*map(Text, row))
    return made
