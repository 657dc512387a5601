"""How a sweep shows where it stands: a bar with runs, failures and time left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


@dataclass(frozen=True)
class Status:
    """Where a sweep stands. ``total`` are the runs asked for so far; ``failed`` of the ``finished`` ended
    short of their depth; ``reused`` were in the store; ``seconds_left`` is for those asked for, None
    until a run has shown how long one takes."""

    total: int
    finished: int
    failed: int
    reused: int
    seconds_left: float | None
    picture: Path | None


@contextmanager
def show_progress(console: Console | None = None) -> Iterator[Callable[[Status], None]]:
    """A bar on the terminal (standard error by default); yields what ``run_study`` calls."""
    columns = (
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console or Console(stderr=True)) as bar:
        task = bar.add_task("runs", total=None, note="", left="")

        def tell(status: Status) -> None:
            notes = [f"{status.reused} from the store"] if status.reused else []
            notes += [f"[red]{status.failed} failed[/red]"] if status.failed else []
            left = "" if status.seconds_left is None else f"{_duration(status.seconds_left)} left"
            bar.update(task, completed=status.finished, total=status.total, note=", ".join(notes), left=left)

        yield tell


def _duration(seconds: float) -> str:
    seconds = round(seconds)
    if seconds < 60:
        return f"{seconds} s"
    return (
        f"{seconds // 60} min {seconds % 60:02d} s"
        if seconds < 3600
        else f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"
    )
