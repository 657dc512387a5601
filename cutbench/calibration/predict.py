"""What a model says a test reads, how that changes with its parameters, and how surely it is known.

A homogeneous test answers from its formula, exactly. A cut answers from the emulator, with the error of that;
a machine and how it reads act on both alike. Nothing above knows which of the two it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.homogeneous import slopes
from cutbench.calibration.prediction import Reading, Task
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Averaged
from cutbench.emulator import CutEmulator


class NotKnown(Exception):
    """Too few cuts are known to say what a test would read."""


@dataclass(frozen=True)
class Predicted:
    """What a test reads.

    Attributes
    ----------
    y : ndarray, shape (m,)
        On the test's grid, N or MPa.
    slopes : ndarray, shape (m, k)
        Its derivatives by the parameters that were asked for, internal units.
    root : ndarray, shape (m, r)
        Root of the covariance of its error: r is 0 where it is exact.
    """

    y: np.ndarray
    slopes: np.ndarray
    root: np.ndarray


class Predictions:
    """Predictions of one model for the tests of a campaign.

    Parameters
    ----------
    campaign : Campaign
        The tests.
    base : Case
        The model, with the values of all parameters that are not asked for.
    grids : mapping
        By id, where each test is compared.
    runs : CutRuns
        What cuts were computed, and what computes more.
    free : sequence of str
        Parameters of the model that will be given other values.
    """

    def __init__(
        self,
        campaign: Campaign,
        base: Case,
        grids: Mapping[str, Averaged],
        runs: CutRuns,
        free: Sequence[str],
    ):
        self.campaign, self.base, self.grids, self.runs = campaign, base, grids, runs
        self._rig = {q.name for law in base.model.laws("rig") for q in law.parameters}
        self.free = tuple(dict.fromkeys(n for n in free if n not in self._rig))
        self._cuts = {e.id: campaign.case(e, base) for e in campaign.experiments if e.kind == "cut"}
        self._places: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._emulator: tuple[int, CutEmulator | None] = (-1, None)

    @property
    def emulator(self) -> CutEmulator:
        """Of all cuts of the campaign, from what was computed until now. Raises NotKnown."""
        known = len(self.runs.database.runs)
        if self._emulator[0] != known:
            cases = [_bare(case) for case in self._cuts.values()]
            self._emulator = known, self.runs.database.emulator(cases, self.free)
        if (found := self._emulator[1]) is None:
            raise NotKnown(f"{known} cuts are too few")
        return found

    def case(self, e: Experiment, values: Mapping[str, float]) -> Case:
        """The case of a test with ``values`` in place of the base's; of a cut, as it is computed."""
        base = self._cuts.get(e.id, self.base)
        made = replace(base, values={**base.values, **values})
        return _bare(made) if e.kind == "cut" else made

    def predict(self, e: Experiment, values: Mapping[str, float], names: Sequence[str] = ()) -> Predicted:
        """What a test reads.

        Parameters
        ----------
        e : Experiment
            The test.
        values : mapping
            Values of parameters in place of the base's, internal units.
        names : sequence of str
            Parameters that the readings are differentiated by.

        Returns
        -------
        Predicted

        Raises
        ------
        NotKnown
            If too few cuts are known.
        ComputationFailed
            If a homogeneous test has no answer with these values.
        """
        if e.kind != "cut":
            case = replace(self.base, values={**self.base.values, **values})
            y, by = slopes(e, case.model, case.p, tuple(names), self.grids[e.id])
            return Predicted(y, np.nan_to_num(by), np.zeros((y.size, 0)))
        return self._cut(e, values, names)

    def _cut(self, e: Experiment, values: Mapping[str, float], names: Sequence[str]) -> Predicted:
        case, emulator = self._cuts[e.id], self.emulator
        every = {**case.values, **values}  # of a rig, too, which the emulator does not know
        there = emulator.travel(every)
        x, force = emulator.computed(every) or (there, emulator.forces([every])[0])
        meshed = [n for n in names if n in emulator.groups.powers]
        by = {
            n: np.interp(x, there, c) for n, c in zip(meshed, emulator.slopes(every, meshed).T, strict=True)
        }
        # An error of the force is read as a change of it is, so its root goes along with the derivatives.
        errors = {f"error {i}": np.interp(x, there, c) for i, c in enumerate(emulator.root(every).T)}
        course = np.stack([x, force, x / every["speed"]])
        reading = self._reading(e, case, course, (*names, *errors))
        y, read = reading.by({**every, **dict.fromkeys(errors, 0.0)}, {**by, **errors})
        return Predicted(y, np.nan_to_num(read[:, : len(names)]), read[:, len(names) :])

    def read(self, e: Experiment, values: Mapping[str, float], course: np.ndarray) -> np.ndarray:
        """What the machine reads (m,) of a computed cut's ``course`` (3, n)."""
        case = self._cuts[e.id]
        return self._reading(e, case, course, ()).by({**case.values, **values}, {})[0]

    def _reading(self, e: Experiment, case: Case, course: np.ndarray, names: Sequence[str]) -> Reading:
        task = Task(e, case, self.grids[e.id], tuple(names))
        if e.id not in self._places:
            self._places[e.id] = task.reading
        return Reading(task, course, self._places[e.id])


def _bare(case: Case) -> Case:
    """``case`` without its rig: what the specimen and the blade do is the same."""
    rig = {q.name for law in case.model.laws("rig") for q in law.parameters}
    if not rig:
        return case
    values = {name: value for name, value in case.values.items() if name not in rig}
    return replace(case, mechanisms=case.model.unrigged.mechanisms, values=values)
