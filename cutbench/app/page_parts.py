"""Parts that all pages of one server share: its folder and jobs, choices, uploads, and what watches a job."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from cutbench.app.campaigns import MAX_FILE_BYTES
from cutbench.app.jobs import RUNNING, Job, Jobs
from cutbench.base.errors import CutbenchError

#: What is done with the names and contents of files.
Take = Callable[[list[tuple[str, bytes]]], None]
#: Seconds between two looks at what a job told.
_POLL_S = 0.4


@dataclass
class Bench:
    """One server's folder, to which everything is written, and its jobs."""

    root: Path
    jobs: Jobs = field(default_factory=Jobs)

    def place(self, kind: str) -> Path:
        """The next folder of this kind that is not there."""
        number = 1
        while (target := self.root / f"{kind}-{number}").exists():
            number += 1
        return target

    def address(self, path: Path) -> str:
        """Where a page finds a file of the folder, as it is now."""
        return f"/files/{quote(path.relative_to(self.root).as_posix())}?{path.stat().st_mtime_ns}"

    def with_file(self, name: str) -> list[str]:
        """Folders down to two levels that have a file ``name``, newest first, as seen from the root."""
        every = [path for depth in ("", "*/", "*/*/") for path in self.root.glob(f"{depth}{name}")]
        inside = [path for path in every if path.resolve().is_relative_to(self.root)]
        inside.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        return [path.parent.relative_to(self.root).as_posix() for path in inside]


@contextmanager
def refusals(alert: ui.label) -> Iterator[None]:
    """Says in ``alert`` why something cannot be done."""
    alert.set_text("")
    try:
        yield
    except CutbenchError as error:
        alert.set_text(str(error))


def alert() -> ui.label:
    """Where refusals are said."""
    return ui.label().classes("alert").props("role=alert")


def choice(options: Any, value: object, label: str, mark: str, **rest: Any) -> ui.select:
    """A select with its label and a mark that tests know it by."""
    select = ui.select(options, value=value, label=label, **rest)
    return select.props(f'outlined dense options-dense data-testid={mark} aria-label="{label}"')


def upload(label: str, accept: str, take: Take, alert: ui.label, drop: bool = False) -> None:
    """A button that chooses files, beside a field to ``drop`` them on or without one; ``take`` has names and
    contents, and what it refuses is said in ``alert``."""

    async def taken(event: events.MultiUploadEventArguments) -> None:
        files = [(file.name, await file.read()) for file in event.files]
        uploads.reset()
        with refusals(alert):
            take(files)

    refused = f"A file is one of {accept}, of {MAX_FILE_BYTES} bytes at the most."
    uploads: ui.upload = ui.upload(
        label="or drop them here", multiple=True, auto_upload=True, max_file_size=MAX_FILE_BYTES,
        on_multi_upload=taken, on_rejected=lambda: alert.set_text(refused),
    )  # fmt: skip
    uploads.props(f"accept={accept} flat bordered").classes("drop" if drop else "hidden")
    choose = f"() => getElement({uploads.id}).pickFiles()"
    ui.button(label).props("outline").on("click", js_handler=choose)


class JobWatch:
    """The part of a page that shows a job: how far it is, how long it takes yet, its answer, its files; and
    the button that stops it."""

    def __init__(self, bench: Bench, kinds: tuple[str, ...], on_change: Callable[[Job], None]):
        self._bench, self._on_change = bench, on_change
        self.job = next((job for job in reversed([*bench.jobs]) if job.kind in kinds), None)
        with ui.column().classes("w-full gap-1") as self._box:
            with ui.row().classes("w-full items-center no-wrap"):
                self._bar = ui.linear_progress(0, show_value=False).props('aria-label="Progress"')
                self._stop = ui.button("Stop", on_click=self._end).props("outline data-testid=stop")
            self._text = ui.label().props("role=status data-testid=job")
            self._said = ui.label().classes("said").props("data-testid=said")
            self._files = ui.row().classes("gap-x-3 gap-y-0").props("data-testid=files")
        self._seen = ""
        self._box.set_visibility(False)
        ui.timer(_POLL_S, self._look, immediate=False)

    def watch(self, job: Job) -> None:
        """Show this job from now on."""
        self.job, self._seen = job, ""
        self._look()

    def _look(self) -> None:
        self._box.set_visibility(self.job is not None)
        if (job := self.job) is None:
            return
        # As text, because a part that is not known is not equal to itself.
        seen = str((job.id, job.state, job.text, job.part, len(job.points), len(job.stages)))
        if seen == self._seen:
            return
        self._seen, going = seen, job.state == RUNNING
        unknown = math.isnan(job.part)
        self._bar.set_value(0.0 if unknown else job.part)
        self._bar.props("indeterminate" if unknown else "", remove="" if unknown else "indeterminate")
        self._bar.set_visibility(going)
        self._stop.set_visibility(going)
        self._text.set_text(f"{job.title}: {job.text or 'beginning' if going else job.state}")
        self._said.set_text(job.fault or job.said)
        self._files.clear()
        if not going:
            with self._files:
                for name in job.files:
                    ui.link(name, self._bench.address(job.folder / name), new_tab=True)
        self._on_change(job)

    def _end(self) -> None:
        if self.job is not None:
            self._bench.jobs.stop(self.job)
            self._look()
