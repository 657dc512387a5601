"""How the command line shows progress: a bar with the time left; without a terminal now and then a line."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from cutbench.base.progress import COMPILING, Clock, OnProgress, Pace, count, line, silent
from cutbench.cli.terminal import silenced

#: Seconds between two lines where there is no terminal.
EVERY_S = 10.0


@contextmanager
def bar(
    title: str, unit: str = "", *, console: Console | None = None, pace: Pace | None = None
) -> Iterator[OnProgress]:
    """Show ``title`` on standard error by default; yields what a computation calls."""
    if silenced():
        yield silent
        return
    console = console or Console(stderr=True)
    clock = Clock(pace)
    if not console.is_terminal:
        yield _lines(title, unit, console, clock)
        return
    columns = (
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[count]}  {task.fields[note]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console) as shown:
        task = shown.add_task(escape(title), total=None, count="", note="", left="")

        def on_progress(done: float, total: float, text: str) -> None:
            left = clock.left(done, total, text)
            shown.update(
                task, completed=done, total=total if math.isfinite(total) else None,
                count=count(done, total, unit), note=escape(text), left=left and f"{left} left",
            )  # fmt: skip

        yield on_progress


def _lines(title: str, unit: str, console: Console, clock: Clock) -> OnProgress:
    due = time.monotonic() + EVERY_S

    def on_progress(done: float, total: float, text: str) -> None:
        nonlocal due
        left = clock.left(done, total, text)
        if time.monotonic() >= due or done >= total or text == COMPILING:
            due = time.monotonic() + EVERY_S
            said = line(title, done, total, unit, text, left)
            console.print(said, markup=False, highlight=False)

    return on_progress
