"""How the command line shows progress: a bar with the time left; without a terminal now and then a line."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from cutbench.base.progress import OnProgress, silent
from cutbench.cli.show import silenced

#: Seconds between two lines where there is no terminal.
EVERY_S = 10.0


@contextmanager
def bar(title: str, unit: str = "", *, console: Console | None = None) -> Iterator[OnProgress]:
    """Show ``title`` on standard error by default; yields what a computation calls."""
    if silenced():
        yield silent
        return
    console = console or Console(stderr=True)
    clock = _Clock()
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
            left = clock.left(done, total)
            shown.update(
                task, completed=done, total=total if math.isfinite(total) else None,
                count=_count(done, total, unit), note=escape(text), left=left and f"{left} left",
            )  # fmt: skip

        yield on_progress


class _Clock:
    """The time left, by what was done since the first call: what was there before took no time."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def left(self, done: float, total: float) -> str:
        now = time.monotonic()
        since, before = self._first = self._first or (now, done)
        if not math.isfinite(total) or done <= before:
            return ""
        return duration((now - since) / (done - before) * max(total - done, 0.0))


def _lines(title: str, unit: str, console: Console, clock: _Clock) -> OnProgress:
    due = time.monotonic() + EVERY_S

    def on_progress(done: float, total: float, text: str) -> None:
        nonlocal due
        left = clock.left(done, total)
        if time.monotonic() >= due or done >= total:
            due = time.monotonic() + EVERY_S
            parts = [_count(done, total, unit), text, left and f"{left} left"]
            console.print(f"{title}: {', '.join(filter(None, parts))}", markup=False, highlight=False)

    return on_progress


def _count(done: float, total: float, unit: str) -> str:
    if not math.isfinite(total):
        return ""
    number = f"{done:g}" if done == int(done) else f"{done:.2f}"
    return f"{number} of {round(total, 2):g} {unit}".rstrip()


def duration(seconds: float) -> str:
    """As a person says it."""
    seconds = round(seconds)
    if seconds < 60:
        return f"{seconds} s"
    if seconds < 3600:
        return f"{seconds // 60} min {seconds % 60:02d} s"
    return f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"
