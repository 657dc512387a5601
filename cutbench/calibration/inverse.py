"""The inverse problem of a campaign: what is looked for, and whitened residuals with their derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration import mesh_error, secant
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.looked_for import visible
from cutbench.calibration.prediction import Prediction, Predictor, Task
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.covariance import Covariance
from cutbench.data.experiment import Experiment
from cutbench.data.fields import laid_out
from cutbench.data.repetition import Averaged

#: Values on which each experiment is compared.
GRID = 40
#: Where a curve jumps (an unstable cut), its derivative is that of the jump's place and says nothing of the
#: change over the length of a step: a reading's derivative by q counts up to so many times the curve's
#: maximum, and one beyond has an error of this part of the maximum.
STEEP, JUMP = 6.0, 0.2
#: What is nearer to a bound, in q, is held by it.
AT_BOUND = 1e-6


class Inverse:
    """Residuals of a campaign's train experiments as a function of q (k,), the scaled unknowns.

    ``start`` is the case whose other values stay (default: the campaign's), ``grids`` by id where the
    experiments are compared. What was computed is kept by q; nothing else changes. ``across``:
    derivatives of cuts are those over a step, see ``calibration.secant``.
    """

    def __init__(
        self,
        campaign: Campaign,
        looked_for: Sequence[Unknown],
        run: Predictor,
        grid: int = GRID,
        *,
        start: Case | None = None,
        grids: Mapping[str, Averaged] | None = None,
        across: bool = False,
    ):
        self.campaign, self.unknowns, self.run = campaign, list(looked_for), run
        self.start = start or campaign.base
        self.grids = grids or {e.id: e.on_grid(grid) for e in campaign.experiments}
        self.across = across
        self._known: dict[bytes, Mapping[str, Prediction]] = {}
        #: With exact derivatives where those over a step are asked for.
        self._sketched: dict[bytes, Mapping[str, Prediction]] = {}

    def other(self, looked_for: Sequence[Unknown], start: Case, run: Predictor | None = None) -> Inverse:
        """The same data with other unknowns, from another case."""
        return Inverse(self.campaign, looked_for, run or self.run, start=start, grids=self.grids)

    def weighing(self, grids: Mapping[str, Averaged]) -> Inverse:
        """With ``grids`` whose readings have another noise; what was computed stays."""
        made = self.other(self.unknowns, self.start)
        made.grids, made.across = grids, self.across
        made._known, made._sketched = dict(self._known), dict(self._sketched)
        return made

    def only(self, kept: Sequence[int]) -> Inverse:
        """With the unknowns of these numbers alone, at their starts; what was computed there stays."""
        made = self.other([self.unknowns[i] for i in kept], self.start)
        return made._knowing(self._known.get(np.zeros(len(self.unknowns)).tobytes()))

    def know(self, q: np.ndarray, found: Mapping[str, Prediction]) -> None:
        """Take ``found``, by id, for what would be computed at ``q``."""
        self._known[q.tobytes()] = found

    def sketch(self, q: np.ndarray, found: Mapping[str, Prediction]) -> None:
        """Take ``found``, by id, for what has exact derivatives at ``q``: they say how long a step is."""
        self._sketched[q.tobytes()] = found

    def differenced(self) -> Inverse:
        """With derivatives of cuts over a step; what was computed stays."""
        made = self.other(self.unknowns, self.start)
        made.across, made._sketched = True, self._known
        return made

    def moved(self, q: np.ndarray, run: Predictor | None = None, across: bool = False) -> Inverse:
        """With the values at ``q`` for starts; what was computed there stays."""
        made = self.other(self.at(q), self.base(q), run)
        made.across = across
        return made._knowing(self._known.get(q.tobytes()))

    def at(self, q: np.ndarray) -> list[Unknown]:
        """The unknowns with their values at ``q`` for starts."""
        return [replace(u, start=u.value(x)) for u, x in zip(self.unknowns, q, strict=True)]

    def _knowing(self, found: Mapping[str, Prediction] | None) -> Inverse:
        if found is not None:
            kept = self._sketched if self.across else self._known
            kept[np.zeros(len(self.unknowns)).tobytes()] = found
        return self

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        reach = np.array([u.reach for u in self.unknowns])
        return reach[:, 0], reach[:, 1]

    def inside(self, q: np.ndarray) -> np.ndarray:
        """Which of ``q`` (k,) no bound holds."""
        low, high = self.bounds
        return (q - low > AT_BOUND) & (high - q > AT_BOUND)

    def base(self, q: np.ndarray, experiment: Experiment | None = None) -> Case:
        """The start case with the values at ``q``.

        Where each experiment has a value of its own: that of ``experiment``; the mean for one that was
        not fitted.
        """
        values, id = dict(self.start.values), experiment and experiment.id
        for name in dict.fromkeys(u.name for u in self.unknowns):
            mine = [(u, x) for u, x in zip(self.unknowns, q, strict=True) if u.name == name]
            of = [(u, x) for u, x in mine if u.experiment in (None, id)]
            values[name] = float(np.mean([u.value(x) for u, x in of or mine]))
        return replace(self.start, values=values)

    def case(self, e: Experiment, q: np.ndarray) -> Case:
        base = self.base(q, e)
        return self.campaign.case(e, base) if e.kind == "cut" else base

    def checked_case(self, e: Experiment, q: np.ndarray) -> Case:
        """Raises ComputationFailed for values that do not go together, which a fit has tried."""
        try:
            return self.case(e, q)
        except BadInput as error:
            raise ComputationFailed(str(error)) from error

    def predictions(self, q: np.ndarray) -> Mapping[str, Prediction]:
        """Of the train experiments, with slopes; computed once for each q. Raises ComputationFailed."""
        key = q.tobytes()
        if key not in self._known:
            found = self._sketched.get(key)
            if found is None:
                train = self.campaign.train
                cases = [self.checked_case(e, q) for e in train]
                tasks = [
                    Task(e, c, self.grids[e.id], self.names(e)) for e, c in zip(train, cases, strict=True)
                ]
                found = dict(zip([e.id for e in train], self.run(tasks), strict=True))
            self._known[key] = secant.across(self, q, found) if self.across else found
        return self._known[key]

    def values(self, q: np.ndarray) -> np.ndarray:
        """Of the unknowns (k,), internal units."""
        return np.array([u.value(x) for u, x in zip(self.unknowns, q, strict=True)])

    def sizes(self, q: np.ndarray) -> np.ndarray:
        """What a unit of q is there (k,)."""
        return np.array([u.slope(x) for u, x in zip(self.unknowns, q, strict=True)])

    def predicted(self, q: np.ndarray, experiments: Sequence[Experiment], *, fine: bool) -> list[Prediction]:
        """Of any experiments, without slopes; ``fine``: cuts with smaller elements and steps."""
        cases = [self.case(e, q) for e in experiments]
        cases = [
            mesh_error.finer(c) if fine and e.kind == "cut" else c
            for c, e in zip(cases, experiments, strict=True)
        ]
        return self.run([Task(e, c, self.grids[e.id]) for e, c in zip(experiments, cases, strict=True)])

    def names(self, e: Experiment) -> tuple[str, ...]:
        """Of the unknowns that a test can depend on."""
        seen = visible(e, self.start)
        mine = [u.name for u in self.unknowns if u.name in seen and u.experiment in (None, e.id)]
        return tuple(dict.fromkeys(mine))

    def slopes(self, e: Experiment, prediction: Prediction, q: np.ndarray) -> np.ndarray:
        """dy/dq (m, k); of a cut no steeper than ``STEEP``."""
        J = self._derivatives(e, prediction, q)
        return np.nan_to_num(J) * self._gentle(e, J, prediction.y)[:, None]

    def scaled(self, e: Experiment, prediction: Prediction, slopes: np.ndarray, q: np.ndarray) -> np.ndarray:
        """By the scaled unknowns (m, k) what is given by the prediction's names."""
        J = np.zeros((slopes.shape[0], len(self.unknowns)))
        for k, u in enumerate(self.unknowns):
            if u.name in prediction.names and u.experiment in (None, e.id):
                J[:, k] = slopes[:, prediction.names.index(u.name)] * u.slope(q[k])
        return J

    def _derivatives(self, e: Experiment, prediction: Prediction, q: np.ndarray) -> np.ndarray:
        J = self.scaled(e, prediction, prediction.slopes, q)
        if not self.across and e.kind == "cut" and J.shape[1]:
            # Jags of the curve wander with the parameters: their derivatives are large and hold for no step.
            known = np.isfinite(J).all(axis=1)
            along = self.grids[e.id].along[known]
            if along.size > 2:
                J[known] = np.stack([mesh_error.smooth(along, column) for column in J[known].T], axis=1)
        return J

    @staticmethod
    def _gentle(e: Experiment, J: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Part (m,) of each reading's derivatives J (m, k) that counts; none where they are not known."""
        if e.kind != "cut":
            return np.ones(y.size)
        limit = STEEP * np.abs(y).max()
        size = np.linalg.norm(J, axis=1)
        return np.where(np.isfinite(size), np.minimum(1.0, limit / np.maximum(size, 1e-300)), 0.0)

    def _jumps(self, e: Experiment, prediction: Prediction, q: np.ndarray) -> np.ndarray:
        """Covariance (m, m) of a computed curve where it is too steep in the parameters to be trusted."""
        part = self._gentle(e, self._derivatives(e, prediction, q), prediction.y)
        return np.diag((1 - part**2) * (JUMP * np.abs(prediction.y).max()) ** 2)

    def guessed(self, q: np.ndarray) -> Covariance:
        """From the readings, the curves at ``q`` and a guess of the computation's error."""
        found = self.predictions(q)
        error = {e.id: self._jumps(e, found[e.id], q) for e in self.campaign.train}
        for e in (e for e in self.campaign.train if e.kind == "cut"):
            error[e.id] += mesh_error.guessed_error(self.grids[e.id].along, found[e.id].y)
        return self._covariance(q, error)

    def measured(self, q: np.ndarray) -> tuple[Covariance, list[str]]:
        """The covariance at ``q`` with the cuts computed on a finer mesh there; says what that found."""
        cuts = [e for e in self.campaign.train if e.kind == "cut"]
        if not cuts:
            return self.guessed(q), []
        coarse = self.predictions(q)
        try:
            answers = self.predicted(q, cuts, fine=True)
        except (ComputationFailed, BadInput) as error:
            return self.guessed(q), [f"The computation's own error is not known, 5 % were assumed: {error}"]
        fine = dict(zip([e.id for e in cuts], answers, strict=True))
        unsure = {e.id: self._jumps(e, coarse[e.id], q) for e in self.campaign.train}
        shift, notes = {}, []
        for e in cuts:
            x, y, better = self.grids[e.id].along, coarse[e.id].y, fine[e.id].y
            part = 100 * np.sqrt(np.mean((better - y) ** 2)) / np.abs(y).max()
            notes.append(
                f"'{e.id}': finer numerics change the computed curve by {part:.1f} % of its"
                " maximum (root mean square); the fit allows for that."
            )
            shift[e.id] = mesh_error.correction(x, y, better)
            unsure[e.id] += mesh_error.measured_error(x, y, better)
        return self._covariance(q, unsure, shift, fine), notes

    def _covariance(
        self,
        q: np.ndarray,
        error: Mapping[str, np.ndarray],
        shift: Mapping[str, np.ndarray] | None = None,
        fine: Mapping[str, Prediction] | None = None,
    ) -> Covariance:
        found, train, shift, fine = self.predictions(q), self.campaign.train, shift or {}, fine or {}
        fields = {
            e.id: mesh_error.field_block(e, found[e.id].fields, fine[e.id].fields if e.id in fine else None)
            for e in train
            if e.fields
        }
        y = {e.id: found[e.id].y + shift.get(e.id, 0.0) for e in train}
        return Covariance.of(self.grids, {e.id: e.kind for e in train}, y, error, shift, fields)

    def residuals(
        self, q: np.ndarray, covariance: Covariance
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Computed less measured (m,) and its derivatives (m, k), by id."""
        found, r, J = self.predictions(q), {}, {}
        for e in self.campaign.train:
            p = found[e.id]
            r[e.id] = p.y + covariance.tests[e.id].shift - self.grids[e.id].mean
            J[e.id] = self.slopes(e, p, q)
        return r, J

    def residuals_inside(
        self, q: np.ndarray, covariance: Covariance
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """The same without derivatives by what a bound holds: it takes up nothing that is beyond it."""
        (r, J), inside = self.residuals(q, covariance), self.inside(q)
        return r, {id: by * inside for id, by in J.items()}

    def whitened(self, q: np.ndarray, covariance: Covariance) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (M,), computed less measured, and their derivatives (M, k)."""
        found, (residual, J) = self.predictions(q), self.residuals(q, covariance)
        rows, slopes = (
            [block.white(by[id]) for id, block in covariance.tests.items()] for by in (residual, J)
        )
        # Fields last: what counts degrees of freedom by curves looks at the first rows.
        for e in (e for e in self.campaign.train if e.id in covariance.fields):
            block, p = covariance.fields[e.id], found[e.id]
            rows.append(block.white(p.fields - laid_out(e.fields)))
            slopes.append(block.white(self.scaled(e, p, p.field_slopes, q)))
        return np.concatenate(rows), np.concatenate(slopes)


def field_note(e: Experiment, prediction: Prediction, whose: str) -> str:
    """How near computed displacement fields of an experiment are to the measured ones, in a sentence."""
    measured = laid_out(e.fields)
    known = np.isfinite(measured) & np.isfinite(prediction.fields)
    if not known.any():
        return f"'{e.id}': none of the places of its fields lies in the computed body."
    left, size = (np.sqrt(np.mean(u[known] ** 2)) for u in (prediction.fields - measured, measured))
    fields = f"{len(e.fields)} field{'s' * (len(e.fields) > 1)}"
    return (
        f"'{e.id}': of {known.sum()} displacements in {fields} the {whose} is off by {left:.3g} mm (root"
        f" mean square), where {size:.3g} mm were measured and {e.field_noise_mm:g} mm are noise."
    )
