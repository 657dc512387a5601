"""What a model says a test reads, how that changes with its parameters, and how surely it is known.

A homogeneous test answers from its formula, exactly. A cut answers from the emulator, with the error of that;
a machine and how it reads act on both alike. Nothing above knows which of the two it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration.cut_runs import CutRuns, without_rig
from cutbench.calibration.recorder import Recorder
from cutbench.case.case import Case
from cutbench.case.motion import Motion
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Averaged
from cutbench.emulator import AtlasCuts, CokrigedCuts, CutEmulator, NotInAtlas, OutOfRange
from cutbench.homogeneous import slopes

#: Cuts are computed deeper than they were measured by this part, where the specimen is high enough: a machine
#: whose zero was set late shows less than the blade went.
EXTRA_DEPTH = 0.12
#: Derivatives of a run beyond the onset are those of a stair: none counts for more than so many times the
#: largest force.
MAX_SLOPE = 6.0


def _with_greater_depth(case: Case) -> Case:
    """``case`` as far down as its cuts are computed."""
    if case.motion:
        return case
    with suppress(BadInput):
        return replace(case, values={**case.values, "depth": (1 + EXTRA_DEPTH) * case.values["depth"]})
    return case


class NotComputed(ComputationFailed):
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
    onset_mm : float
        Where a cut begins; nan where it does not, of other tests, and where none asks.
    """

    y: np.ndarray
    slopes: np.ndarray
    root: np.ndarray
    onset_mm: float = float("nan")


