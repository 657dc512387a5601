"""What a testing machine reads of a computed cut, on the grid of its test, and how that changes.

Of a test of which measures are known, what a person would read off the curve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.case.model import Model
from cutbench.data.campaign import lead_s
from cutbench.data.experiment import Experiment
from cutbench.data.measures import MeasuredCut
from cutbench.data.repetition import Averaged, averaging_matrix
from cutbench.mechanisms.base import STEP


@dataclass(frozen=True, eq=False)
class Recorder:
    """Reads the courses of cuts as the machine of a test does.

    Attributes
    ----------
    experiment : Experiment
        The test.
    grid : Averaged
        Where it is compared.
    model : Model
        With the laws of the rig.
    """

    experiment: Experiment
    grid: Averaged
    model: Model

    @classmethod
    def of(cls, experiment: Experiment, grid: Averaged, model: Model) -> Recorder:
        """The one that a test needs."""
        kind = MeasureRecorder if isinstance(experiment, MeasuredCut) else Recorder
        return kind(experiment, grid, model)

    @property
    def of_time(self) -> bool:
        """Whether readings have their place in time: those of a cut with holds or returns."""
        return not self.experiment.monotone

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (n,) of all readings in mm or s of the run, and the matrix (m, n) to the grid.

        A computed curve goes the same way as the measured ones: an average over readings is not the value
        in their middle where the curve bends.
        """
        if self.of_time:
            _, along, matrices = self.experiment.averaging(self.grid.x.size)
            return lead_s(self.experiment) + np.concatenate(along), np.hstack(matrices) / len(matrices)
        places, grid = [np.sort(r.x) for r in self.experiment.repetitions], self.grid.x
        parts = [np.eye(x.size) if np.array_equal(x, grid) else averaging_matrix(x, grid) for x in places]
        return np.concatenate(places), np.hstack(parts) / len(parts)

    def read(
        self,
        course: np.ndarray,
        values: Mapping[str, float],
        slopes: Mapping[str, np.ndarray] | None = None,
        names: Sequence[str] = (),
    ) -> tuple[np.ndarray, np.ndarray]:
        """Readings of a course. With ``course`` (3, n); gives ``y`` (m,), ``by`` (m, k)."""
        slopes, none = slopes or {}, np.zeros(course.shape[1])
        columns = [np.nan_to_num(slopes.get(name, none)) for name in names]
        if not self.model.laws("rig"):
            read = self._plain(course, np.stack([course[1], *columns], axis=1))
            return read[:, 0], read[:, 1:]
        stepped = [self._shown(course.astype(complex), values)]
        for name, slope in zip(names, columns, strict=True):
            moved = course.astype(complex)
            moved[1] += 1j * STEP * slope
            stepped.append(self._shown(moved, {**values, name: values[name] + 1j * STEP}))
        read = np.stack(stepped, axis=1)
        return read[:, 0].real, read[:, 1:].imag / STEP

    def _plain(self, course: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Without a rig, readings (m, k) are linear in the force."""
        places, average = self.places
        if self.of_time:
            return average @ _polygon(places, course[2], columns)
        on = course[0] > np.append(-np.inf, np.maximum.accumulate(course[0])[:-1])
        return average @ _polygon(places, course[0][on], columns[on])

    def _shown(self, course: np.ndarray, values: Mapping[str, complex]) -> np.ndarray:
        """Readings (m,), complex, through the rig."""
        p, (places, average) = self.model.namespace(values), self.places
        if self.of_time:  # at the same time the blade is elsewhere only where a rig says so
            read = _polygon(places, course[2], self.model.record(course[0], course[1], course[2], p)[1])
        else:
            x, force, _ = self.model.shown(course, p)
            if places.max() > x[-1].real + 0.01 * places.max():  # a hundredth beyond it is read at its end
                raise ComputationFailed(f"'{self.experiment.id}' was read farther than its cut was computed")
            read = _polygon(places, x, force)
        # A real matrix times a complex vector would be a thousand times as slow.
        return average @ read.real + 1j * (average @ read.imag)


class MeasureRecorder(Recorder):
    """Reads measures off the courses of cuts, in their standard deviations."""

    def read(
        self,
        course: np.ndarray,
        values: Mapping[str, float],
        slopes: Mapping[str, np.ndarray] | None = None,
        names: Sequence[str] = (),
    ) -> tuple[np.ndarray, np.ndarray]:
        """As of a ``Recorder``; derivatives by differences."""
        y, slopes = self._measures(course, values), slopes or {}
        rig = {q.name: q for law in self.model.laws("rig") for q in law.parameters}
        by = np.zeros((y.size, len(names)))
        for k, name in enumerate(names):
            slope = np.nan_to_num(slopes.get(name, np.zeros(course.shape[1])))
            # A step by which a curve is moved by a ten-thousandth of its force, to see how measures change.
            if steep := float(np.abs(slope).max()):
                step = 1e-4 * float(np.abs(course[1]).max()) / steep
            elif name in rig:  # what only the machine depends on
                length, force, _ = np.abs(course).max(axis=1)
                q = rig[name].in_tests(force, length, length / self.experiment.speed)
                step = 1e-4 * max(abs(values[name]), abs(q.typical * q.factor))
            else:
                continue
            down, up = (
                self._measures(course + np.outer([0, side, 0], slope), {**values, name: values[name] + side})
                for side in (-step, step)
            )
            by[:, k] = (up - down) / (2 * step)
        return y, by

    def _measures(self, course: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        assert isinstance(self.experiment, MeasuredCut), "see of"
        x, force = course[0], course[1]
        if self.model.laws("rig"):
            shown = self.model.shown(course.astype(complex), self.model.namespace(values))
            x, force = shown[0].real, shown[1].real
        return self.experiment.read(x, force)


def _polygon(at: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The polygon through points x (n,), y (n, …) at real places, with its complex step if these are complex;
    ends go on level."""
    i = np.clip(np.searchsorted(x.real, at, side="right") - 1, 0, x.size - 2)
    inside = np.clip(at, x[0].real, x[-1].real)
    part = (inside - x[i]) / (x[i + 1] - x[i])
    return y[i] + part.reshape(-1, *(1,) * (y.ndim - 1)) * (y[i + 1] - y[i])
