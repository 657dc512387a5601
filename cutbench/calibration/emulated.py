"""An inverse problem whose derivatives follow from all cuts that were computed, see ``memory``.

At a place that was computed readings are those of the run, and only their derivatives are from others; what
would be read at any other place can be ``Foreseeing``, without a run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.memory import Emulator, Scale
from cutbench.calibration.prediction import Prediction, Predictor, Reading, Task
from cutbench.calibration.sparing import Sparing
from cutbench.case.case import Case
from cutbench.data.experiment import Experiment
from cutbench.mechanisms.base import STEP as STEP_READ

#: In q: half the length over which a derivative is taken.
STEP = 0.05


class Emulated(Sparing):
    """``inverse`` with such derivatives where runs enough are known of each test, else with updated ones."""

    def __init__(self, inverse: Inverse):
        super().__init__(inverse)
        self.rig = {p.name for law in self.start.model.laws("rig") for p in law.parameters}
        self._places: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._cases: dict[str, Case] = {}
        #: With how many runs they know.
        self._emulators: dict[str, tuple[int, Emulator | None]] = {}

    def predictions(self, q: np.ndarray) -> Mapping[str, Prediction]:
        """Of the train experiments; raises ComputationFailed."""
        key = q.tobytes()
        if key not in self._known:
            train = self.campaign.train
            if key in self._computed:
                plain = self._computed[key]
            elif self.able:
                rigs = {e.id: tuple(n for n in self.names(e) if n in self.rig) for e in train}
                tasks = [Task(e, self.checked_case(e, q), self.grids[e.id], rigs[e.id]) for e in train]
                plain = dict(zip([e.id for e in train], self.run(tasks), strict=True))
            if not self.able:
                return super().predictions(q)
            self._known[key] = {e.id: self._sloped(e, plain[e.id], q) for e in train}
        return self._known[key]

    @cached_property
    def emulable(self) -> bool:
        """Whether cuts of all tests can tell of others once they are computed."""
        train = self.campaign.train
        return (
            hasattr(self.run, "memory")
            and all(map(_plain, train))
            and not any(Scale.of(self._case(e)) is None for e in train)
        )

    @property
    def proportional(self) -> set[str]:
        """The modulus that all forces are proportional to, where no other that is known sets their scale."""
        found = set()
        for e in self.campaign.train:
            case, names = self._case(e), self.names(e)
            scale = Scale.of(case)
            if scale and all(n in names or not case.values[n] for n, (f, _) in scale.powers.items() if f):
                found.add(scale.modulus)
        return found

    def hull(self, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Between which values of q (k,) runs are known; of what they do not vary, an open unit around the
        ``starts``, and as far beyond its off value."""
        low, high = np.min(starts, axis=0) - 1.0, np.max(starts, axis=0) + 1.0
        runs = self.run.memory.runs if self.emulable else []
        for k, u in enumerate(self.unknowns):
            q = [
                u.q(r.case.values[u.name]) for r in runs if u.name in r.case.values and u.name not in self.rig
            ]
            q = [x for x in q if np.isfinite(x)]
            if len({*q}) > 1:
                low[k], high[k] = min(*q, low[k] + 1.0), max(*q, high[k] - 1.0)
            elif u.quantity.off is not None and np.isfinite(off := u.q(u.quantity.off_value)):
                mirrored = 2 * off - starts[0][k]
                low[k], high[k] = min(low[k], mirrored), max(high[k], mirrored)
        low, high = (np.clip(each, *self.bounds) for each in (low, high))
        return low, high

    @property
    def able(self) -> bool:
        """Whether enough is known of all tests."""
        return all(self._emulator(e) is not None for e in self.campaign.train)

    def _sloped(self, e: Experiment, p: Prediction | None, q: np.ndarray) -> Prediction:
        """Readings of the course of ``p``, or of what is foreseen, with derivatives."""
        emulator, names = self._emulator(e), self.names(e)
        assert emulator is not None, "able() was asked"
        mine, values = self._values(e, q)
        moved, asked = [values], []
        for name in (n for n in names if n not in self.rig):
            u, x = self.unknowns[mine[name]], q[mine[name]]
            low, high = (u.value(float(np.clip(x + step, *u.reach))) for step in (-STEP, STEP))
            moved += [{**values, name: low}, {**values, name: high}]
            asked.append((name, high - low))
        forces = emulator.forces(moved)
        if p is None:
            course = np.stack([emulator.x, forces[0], emulator.x / values["speed"]])
            p = Prediction(forces[0], np.zeros((0, 0)), course=course)
        by = {
            name: np.interp(p.course[0], emulator.x, (forces[2 * i + 2] - forces[2 * i + 1]) / change)
            for i, (name, change) in enumerate(asked)
            if change
        }
        task = Task(e, self._case(e), self.grids[e.id], names)
        y, slopes = Reading(task, p.course, self._read(task)).by(values, by)
        return replace(p, y=y, slopes=slopes, names=names)

    def _values(self, e: Experiment, q: np.ndarray) -> tuple[dict[str, int], dict[str, float]]:
        """Which of the unknowns are a test's, by name, and all its values at ``q``."""
        mine = {u.name: k for k, u in enumerate(self.unknowns) if u.experiment in (None, e.id)}
        return mine, {**vars(self._case(e).p), **{n: self.unknowns[k].value(q[k]) for n, k in mine.items()}}

    def _case(self, e: Experiment) -> Case:
        if e.id not in self._cases:
            self._cases[e.id] = self.case(e, np.zeros(len(self.unknowns)))
        return self._cases[e.id]

    def _read(self, task: Task) -> tuple[np.ndarray, np.ndarray]:
        id = task.experiment.id
        if id not in self._places:
            self._places[id] = task.reading
        return self._places[id]

    def _emulator(self, e: Experiment) -> Emulator | None:
        if not self.emulable:
            return None
        memory = self.run.memory
        count, emulator = self._emulators.get(e.id, (-1, None))
        if count != len(memory.runs):
            names = [n for n in self.names(e) if n not in self.rig]
            emulator = memory.emulator(self._case(e), names, float(self.grids[e.id].x[-1]))
            self._emulators[e.id] = len(memory.runs), emulator
        return emulator