class Predictions:
    """Predictions of one model for the tests of a campaign."""

    def __init__(
        self,
        campaign: Campaign,
        base: Case,
        grids: Mapping[str, Averaged],
        runs: CutRuns,
        free: Sequence[str],
        by_atlas: bool = False,
    ):
        self.campaign, self.base, self.grids, self.runs = campaign, base, grids, runs
        #: Whether cuts are those of the atlas, so that none is computed.
        self.by_atlas = by_atlas
        rig = {q.name for law in base.model.laws("rig") for q in law.parameters}
        self.free = tuple(dict.fromkeys(n for n in free if n not in rig))
        self._cuts = {
            e.id: _with_greater_depth(campaign.case(e, base)) for e in campaign.experiments if e.kind == "cut"
        }
        self._recorders = {
            e.id: Recorder.of(e, grids[e.id], base.model) for e in campaign.experiments if e.id in self._cuts
        }
        self._emulators: tuple[int, dict[tuple, CutEmulator | AtlasCuts]] = (-1, {})
        #: Whether a cut that was computed answers as it is, or as smoothly as those about it.
        self.exact = True

    @property
    def smooth(self) -> Predictions:
        """The same by the emulator alone, also where a cut was computed."""
        made = self.with_free(self.free)
        made._emulators, made.exact = self._emulators, False
        return made

    def with_free(self, free: Sequence[str]) -> Predictions:
        """The same with other free parameters."""
        return Predictions(self.campaign, self.base, self.grids, self.runs, free, self.by_atlas)

    def extended(self, base: Case, free: Sequence[str]) -> Predictions:
        """The same of another model."""
        return Predictions(self.campaign, base, self.grids, self.runs, free, self.by_atlas)

    def of(self, campaign: Campaign) -> Predictions:
        """The same for the tests of another campaign."""
        return Predictions(campaign, self.base, self.grids, self.runs, self.free, self.by_atlas)

    def needs_runs(self, e: Experiment) -> bool:
        """Whether a test is known from runs, not from a formula."""
        return e.id in self._cuts and not self.by_atlas

    def parts_meet_mm(self, e: Experiment, onset_mm: float) -> float:
        """Where the part of a curve before its cut begins ends; what goes to and fro has no such part."""
        return 0.0 if e.id in self._cuts and self._cuts[e.id].motion else onset_mm

    def thickness_mm(self, e: Experiment) -> float:
        """Of the blade of a cut; nan of another test."""
        case = self._cuts.get(e.id)
        return float("nan") if case is None else case.values.get("thickness", float("nan"))

    def compute(self, e: Experiment, values: Mapping[str, float]) -> None:
        """Have the run of a cut computed, so that it is exact from now on. Raises ComputationFailed."""
        if self.needs_runs(e) and self.runs([case := self.case(e, values)]) == [None]:
            raise ComputationFailed(self.runs.failed[case.id])

    def emulator(self, e: Experiment) -> CutEmulator | AtlasCuts:
        """Of all cuts that go the way of ``e``, from what was computed until now, or the atlas in place of
        that. Raises NotComputed."""
        known, motion = len(self.runs.database.runs), self._cuts[e.id].motion
        if self._emulators[0] != known:
            self._emulators = known, {}
        if motion not in self._emulators[1]:
            cases = [without_rig(case) for case in self._cuts.values() if case.motion == motion]
            found = self._of_atlas(e, cases) if self.by_atlas else self._of_runs(e, cases)
            if found is None:
                raise NotComputed(f"{known} cuts are too few")
            self._emulators[1][motion] = found
        return self._emulators[1][motion]

    def _of_atlas(self, e: Experiment, cases: Sequence[Case]) -> AtlasCuts:
        """The atlas of cuts like ``e``. Raises NotInAtlas, ComputationFailed."""
        try:
            return AtlasCuts(self._plain(e), cases, self.free)
        except ValueError as error:
            raise ComputationFailed(f"not by the atlas: {error}") from error

    def _of_runs(self, e: Experiment, cases: Sequence[Case]) -> CutEmulator | None:
        """Of what was computed, beside the atlas where that has cuts like ``e``."""
        known = self.runs.database
        try:
            return CokrigedCuts(known.runs, self._plain(e), cases, self.free, known.curves)
        except NotInAtlas:
            return known.emulator(cases, self.free)
        except ValueError:
            return None

    def _plain(self, e: Experiment) -> Case:
        """The baseline's cut without laws that do what another value does."""
        case = without_rig(self.campaign.case(e, self.campaign.base))
        model = case.model.without(*(law.name for law in case.model.all if law.like(case.p)))
        kept = model.parameters()
        return replace(
            case, mechanisms=model.mechanisms, values={n: v for n, v in case.values.items() if n in kept}
        )

    def case(self, e: Experiment, values: Mapping[str, float]) -> Case:
        """The case of a test with ``values`` in place of the base's; of a cut, as it is computed. Raises
        ComputationFailed for values that do not go together."""
        base = self._cuts.get(e.id, self.base)
        try:
            made = replace(base, values={**base.values, **values})
        except BadInput as error:
            raise ComputationFailed(str(error)) from error
        return without_rig(made) if e.id in self._cuts else made

    def predict(
        self, e: Experiment, values: Mapping[str, float], names: Sequence[str] = (), sure: bool = False
    ) -> Predicted:
        """What a test reads, with its error or as if it were ``sure``. Raises NotComputed,
        ComputationFailed."""
        self.runs.check()
        if e.id in self._cuts:
            try:
                return self._cut(e, values, names, sure)
            except OutOfRange as error:
                # A run there would tell, but where the atlas ends there is none.
                raise (ComputationFailed if self.by_atlas else NotComputed)(str(error)) from error
        case = self.case(e, values)
        try:
            y, by = slopes(e, case.model, case.p, tuple(names), self.grids[e.id])
        except (ComputationFailed, BadInput) as error:
            raise ComputationFailed(f"'{e.id}': {error}") from error
        return Predicted(y, np.nan_to_num(by), np.zeros((y.size, 0)))

    def computed(self, e: Experiment, values: Mapping[str, float], names: Sequence[str] = ()) -> Predicted:
        """The same of a cut from its own run, with exact derivatives as far as that has them. Raises NotKnown
        where it was not computed."""
        run = self.runs.known(self.case(e, values))
        if run is None:
            raise NotComputed(f"'{e.id}' was not computed there")
        every, recorder = {**self._cuts[e.id].values, **values}, self._recorders[e.id]
        y, by = recorder.read(run.course, every, run.slopes, names)
        return Predicted(y, by, np.zeros((y.size, 0)), run.onset_mm)

    def curve(self, e: Experiment, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Travel (n,) in mm and force (n,) in N of a monotone cut, as no machine reads them: of its run, or
        by the emulator. Raises NotKnown."""
        run = self.runs.known(self.case(e, values))
        if run is not None:
            return run.course[0], run.course[1]
        try:
            every, emulator = {**self._cuts[e.id].values, **values}, self.emulator(e)
            return emulator.travel(every), emulator.forces([every])[0]
        except OutOfRange as error:
            raise NotComputed(str(error)) from error

    def _cut(self, e: Experiment, values: Mapping[str, float], names: Sequence[str], sure: bool) -> Predicted:
        case, emulator = self._cuts[e.id], self.emulator(e)
        every = {**case.values, **values}  # of a rig, too, which the emulator does not know
        there = emulator.travel(every)
        known = emulator.computed(every) if self.exact else None
        x, force = known or (there, emulator.forces([every])[0])
        meshed = [n for n in names if n in emulator.groups.powers]
        by = {
            n: np.interp(x, there, c) for n, c in zip(meshed, emulator.slopes(every, meshed).T, strict=True)
        }
        # An error of the force is read as a change of it is, so its root goes along with the derivatives.
        root = emulator.root(every).T if known is None and not sure else ()
        errors = {f"error {i}": np.interp(x, there, c) for i, c in enumerate(root)}
        travel = x
        if case.motion:
            motion = Motion(case.values["depth"], every["speed"], case.motion)
            travel = np.array([motion.travel(way) for way in x])
        course = np.stack([travel, force, x / every["speed"]])
        all_ = {**every, **dict.fromkeys(errors, 0.0)}
        y, read = self._recorders[e.id].read(course, all_, {**by, **errors}, (*names, *errors))
        # The atlas' own error holds where a cut begins, so that none asks.
        onset = float("nan") if sure and self.by_atlas else emulator.onset_mm(every)
        return Predicted(y, read[:, : len(names)], read[:, len(names) :], onset)

    def read(self, e: Experiment, values: Mapping[str, float], course: np.ndarray) -> np.ndarray:
        """What the machine reads (m,) of a computed cut's ``course`` (3, n)."""
        return self._recorders[e.id].read(course, {**self._cuts[e.id].values, **values})[0]

    def read_slopes(
        self,
        e: Experiment,
        values: Mapping[str, float],
        course: np.ndarray,
        slopes: Mapping[str, np.ndarray],
        largest: Mapping[str, float],
    ) -> np.ndarray:
        """What it reads of derivatives (n,) of the force of a run, by name; ``largest``: what each may be.

        Beyond the onset a run's exact derivatives are those of a stair, so that large ones are cut off.
        Gives (m, k).
        """
        cut = {n: np.clip(np.nan_to_num(v), -largest[n], largest[n]) for n, v in slopes.items()}
        every = {**self._cuts[e.id].values, **values}
        return self._recorders[e.id].read(course, dict.fromkeys(cut, 0.0) | every, cut, tuple(cut))[1]
