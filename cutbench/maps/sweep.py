"""Compute a study's runs over the cores, and keep its map and picture up to date on the way.

What is to be run a plan says: all at once, or round by round where a boundary is sought. Every run
goes into the store as soon as it has ended, written by the process that computed it. So nothing is
lost when a sweep is interrupted, killed, or loses a worker to the operating system, and starting it
again computes only what is missing.
"""

from __future__ import annotations

import os
import time
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.files import check_writable, folder_lock, write_text
from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, silent
from cutbench.case.case import Case
from cutbench.maps.atlas_map import expected_drops, under_way
from cutbench.maps.closed_form_estimates import compare
from cutbench.maps.collapse import save_collapse
from cutbench.maps.dataset import MapRow, build_map, path_from, row_of, save_map
from cutbench.maps.findings import FILE, Findings, boundary_sentences, findings, summary_text
from cutbench.maps.page import page
from cutbench.maps.phase import save_phase
from cutbench.maps.sampling_plan import plan_of
from cutbench.maps.study import Study, load_study
from cutbench.run.pool.pool import Done, Job, TaskPool
from cutbench.run.pool.worker import PoolLost, Run, WorkerLost, failure, work
from cutbench.run.store.runs import Store

#: Part of the time that may go into writing the map while runs are computed, and how long it is at least, s,
#: until its table is written again: who kills a sweep finds all but the last seconds in it.
MAX_DRAWING_FRACTION, TABLE_EVERY_S = 0.03, 2.0


@dataclass(frozen=True)
class Status:
    """Where a sweep stands. ``total`` are the runs asked for so far; ``failed`` of the ``finished`` ended
    short of their depth; ``reused`` were in the store."""

    total: int
    finished: int
    failed: int
    reused: int


@dataclass(frozen=True)
class Sweep:
    """A sweep is what running a study has left: its ``map`` as in ``map.nc``, its folder ``out``, and how it
    ended.

    ``verdict`` is what a search for the boundary came to, empty where there was none."""

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

    @property
    def findings(self) -> Findings:
        """The counts of regimes and of what fell short."""
        return findings(self.map)

    def words(self) -> list[str]:
        """What there is to say of the map: its findings, the boundary that was sought, the classical
        estimates; a line each."""
        lines = []
        here = self.status.finished - self.status.reused
        if here and self.busy:
            processes = "a worker" if self.workers == 1 else f"{self.workers} workers"
            lines.append(
                f"{60 * here / self.seconds:.3g} runs a minute; {100 * self.busy:.0f} % of the time of"
                f" {processes} was spent in them"
            )
        lines += self.findings.lines()
        if not self.interrupted:
            lines += boundary_sentences(self.map)
        return [*lines, self.verdict] if self.verdict else lines


