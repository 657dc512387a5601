"""What is printed: tables, sentences, and whatever else rich can render; and how much of it."""

from __future__ import annotations

import logging

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from cutbench.base.report import Table

#: How much is printed: 0 what was found, 1 tables and progress, 2 counters and the log, too.
_LOUD = {"level": 1}
#: What stands out.
_STYLES = {"FAILED": "bold red"}


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


def show(*parts: str | Table) -> None:
    """Print sentences and tables, a table with a line below its heads and no frame."""
    if silenced():
        return
    # Away from a terminal nobody can widen the window: do not cut numbers short.
    console = Console(width=None if Console().is_terminal else 160)
    for part in parts:
        console.print(_drawn(part) if isinstance(part, Table) else Text(part))


def _drawn(table: Table) -> RichTable:
    title = Text(table.title) if table.title else None
    drawn = RichTable(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for head in table.heads:
        drawn.add_column(
            Text(head), justify="right" if head in table.right else "left", overflow="fold",
            no_wrap=head in table.whole,
        )  # fmt: skip
    for row in table.rows:
        if row:
            drawn.add_row(*(Text(cell, style=_STYLES.get(cell, "")) for cell in row))
        else:
            drawn.add_section()
    return drawn
