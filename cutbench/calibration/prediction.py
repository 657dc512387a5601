"""What a model says an experiment would read, with its derivatives by parameters.

A cut is a finite-element run differentiated along its way; a homogeneous test is computed without a mesh,
one complex step a parameter. Both give a curve on the grid on which the measurement is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import ALWAYS
from cutbench.calibration.homogeneous import slopes
from cutbench.calibration.kept import Ran, ran
from cutbench.calibration.memory import Memory
from cutbench.calibration.side_by_side import Found, ask, side_by_side
from cutbench.case.case import Case
from cutbench.data.campaign import lead_s
from cutbench.data.experiment import Experiment
from cutbench.data.field_comparison import at_travel, sample, sampled_slopes
from cutbench.data.repetition import Averaged, averaging
from cutbench.mechanisms.base import STEP
from cutbench.run.pool.job import Job
from cutbench.run.pool.pool import TaskPool
from cutbench.run.result import Snapshot
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Added


@dataclass(frozen=True)
class Task:
    """One experiment at one set of parameters: its case, where it is read, by what it is differentiated.

    ``added``: laws that a cut's case lacks, whose strengths its readings are differentiated by, too. A cut
    that takes more than ``longest`` steps falls short."""

    experiment: Experiment
    case: Case
    grid: Averaged
    names: tuple[str, ...] = ()
    added: tuple[Added, ...] = ()
    longest: int | None = None

    @property
    def of_time(self) -> bool:
        """Whether readings have their place in time: those of a cut with holds or returns."""
        return self.experiment.kind == "cut" and not self.experiment.monotone

    @property
    def reading(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (n,) of all readings in mm or s of the run, and the matrix (m, n) to the grid.

        A computed curve goes the same way as the measured ones: an average over readings is not the value
        in their middle where the curve bends.
        """
        if self.of_time:
            lead = lead_s(self.experiment)
            _, along, matrices = self.experiment.averaging(self.grid.x.size)
            return lead + np.concatenate(along), np.hstack(matrices) / len(matrices)
        places, grid = [np.sort(r.x) for r in self.experiment.repetitions], self.grid.x
        parts = [np.eye(x.size) if np.array_equal(x, grid) else averaging(x, grid) for x in places]
        return np.concatenate(places), np.hstack(parts) / len(parts)


@dataclass(frozen=True)
class Prediction:
    """``y`` (m,) on the task's grid, ``slopes`` (m, k) by ``names`` in internal units; nan beyond the place
    where a run's equations were singular.

    ``onset_mm``: where the cut of a run begins (nan without one).
    ``fields`` (f,), ``field_slopes`` (f, k): displacements in mm at all places of the experiment's fields, as
    ``data.fields.laid_out`` has them; nan outside the body. ``course`` (3, n): displacement, force and
    time of the run itself, as no rig has changed them. ``by_added``: derivatives (m, p) of ``y`` by the
    strengths of each law that the task has ``added``, nan where they are not known.
    """

    y: np.ndarray
    slopes: np.ndarray
    names: tuple[str, ...] = ()
    onset_mm: float = float("nan")
    fields: np.ndarray = field(default_factory=lambda: np.zeros(0))
    field_slopes: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    course: np.ndarray = field(default_factory=lambda: np.zeros((3, 0)))
    by_added: tuple[np.ndarray, ...] = ()

    def by(self, names: Sequence[str]) -> np.ndarray:
        """Derivatives (m, p) by ``names``, 0 where they are not known."""
        return np.nan_to_num(self.slopes[:, [self.names.index(name) for name in names]], posinf=0, neginf=0)


def predict(task: Task, kept: Path | None = None, runs: Callable[..., Ran] = ran) -> Prediction:
    """``kept``: folder of the runs that were computed before; ``runs`` computes a cut as ``ran`` does. Raises
    ComputationFailed for a run that ends short of the readings, or cannot begin."""
    try:
        return _cut(task, kept, runs) if task.experiment.kind == "cut" else _homogeneous(task)
    except BadInput as error:
        # Also because it comes from another process, which hands on nothing but a message.
        raise ComputationFailed(f"'{task.experiment.id}': {error}") from error


