"""Compute a study's runs over the cores, and keep its map and picture up to date on the way.

What is to be run a plan says: all at once, or round by round where a boundary is sought. Every run
goes into the store as soon as it has ended, written by the process that computed it. So nothing is
lost when a sweep is interrupted, killed, or loses a worker to the operating system, and starting it
again computes only what is missing.
"""

from __future__ import annotations

import multiprocessing
import os
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.threads import one_thread_each
from cutbench.case.case import Case
from cutbench.cli.progress import Status, show_progress
from cutbench.maps.dataset import MapRow, build_map, path_from, row_of, save_map
from cutbench.maps.estimates import save_estimates
from cutbench.maps.page import save_page
from cutbench.maps.phase import save_phase
from cutbench.maps.plan import plan_of
from cutbench.maps.study import Study, load_study
from cutbench.run.pool.worker import Run, begin_worker, failure, work
from cutbench.run.store.runs import Store

#: A run that loses its worker this often with no other run beside it is left alone, until a later sweep.
LOSSES = 3
#: Part of the time that may go into writing the map while runs are computed.
DRAWING = 0.03


@dataclass(frozen=True)
class Sweep:
    """What a sweep leaves: the map, where it is, and whether it is whole."""

    map: xr.Dataset
    out: Path
    status: Status
    interrupted: bool
    verdict: str = ""
    seconds: float = 0.0  # wall time
    workers: int = 0
    busy: float = 0.0  # part of the workers' time that was spent in runs

    @property
    def complete(self) -> bool:
        """Whether every point has ended, well or not."""
        return not self.interrupted and self.status.finished == self.status.total

    def words(self) -> list[str]:
        """What there is to say of the map: the boundary that was sought, and the classical estimates."""
        found = []
        here = self.status.finished - self.status.reused
        if here and self.busy:
            found.append(
                f"{60 * here / self.seconds:.3g} runs a minute; {100 * self.busy:.0f} % of {self.workers}"
                " workers' time was spent in them"
            )
        if "margin" in self.map and not self.interrupted:
            unsure = float(self.map["unsure"].mean())
            sides = (self.map["margin"] >= 0).values
            if sides.all() or not sides.any():
                found.append("no boundary: one regime on the whole map")
            elif unsure:
                found.append(
                    f"boundary: not known to the tolerance (95 %) on {100 * unsure:.2g} % of the map"
                )
            else:
                found.append("boundary: known to the tolerance everywhere (95 %)")
        return [*found, self.verdict] if self.verdict else found


def run_study(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    progress: bool | Callable[[Status], None] | None = None,
    run: Run | None = None,
    store: str | os.PathLike[str] | None = None,
    retry_failed: bool = False,
    scheduler: str | None = None,
    first_picture_s: float = 25.0,
    picture_every_s: float = 60.0,
) -> Sweep:
    """Run what is missing of ``study`` on ``workers`` processes (default: one a core; 0: in this one).

    Writes ``map.nc``, ``map.csv``, ``phase.png`` and ``phase.svg`` into ``out`` (and ``boundary.csv``
    where one is sought), first after ``first_picture_s``, then every ``picture_every_s`` and at the
    end, then also ``map.html`` and ``estimates.png``; runs go into ``store`` (default ``out/runs``).
    ``scheduler`` is the address of a Dask scheduler whose workers compute, or ``"local"``.
    ``progress=True`` shows a bar, a callable is told each ``Status``. Runs that fell short are not
    repeated unless ``retry_failed``. Ctrl-C ends the sweep with what is done: the returned ``Sweep``
    says ``interrupted``.

    ``run`` (a function that other processes can import) replaces ``cutbench.run.runner.run_case``.
    Raises BadInput for a study that cannot be read or a folder that cannot be written.
    """
    study = study if isinstance(study, Study) else load_study(Path(study))
    if scheduler is not None:
        from cutbench.run.pool.cluster import check_scheduler

        check_scheduler(scheduler)
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
        return sweep.go(_cores() if workers is None else workers, scheduler)


