"""Compute a study's runs over the cores, and keep its map and picture up to date on the way.

Every run goes into the store as soon as it has ended, written by the process that computed it. So
nothing is lost when a sweep is interrupted, killed, or loses a worker to the operating system, and
starting it again computes only what is missing.
"""

from __future__ import annotations

import multiprocessing
import os
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import xarray as xr
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from cutbench.errors import BadInput, ComputationFailed
from cutbench.maps import Row, build_map, row_of, save_map
from cutbench.phase import save_phase
from cutbench.store import Store
from cutbench.study import Study, load_study
from cutbench.worker import Run, begin_worker, failure, one_thread_each, work

#: A run that was lost with its worker is done again this often.
RETRIES = 2


@dataclass(frozen=True)
class Status:
    """Where a sweep stands. ``failed`` of the ``finished`` ended short of their depth; ``reused``
    were in the store at the start; ``seconds_left`` is None until a run has shown how long one takes."""

    total: int
    finished: int
    failed: int
    reused: int
    seconds_left: float | None
    picture: Path | None


@dataclass(frozen=True)
class Sweep:
    """What a sweep leaves: the map, where it is, and whether it is whole."""

    map: xr.Dataset
    out: Path
    status: Status
    interrupted: bool

    @property
    def complete(self) -> bool:
        """Whether every point has ended, well or not."""
        return self.status.finished == self.status.total


def run_study(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    progress: bool | Callable[[Status], None] | None = None,
    run: Run | None = None,
    store: str | os.PathLike[str] | None = None,
    retry_failed: bool = False,
    first_picture_s: float = 25.0,
    picture_every_s: float = 60.0,
) -> Sweep:
    """Run what is missing of ``study`` on ``workers`` processes (default: one a core; 0: in this one).

    Writes ``map.nc``, ``map.csv``, ``phase.png`` and ``phase.svg`` into ``out``, first after
    ``first_picture_s``, then every ``picture_every_s`` and at the end; runs go into ``store``
    (default ``out/runs``). ``progress=True`` shows a bar, a callable is told each ``Status``.
    Runs that fell short are not repeated unless ``retry_failed``. Ctrl-C ends the sweep with what
    is done: the returned ``Sweep`` says ``interrupted``.

    ``run`` (a function that other processes can import) replaces ``cutbench.run.run_case``.
    Raises BadInput for a study that cannot be read or a folder that cannot be written.
    """
    study = study if isinstance(study, Study) else load_study(study)
    if workers is not None and workers < 0:
        raise BadInput(key="workers", value=workers, expected="a number of processes, 0 or more")
    out = Path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            key="out", value=str(out), expected=f"a folder that can be written ({error.strerror})"
        ) from error
    shown = show_progress() if progress is True else nullcontext(progress or None)
    with shown as tell:
        sweep = _Sweep(study, out, Store(store or out / "runs"), run, tell, retry_failed)
        sweep.pace = (first_picture_s, picture_every_s)
        return sweep.go(_cores() if workers is None else workers)


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