def _cut(task: Task, kept: Path | None, runs: Callable[..., Ran]) -> Prediction:
    case, names = task.case, task.names
    rig = {q.name for law in case.model.laws("rig") for q in law.parameters}
    # One step before each field too: between the two the displacements are interpolated.
    pictured = [f.travel_mm for f in task.experiment.fields]
    wanted_mm = sorted({max(mm - back, 0.0) for mm in pictured for back in (case.numerics.step_mm, 0.0)})
    meshed = [name for name in names if name not in rig]
    pictures: Sequence[Snapshot] = ()
    if wanted_mm:  # pictures are not kept
        result = run_case(case, sensitivities=meshed, snapshots_mm=wanted_mm, added=task.added)
        run, pictures = Ran.of(result), result.snapshots
    else:
        run = runs(case, meshed, task.added, kept, task.longest)
    reached, wanted = run.outcome.reached_mm, float(task.grid.x[-1])
    if run.outcome.kind == "interrupted":
        raise KeyboardInterrupt
    if not run.outcome.done and (task.of_time or reached < wanted - 1e-6):
        raise ComputationFailed(f"'{task.experiment.id}': {run.outcome}")
    reading = Reading(task, run.course)
    by_added = [
        np.stack([reading.of(case.p, v).imag / STEP for v in each.values()], 1) for each in run.by_added
    ]
    y, by_name = reading.by(vars(case.p), run.slopes)
    if names and not np.isfinite(by_name).any():
        raise ComputationFailed(
            f"'{task.experiment.id}': the equations are singular before the first reading"
        )
    u, u_by_name = _fields(task, pictures, rig)
    return Prediction(y, by_name, names, run.onset_mm, u, u_by_name, run.course, tuple(by_added))