class _Sweep:
    """The state of one sweep: what is there, what is missing, when the next picture is due."""

    pace = (25.0, 60.0)

    def __init__(self, study: Study, out: Path, store: Store, run: Run | None, tell, retry_failed: bool):
        self.study, self.out, self.store, self.run, self.tell = study, out, store, run, tell
        self.plan = plan_of(study)
        # Two points of a grid may be the same run (a law that ignores an axis): one id, one run.
        self.cases: dict[str, Case] = {}
        self.rows: dict[str, MapRow] = {}
        self.todo: deque[str] = deque()
        self.reused = 0
        self.replace = retry_failed
        self.suspects: deque[str] = deque()
        self.lost: Counter[str] = Counter()
        self.begun = time.monotonic()
        self.picture: Path | None = None
        self.verdict = ""
        self.in_runs = 0.0

    def go(self, workers: int, scheduler: str | None = None) -> Sweep:
        self.begun = time.monotonic()
        self.due = self.begun + self.pace[0]
        interrupted = False
        try:
            if not self.more():
                pass
            elif scheduler is not None:
                from cutbench.run.pool.cluster import run_on_cluster

                run_on_cluster(self, scheduler, workers)
            elif workers == 0:
                self._run_here()
            else:
                with one_thread_each():
                    self._run_in_pool(workers)
        except KeyboardInterrupt:
            interrupted = True
            for id in [id for id in self.cases if id not in self.rows and self.store.has(id)]:
                self.ended(id)  # a worker was done before its sweep heard of it
        except OSError as error:  # a full disk, most likely: what is in the store stays
            raise ComputationFailed(f"a run could not be kept in {self.store.root}: {error}") from error
        wall = time.monotonic() - self.begun
        data = self._write_map(last=not interrupted)
        self._report()
        hands = max(workers, 1)
        return Sweep(
            data, self.out, self._status(), interrupted, self.verdict, wall, hands,
            self.in_runs / (hands * wall) if scheduler in (None, "local") else 0.0,
        )  # fmt: skip

    def more(self) -> bool:
        """Ask the plan for runs until there are some to compute; False when it has none left."""
        while not self.todo:
            asked = {case.id: case for case in self.plan.ask(self.rows)}
            if not asked:
                return False
            new = {id: case for id, case in asked.items() if id not in self.cases}
            self.cases |= new
            for id in new:
                result = self.store.get(id)
                if result is not None and not (self.replace and not result.outcome.done):
                    self.rows[id] = row_of(result, self.study.regime)
                    self.reused += 1
                else:
                    self.todo.append(id)
            self._report()
        return True

    def _run_here(self) -> None:
        while self.todo or self.more():
            id = self.todo.popleft()
            work(self.run, self.cases[id], self.store.root, self.replace)
            self.ended(id)
            self.tick()

    def _run_in_pool(self, workers: int) -> None:
        context = multiprocessing.get_context("spawn")  # forking a process with BLAS threads can hang
        while self.todo or self.suspects or self.more():
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
            while self.todo or self.suspects or flying or self.more():
                # One in hand beyond the workers, so that none waits for the next picture to be drawn.
                # Suspects go alone: if the pool breaks again, it is clear on which run.
                while self.todo and not self.suspects and len(flying) <= workers:
                    self._submit(pool, self.todo, flying)
                if self.suspects and not flying:
                    self._submit(pool, self.suspects, flying)
                done, _ = wait(flying, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                    self.ended(flying.pop(future))
                self.tick()
        except BrokenProcessPool:
            for id in flying.values():
                if self.store.has(id):  # the worker died after its work was done
                    self.ended(id)
                else:
                    self._lose(id, alone=len(flying) == 1)

    def _submit(self, pool: ProcessPoolExecutor, queue: deque[str], flying: dict[Future, str]) -> None:
        future = pool.submit(work, self.run, self.cases[queue[0]], self.store.root, self.replace)
        flying[future] = queue.popleft()

    def _lose(self, id: str, *, alone: bool) -> None:
        """What died in company may have died of the company."""
        self.lost[id] += alone
        if self.lost[id] < LOSSES:
            self.suspects.append(id)
            return
        self.given_up(
            id,
            f"its process died {LOSSES} times (out of memory, or killed; in a script, call sweeps under "
            "if __name__ == '__main__'); the next sweep tries it again",
        )

    def given_up(self, id: str, message: str) -> None:
        """A run that never came back. It is not kept: what killed it says nothing of the case."""
        self.rows[id] = row_of(failure(self.cases[id], message), self.study.regime)
        self._report()

    def ended(self, id: str) -> None:
        """Take a run that is in the store into the map."""
        result = self.store.get(id)
        if result is None:
            # Not kept: the run was interrupted, or the store has been tampered with meanwhile.
            self.rows[id] = MapRow("interrupted", "the run was interrupted")
        else:
            self.rows[id] = row_of(result, self.study.regime)
            self.in_runs += result.timings.get("total", 0.0)
        self._report()

    def tick(self) -> None:
        """Write the map if it is time."""
        if time.monotonic() >= self.due:
            begun = time.monotonic()
            self._write_map()
            # The workers wait meanwhile: a large map is written less often.
            now = time.monotonic()
            self.due = now + max(self.pace[1], (now - begun) / DRAWING)
            self._report()

    def _write_map(self, *, last: bool = False) -> xr.Dataset:
        data = build_map(self.study, self.rows, self.plan.ids, self.plan.estimates(self.rows))
        data.attrs["store"] = path_from(self.store.root, self.out)
        try:
            save_map(data, self.out)
            self.picture = save_phase(data, self.out)[0]
            if last:
                self.verdict = save_estimates(data, self.out)[1]
                save_page(data, self.store, self.out)
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
