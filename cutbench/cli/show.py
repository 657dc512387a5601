"""What is printed: tables, and whatever else rich can render."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

#: A table with a line below its heads and no frame.
PLAIN: dict[str, Any] = {"box": box.SIMPLE_HEAD, "pad_edge": False}


def show(*parts: object) -> None:
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