@watched("runs")
def run_study(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    on_progress: OnProgress = silent,
    run: Run | None = None,
    store: str | os.PathLike[str] | None = None,
    also: Sequence[str | os.PathLike[str]] = (),
    retry_failed: bool = False,
    scheduler: str | None = None,
    first_picture_s: float = 15.0,
    picture_every_s: float = 60.0,
    pictures: bool = True,
) -> Sweep:
    """Compute the cuts of a study that are missing, and write its map and pictures.

    It writes ``map.nc``, ``map.csv`` and ``summary.txt`` every few seconds, ``phase.png``, ``phase.svg`` and
    ``map.html`` from time to time, and all at the end. Where the atlas says
    something of the study, pictures and page show that until there are runs, and say so; ``map.nc`` and
    ``map.csv`` have runs alone.
    Ctrl-C ends the sweep with what is done: the returned ``Sweep`` says ``interrupted``.

    Parameters
    ----------
    study : Study, str or path
        The study, or its TOML file.
    out : str or path
        The folder of the map.
    workers : int, optional
        Processes that compute; one a core unless given, 0: this one.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with numbers of the runs asked for so far.
    run : callable, optional
        Replaces ``cutbench.run.runner.run_case``. Other processes must be able to import it.
    store : str or path, optional
        Folder that keeps the runs; ``out/runs`` unless given.
    also : sequence of str or path
        Other such folders, as of sweeps elsewhere, out of which runs are taken over.
    retry_failed : bool
        Whether runs that fell short are repeated.
    scheduler : str, optional
        Address of a Dask scheduler whose workers compute, or ``"local"``.
    first_picture_s : float, s
        When files are first written.
    picture_every_s : float, s
        How long it is from then to the next time.
    pictures : bool
        Whether there are pictures besides those of the page.

    Returns
    -------
    Sweep
        The map, and how the sweep ended.

    Raises
    ------
    BadInput
        For a study that cannot be read or a folder that cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, cutbench
    >>> text = '''
    ... base = "gelatin"
    ... mechanisms = ["neo_hookean", "volumetric", "contact"]
    ... protocol = { depth = "0.1 mm" }
    ... numerics = { h = "0.8 mm", element = "P1" }  # too coarse for use
    ... axis = [{ name = "G", values = ["5 kPa", "10 kPa"] }]
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "study.toml")
    ...     _ = file.write_text(text)
    ...     sweep = cutbench.run_study(file, folder + "/map", workers=0, pictures=False)
    >>> sweep.complete, sweep.findings.labels
    (True, {'uncut': 2})
    """
    study = study if isinstance(study, Study) else load_study(Path(study))
    out = check_writable(Path(out))
    sweep = _Sweep(study, out, Store(store or out / "runs"), run, on_progress, retry_failed)
    sweep.pace, sweep.pictures = (first_picture_s, picture_every_s), pictures
    for folder in map(Path, also):
        if not folder.is_dir():
            raise BadInput(
                "--also", str(folder), "a folder where a sweep keeps its runs, such as maps/a/runs"
            )
        sweep.others.append(Store(folder))
    with folder_lock(sweep.store.root, key="--store" if store else "--out"):
        return sweep.go(TaskPool(workers, scheduler), scheduler in (None, "local"))