class Foreseeing(Emulated):
    """What runs would give, by those that are known, without any: ``able`` was asked."""

    def __init__(self, inverse: Inverse):
        super().__init__(inverse)
        #: How many runs were known, where the last was foreseen, and what, by id.
        self._last: tuple[int, bytes, dict[str, Prediction]] = (0, b"", {})

    def predictions(self, q: np.ndarray) -> Mapping[str, Prediction]:
        """Of the train experiments."""
        return {e.id: self.prediction(e, q) for e in self.campaign.train}

    def prediction(self, e: Experiment, q: np.ndarray) -> Prediction:
        """Of one of them. Forces, works and doubts are asked for one after the other at the same place, so
        what was foreseen at the last one is kept."""
        known, there = len(self.run.memory.runs), q.tobytes()
        if (known, there) != self._last[:2]:
            self._last = known, there, {}
        found = self._last[2]
        if e.id not in found:
            found[e.id] = self._sloped(e, None, q)
        return found[e.id]

    def error(self, e: Experiment, q: np.ndarray) -> np.ndarray:
        """Root (m, k) of the covariance of what a run would read and is not foreseen."""
        (emulator, (_, values)), p = (self._emulator(e), self._values(e, q)), self.prediction(e, q)
        assert emulator is not None, "able() was asked"
        columns = emulator.error(values).T
        task = Task(e, self._case(e), self.grids[e.id])
        reading, named = Reading(task, p.course, self._read(task)), SimpleNamespace(**values)
        return np.stack([reading.of(named, column).imag / STEP_READ for column in columns], axis=1)


def _plain(e: Experiment) -> bool:
    """A cut that goes one way, of which no pictures were taken."""
    return e.kind == "cut" and e.monotone and not e.fields


def settled_at(inverse: Inverse, q: np.ndarray, run: Predictor | None = None) -> Inverse:
    """``inverse`` with the values at ``q`` for starts, and its derivatives there over a step: from the runs
    that are known if these are enough, else from others."""
    made = inverse.moved(q, run)
    problem, still = Emulated(made), np.zeros(q.size)
    if not problem.able or still.tobytes() not in made._known:
        return inverse.moved(q, run, across=True)
    made.know(still, problem.predictions(still))
    made.across = True
    return made