class Reading:
    """What a task's rig reads of a run's ``course`` (3, n): travel, force, time."""

    def __init__(self, task: Task, course: np.ndarray, places: tuple[np.ndarray, np.ndarray] | None = None):
        self.task, self.course, self.places = task, course, places or task.reading

    def of(self, p, slope: np.ndarray) -> np.ndarray:
        """The readings with a complex step in one parameter, of which ``p`` has one and the force a slope."""
        moved = self.course.astype(complex)
        moved[1] += 1j * STEP * np.where(np.isfinite(slope), slope, 0.0)
        values = _shown(self.task, self.places, moved, p)
        values.imag[self._beyond(slope)] = np.nan
        return values

    @property
    def _along(self) -> np.ndarray:
        return self.course[2 if self.task.of_time else 0]

    def _beyond(self, slope: np.ndarray) -> np.ndarray:
        """Which readings (m,) know of more of the course than its ``slope`` does."""
        if (known := np.isfinite(slope)).all():
            return np.full(len(self.places[1]), False)
        last = self._along[max(int(known.argmin()) - 1, 0)]
        return np.abs(self.places[1]) @ (self.places[0] > last) > 0

    def by(
        self, values: Mapping[str, float], slopes: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Readings (m,) with ``values``, and their derivatives (m, k) by the task's names, with ``slopes``
        (n,) of the force by those that the run depends on."""
        if not self.task.case.model.laws("rig"):
            return self._straight(slopes)
        still = np.zeros(self.course.shape[1])
        columns = [self.of(SimpleNamespace(**values), still)]
        for name in self.task.names:
            p = SimpleNamespace(**{**values, name: values[name] + 1j * STEP})
            columns.append(self.of(p, slopes.get(name, still)))
        read = np.stack(columns, axis=1)
        return read[:, 0].real, read[:, 1:].imag / STEP

    def _straight(self, slopes: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """The same where no rig is in the way: readings are linear in the force."""
        x, none = self._along, np.zeros(self.course.shape[1])
        by = [slopes.get(name, none) for name in self.task.names]
        columns = np.stack([self.course[1], *(np.where(np.isfinite(c), c, 0.0) for c in by)], axis=1)
        if not self.task.of_time:
            on = x > np.append(-np.inf, np.maximum.accumulate(x)[:-1])
            x, columns = x[on], columns[on]
        places, average = self.places
        read = _read(places, x, columns)
        # The curve is the same to the last digit, whatever it is differentiated by.
        y, found = average @ np.ascontiguousarray(read[:, 0]), average @ read[:, 1:]
        for k, slope in enumerate(by):
            found[self._beyond(slope), k] = np.nan
        return y, found


def recorded(task: Task, prediction: Prediction, **values: float) -> np.ndarray:
    """What a cut would read (m,) with other ``values`` of its rig's parameters (internal units)."""
    p = task.case.p
    vars(p).update(values)
    return _shown(task, task.reading, prediction.course.astype(complex), p).real


def _shown(task: Task, reading: tuple[np.ndarray, np.ndarray], course: np.ndarray, p) -> np.ndarray:
    """The readings (m,) of a run's ``course`` (3, n), complex, through the rig with parameters ``p``."""
    model, (places, average) = task.case.model, reading
    if task.of_time:  # at the same time the blade is elsewhere only where a rig says so
        read = _read(places, course[2], model.record(course[0], course[1], course[2], p)[1])
    else:
        x, force, _ = model.shown(course, p)
        read = _read(places, x, force)
    # A real matrix times a complex vector would be a thousand times as slow.
    return average @ read.real + 1j * (average @ read.imag)


def _fields(task: Task, pictures: Sequence[Snapshot], rig: set[str]) -> tuple[np.ndarray, np.ndarray]:
    """Displacements at the places of the measured ones (f,), and their derivatives (f, k).

    What a rig does to the record of the force it does not do to a picture of the specimen.
    """
    seen = [i for i, name in enumerate(task.names) if name not in rig]
    size = sum(measured.u.size for measured in task.experiment.fields)
    values, slopes, first = np.full(size, np.nan), np.zeros((size, len(task.names))), 0
    for measured in task.experiment.fields:
        mine = slice(first, first := first + measured.u.size)
        if (picture := at_travel(pictures, measured.travel_mm)) is not None:
            values[mine] = sample(picture, measured).u.ravel()
            found = sampled_slopes(picture, measured, [task.names[i] for i in seen])
            slopes[mine, seen] = found.reshape(measured.u.size, -1)
    return values, slopes


def _read(at: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The polygon through points x (n,), y (n, …) at real places, with its complex step if these are complex;
    ends go on level."""
    i = np.clip(np.searchsorted(x.real, at, side="right") - 1, 0, x.size - 2)
    inside = np.clip(at, x[0].real, x[-1].real)
    part = (inside - x[i]) / (x[i + 1] - x[i])
    return y[i] + part.reshape(-1, *(1,) * (y.ndim - 1)) * (y[i + 1] - y[i])


def _key(task: Task) -> tuple:
    """What tasks have in common that are the same, as long as one of them is there."""
    case, of = task.case, (id(task.experiment), id(task.grid), tuple(map(id, task.added)))
    values = case.mechanisms, tuple(case.values.items()), case.numerics, case.motion, case.outline, case.until
    return *of, values, task.names, task.longest


def _homogeneous(task: Task) -> Prediction:
    y, by_name = slopes(task.experiment, task.case.model, task.case.p, task.names, task.grid)
    return Prediction(y, by_name, task.names)


class Predictor:
    """Predictions of several tasks at once, the runs on a pool's processes; they stay in its ``memory``, and
    in the folder ``kept``. ``check`` is called now and then, and may raise KeyboardInterrupt. ``runs``
    computes a cut as ``ran`` does."""

    def __init__(
        self,
        pool: TaskPool,
        kept: str | Path | None = None,
        check: Callable[[], None] = ALWAYS,
        runs: Callable[..., Ran] = ran,
    ):
        self._pool, self.memory, self._check, self._runs = pool, Memory(), check, runs
        self._kept = None if kept is None else Path(kept)
        self._known: dict[tuple, tuple[Task, Prediction]] = {}

    def __call__(self, tasks: Sequence[Task]) -> list[Prediction]:
        """In the order of ``tasks``. Raises ComputationFailed if one falls short."""
        found = []
        for each in self.each(tasks):
            if isinstance(each, ComputationFailed):
                raise each
            found.append(each)
        return found

    def each(self, tasks: Sequence[Task]) -> list[Prediction | ComputationFailed]:
        """In the order of ``tasks``, with what was raised in place of what falls short; those of searches
        ``side_by_side`` with others', at once."""
        found = ask(tasks)
        return self._computed(tasks) if found is None else found

    def side_by_side(
        self, searches: Sequence[Callable[[], Found]]
    ) -> list[Found | ComputationFailed | BadInput]:
        """What each of ``searches`` finds, or why it finds nothing. Raises KeyboardInterrupt."""
        return side_by_side(searches, self._computed)

    def _computed(self, tasks: Sequence[Task]) -> list[Prediction | ComputationFailed]:
        found: dict[int, Prediction | ComputationFailed] = {
            i: self._known[key][1] for i, task in enumerate(tasks) if (key := _key(task)) in self._known
        }
        new = [i for i in range(len(tasks)) if i not in found]
        cuts = [i for i in new if tasks[i].experiment.kind == "cut" and self._pool.count]
        for i in new:
            if i not in cuts:
                task = tasks[i]
                self._check()
                try:
                    found[i] = predict(task, self._kept, self._runs)
                except ComputationFailed as error:
                    found[i] = error
        for done in self._pool.run(
            (Job(i, predict, (tasks[i], self._kept, self._runs)) for i in cuts), self._check
        ):
            fell_short = done.error if isinstance(done.error, ComputationFailed) else None
            found[done.key] = fell_short or done.result()
        # In their own order, whichever ended first: what is foreseen from them is then the same every time.
        for i in new:
            if tasks[i].experiment.kind == "cut" and isinstance(p := found[i], Prediction):
                self.memory.add(tasks[i].case, p.course, p.onset_mm)
                self._known[_key(tasks[i])] = tasks[i], p
        return [found[i] for i in range(len(tasks))]


@contextmanager
def predictor(
    workers: int, kept: str | Path | None = None, check: Callable[[], None] = ALWAYS
) -> Iterator[Predictor]:
    """With processes that live as long as the block; one alone would only wait, so it is this one. Runs of
    the folder ``kept`` are not computed again; ``check`` as a ``Predictor`` has it."""
    with TaskPool(workers if workers > 1 else 0) as pool:
        yield Predictor(pool, kept, check)