class _Sweep:
    """The state of one sweep: what is there, what is missing, when the next picture is due."""

    pace, pictures = (25.0, 60.0), True

    def __init__(
        self,
        study: Study,
        out: Path,
        store: Store,
        run: Run | None,
        on_progress: OnProgress,
        retry_failed: bool,
    ):
        self.study, self.out, self.store, self.run, self.on_progress = study, out, store, run, on_progress
        self.plan = plan_of(study)
        self.others: list[Store] = []
        # Two points of a grid may be the same run (a law that ignores an axis): one id, one run.
        self.cases: dict[str, Case] = {}
        self.rows: dict[str, MapRow] = {}
        self.todo: deque[str] = deque()
        self.reused = 0
        self.replace = retry_failed
        self.open = 0  # runs that are under way
        self.begun = time.monotonic()
        self.verdict = ""
        self.in_runs, self.written = 0.0, 0  # rows in the table
        self.drops: np.ndarray | None = None  # what is expected beforehand

    def go(self, pool: TaskPool, mine: bool) -> Sweep:
        """Compute; ``mine`` says that the pool's processes work for nobody else."""
        self.begun = time.monotonic()
        self.more()
        if self.pictures and not self.rows:
            self.drops = expected_drops(self.study)
            if self.drops is not None or self.plan.informed:
                self._write_map()  # before the first run: an estimate
        self.due, self.table_due = time.monotonic() + self.pace[0], time.monotonic()
        interrupted = False
        with pool:
            try:
                for done in pool.run(self._jobs(), self.tick):
                    self.take(done)
            except KeyboardInterrupt:
                interrupted = True
                for id in [id for id in self.cases if id not in self.rows and id in self.store]:
                    self.ended(id)  # a worker was done before its sweep heard of it
            except PoolLost as error:
                raise ComputationFailed(
                    f"{error}; what has ended is kept in {self.store.root}: start the same command again to"
                    " go on"
                ) from error
            except OSError as error:  # a full disk, most likely: what is in the store stays
                raise ComputationFailed(f"a run could not be kept in {self.store.root}: {error}") from error
        wall = time.monotonic() - self.begun
        data = self._write_map(last=not interrupted)
        self._report()
        hands = max(pool.count, 1)
        return Sweep(
            data, self.out, self._status(), interrupted, self.verdict, wall, hands,
            self.in_runs / (hands * wall) if mine else 0.0,
        )  # fmt: skip

    def _jobs(self) -> Iterator[Job | None]:
        """What is to be run now; None where the plan waits for what is under way."""
        root, mark = self.store.root.resolve(), self.store.mark()
        while self.more() or self.open:
            if not self.todo:
                yield None
            while self.todo:
                id = self.todo.popleft()
                self.open += 1
                yield Job(id, work, (self.run, self.cases[id], root, mark, self.replace))

    def take(self, done: Done) -> None:
        """Take in what a worker is done with. Raises KeyboardInterrupt for a run that was stopped here."""
        self.open -= 1
        id = done.key
        if isinstance(done.error, WorkerLost):
            # Not kept: what killed it says nothing of the case.
            message = f"{done.error}; the next sweep tries it again"
            self.rows[id] = row_of(failure(self.cases[id], message), self.study.regime)
            self._report()
            return
        if (result := done.result()) is not None:
            self.store.put(result, replace=self.replace)
        self.ended(id)

    def more(self) -> bool:
        """Ask the plan for runs until there are some to compute; False when it has none, or none yet."""
        while not self.todo:
            wanted = self.plan.ask(self.rows)
            if not wanted and not self.open:
                wanted = self.plan.repeats(self.rows)
            asked = {case.id: case for case in wanted}
            if not asked:
                return False
            new = {id: case for id, case in asked.items() if id not in self.cases}
            self.cases |= new
            for id in new:
                result = self.store.get(id)
                elsewhere = (other.get(id) for other in self.others)
                if result is None and (result := next(filter(None, elsewhere), None)):
                    self.store.put(result)
                if result is not None and not (self.replace and not result.outcome.done):
                    self.rows[id] = row_of(result, self.study.regime)
                    self.reused += 1
                else:
                    self.todo.append(id)
            self._report()
        return True

    def ended(self, id: str) -> None:
        """Take a run that is in the store into the map."""
        result = self.store.get(id)
        if result is None:
            raise KeyboardInterrupt  # not kept: the run was interrupted
        self.rows[id] = row_of(result, self.study.regime)
        self.in_runs += result.timings.get("total", 0.0)
        self._report()

    def tick(self) -> None:
        """Write the map if it is time, or its table."""
        begun = time.monotonic()
        drawn, newer = begun >= self.due, len(self.rows) > self.written
        if not (drawn or (newer and begun >= self.table_due)):
            return
        self._write_map(drawn=drawn)
        # The workers wait meanwhile: a large map is written less often.
        now = time.monotonic()
        rest = (now - begun) / MAX_DRAWING_FRACTION
        self.table_due = now + max(TABLE_EVERY_S, rest)
        if drawn:
            self.due = now + max(self.pace[1], rest)
        self._report()

    def _write_map(self, *, last: bool = False, drawn: bool = True) -> xr.Dataset:
        plan = self.plan
        data = build_map(
            self.study, self.rows, plan.ids, plan.estimates(self.rows), plan.rest, plan.checks
        )  # fmt: skip
        data.attrs["store"] = path_from(self.store.root, self.out)
        try:
            save_map(data, self.out)
            self.written = len(self.rows)
            drawn_map = data if last else under_way(data, self.drops)
            if drawn and self.pictures:
                save_phase(drawn_map, self.out)
            if last and self.pictures:
                words = compare(data).text(), save_collapse(data, self.out)[1]
                self.verdict = " ".join(filter(None, words))
            if last or (drawn and self.pictures):
                write_text(page(drawn_map, self.store), self.out / "map.html")
            write_text(summary_text(data, [*filter(None, [self.verdict])]), self.out / FILE)
        except OSError as error:
            if last:
                raise
            # Someone may have the picture open, or taken the folder away: the runs are what counts.
            warnings.warn(f"the map could not be written: {error}", stacklevel=2)
        return data

    def _status(self) -> Status:
        failed = sum(row.outcome != "done" for row in self.rows.values())
        return Status(len(self.cases), len(self.rows), failed, self.reused)

    def _report(self) -> None:
        status = self._status()
        notes = (status.reused, "from the store"), (status.failed, "failed")
        text = ", ".join(f"{count} {what}" for count, what in notes if count)
        self.on_progress(status.finished, status.total, text)