class _Sweep:
    """The state of one sweep: what is there, what is missing, when the next picture is due."""

    pace = (25.0, 60.0)

    def __init__(self, study: Study, out: Path, store: Store, run: Run | None, tell, retry_failed: bool):
        self.study, self.out, self.store, self.run, self.tell = study, out, store, run, tell
        # Two points of a grid may be the same run (a law that ignores an axis): one id, one run.
        self.cases = {case.id: case for case in study.cases()}
        self.rows: dict[str, Row] = {}
        for id in self.cases:
            result = store.get(id)
            if result is not None and not (retry_failed and not result.outcome.done):
                self.rows[id] = row_of(result, study)
        self.replace = retry_failed
        self.todo = deque(id for id in self.cases if id not in self.rows)
        self.suspects: deque[str] = deque()
        self.lost: Counter[str] = Counter()
        self.reused = len(self.rows)
        self.begun = time.monotonic()
        self.picture: Path | None = None

    def go(self, workers: int) -> Sweep:
        self.begun = time.monotonic()
        self.due = self.begun + self.pace[0]
        interrupted = False
        self._report()
        try:
            if workers == 0:
                self._run_here()
            elif self.todo:
                with one_thread_each():
                    self._run_in_pool(workers)
        except KeyboardInterrupt:
            interrupted = True
            for id in [id for id in self.cases if id not in self.rows and self.store.has(id)]:
                self._ended(id)  # a worker was done before its sweep heard of it
        except OSError as error:  # a full disk, most likely: what is in the store stays
            raise ComputationFailed(f"a run could not be kept in {self.store.root}: {error}") from error
        data = self._write_map()
        self._report()
        return Sweep(data, self.out, self._status(), interrupted)

    def _run_here(self) -> None:
        while self.todo:
            id = self.todo.popleft()
            work(self.run, self.cases[id], self.store.root, self.replace)
            self._ended(id)
            self._tick()

    def _run_in_pool(self, workers: int) -> None:
        context = multiprocessing.get_context("spawn")  # forking a process with BLAS threads can hang
        while self.todo or self.suspects:
            # Workers live as long as the other end of this pipe is open. (An Event would be shared
            # state, and a worker that is killed while it waits for one blocks whoever sets it.)
            lifeline, end = context.Pipe(duplex=False)
            pool = ProcessPoolExecutor(workers, context, initializer=begin_worker, initargs=(lifeline,))
            try:
                self._feed(pool, workers)
            finally:
                end.close()  # ends the workers in the middle of a run, should there still be any
                pool.shutdown(wait=True, cancel_futures=True)
                lifeline.close()

    def _feed(self, pool: ProcessPoolExecutor, workers: int) -> None:
        """Keep the pool busy until all is done or it breaks; what was lost with it becomes suspect."""
        flying: dict[Future, str] = {}
        try:
            while self.todo or self.suspects or flying:
                # One in hand beyond the workers, so that none waits for the next picture to be drawn.
                # Suspects go alone: if the pool breaks again, it is clear on which run.
                while self.todo and not self.suspects and len(flying) <= workers:
                    self._submit(pool, self.todo, flying)
                if self.suspects and not flying:
                    self._submit(pool, self.suspects, flying)
                done, _ = wait(flying, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                    self._ended(flying.pop(future))
                self._tick()
        except BrokenProcessPool:
            for id in flying.values():
                if self.store.has(id):  # the worker died after its work was done
                    self._ended(id)
                else:
                    self._lose(id)

    def _submit(self, pool: ProcessPoolExecutor, queue: deque[str], flying: dict[Future, str]) -> None:
        future = pool.submit(work, self.run, self.cases[queue[0]], self.store.root, self.replace)
        flying[future] = queue.popleft()

    def _lose(self, id: str) -> None:
        self.lost[id] += 1
        if self.lost[id] <= RETRIES:
            self.suspects.append(id)
            return
        message = (
            f"its process died {self.lost[id]} times (out of memory, or killed; in a script, call "
            "sweeps under if __name__ == '__main__')"
        )
        self.store.put(failure(self.cases[id], message), replace=True)
        self._ended(id)

    def _ended(self, id: str) -> None:
        result = self.store.get(id)
        if result is None:
            # Not kept: the run was interrupted, or the store has been tampered with meanwhile.
            self.rows[id] = Row("interrupted", "the run was interrupted")
        else:
            self.rows[id] = row_of(result, self.study)
        self._report()

    def _tick(self) -> None:
        if time.monotonic() >= self.due:
            self._write_map()
            self.due = time.monotonic() + self.pace[1]
            self._report()

    def _write_map(self) -> xr.Dataset:
        data = build_map(self.study, self.rows)
        try:
            save_map(data, self.out)
            self.picture = save_phase(data, self.out)[0]
        except OSError as error:
            # Someone may have the picture open, or taken the folder away: the runs are what counts.
            warnings.warn(f"the map could not be written: {error}", stacklevel=2)
        return data

    def _status(self) -> Status:
        finished, total = len(self.rows), len(self.cases)
        here = finished - self.reused
        left = None if here == 0 else (time.monotonic() - self.begun) / here * (total - finished)
        failed = sum(row.outcome != "done" for row in self.rows.values())
        return Status(total, finished, failed, self.reused, left, self.picture)

    def _report(self) -> None:
        if self.tell is not None:
            self.tell(self._status())


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _duration(seconds: float) -> str:
    seconds = round(seconds)
    if seconds < 60:
        return f"{seconds} s"
    return (
        f"{seconds // 60} min {seconds % 60:02d} s"
        if seconds < 3600
        else f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"
    )
