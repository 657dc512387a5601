"""The inverse problem of a campaign: what is looked for, and whitened residuals with their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.toml import one_of
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.prediction import Prediction, Predictor, Task
from cutbench.calibration.weights import (
    Factors,
    FieldWeights,
    Weights,
    along,
    correction,
    finer,
    guessed_error,
    measured_error,
    smooth,
)
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import SLOTS, Experiment
from cutbench.data.fields import laid_out
from cutbench.run.sensitivity import differentiable

#: Values on which each experiment is compared.
GRID = 40
#: Where a curve jumps (an unstable cut), its derivative is that of the jump's place and says nothing of the
#: change over the length of a step: a reading's derivative by q counts up to so many times the curve's
#: maximum, and one beyond has an error of this part of the maximum.
STEEP, JUMP = 6.0, 0.2


def visible(experiment: Experiment, case: Case) -> set[str]:
    """Names of the parameters that a test of its kind can depend on."""
    slots = SLOTS[experiment.kind]
    laws = [law for law in case.model.all if law.slot in slots]
    return {name for law in laws for name in (*law.reads, *(q.name for q in law.parameters))}


def unknowns(campaign: Campaign) -> list[Unknown]:
    """What is looked for, by the campaign's plan or, where it leaves that open, by what its tests can see.

    Raises BadInput for a name that cannot be fitted, or if nothing is left.
    """
    plan, case = campaign.plan, campaign.base
    # A speed is known; a test of its own has one of its own.
    possible = [name for name in differentiable(case.model) if name != "speed"]
    seen = set().union(*(visible(e, case) for e in campaign.train))
    given = {name: e.id for e in campaign.train for name in (*e.blade, *e.specimen)}
    for key, names in (("free", plan.free or ()), ("own", plan.own)):
        for name in names:
            if name not in possible or name not in seen:
                known = [n for n in possible if n in seen]
                raise BadInput(
                    key=key, value=name, expected=f"a parameter of these tests: {', '.join(known)}"
                )
            if name in given:
                raise BadInput(
                    key=key,
                    value=name,
                    expected=f"a parameter that no experiment gives; '{given[name]}' does: take it out there",
                )
    for name in plan.fixed:
        if name not in case.model.parameters():
            raise BadInput(key="fixed", value=name, expected=one_of(name, possible))
    if plan.free is None:
        parameters = case.model.parameters()
        # Known beforehand, or better known otherwise.
        left_out = {n for n, q in parameters.items() if not q.sought} | given.keys() | set(plan.fixed)
        chosen = {name for name in possible if name in seen and name not in left_out}
    else:
        chosen = set(plan.free)
    found = []
    for name in possible:
        if name in plan.own:
            found += [_unknown(campaign, name, e.id) for e in campaign.train if name in visible(e, case)]
        elif name in chosen:
            found.append(_unknown(campaign, name, None))
    if not found:
        raise BadInput(
            key="free", value="(nothing)", expected=f"one parameter or more of {', '.join(possible)}"
        )
    return found


def _unknown(campaign: Campaign, name: str, experiment: str | None) -> Unknown:
    q = campaign.model.parameters()[name]
    low = -np.inf if q.low is None else q.low * q.factor
    high = np.inf if q.high is None else q.high * q.factor
    if name in campaign.plan.bounds:
        low, high = campaign.plan.bounds[name]
    start = min(max(campaign.base.values[name], low), high)
    if q.open_high and start == high:
        start = campaign.base.values[name]
    return Unknown(q, start, low, high, experiment)


class Inverse:
    """Residuals of a campaign's train experiments as a function of q (k,), the scaled unknowns."""

    def __init__(self, campaign: Campaign, looked_for: Sequence[Unknown], run: Predictor, grid: int = GRID):
        self.campaign, self.unknowns, self._run = campaign, list(looked_for), run
        self.grids = {e.id: e.on_grid(grid) for e in campaign.experiments}
        self.weights: dict[str, Weights] = {}
        #: Of the displacement fields of an experiment, where it has some.
        self.field_weights: dict[str, FieldWeights] = {}
        #: By kind of test, from its train experiments.
        self.factors = {
            kind: Factors.of([self.grids[e.id] for e in campaign.train if e.kind == kind])
            for kind in {e.kind for e in campaign.train}
        }
        self._known: dict[bytes, dict[str, Prediction]] = {}

    def keep(self, kept: Sequence[int]) -> np.ndarray:
        """Go on with the unknowns of these numbers alone, at their starts; what was computed there stays."""
        start = self._known.get(np.zeros(len(self.unknowns)).tobytes())
        self.unknowns = [self.unknowns[i] for i in kept]
        q = np.zeros(len(self.unknowns))
        self._known = {} if start is None else {q.tobytes(): start}
        return q

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        reach = np.array([u.reach for u in self.unknowns])
        return reach[:, 0], reach[:, 1]

    def base(self, q: np.ndarray, experiment: Experiment | None = None) -> Case:
        """The start case with the values at ``q``.

        Where each experiment has a value of its own: that of ``experiment``; the mean for one that was
        not fitted.
        """
        case = self.campaign.base
        values = dict(case.values)
        for name in dict.fromkeys(u.name for u in self.unknowns):
            mine = [(u, x) for u, x in zip(self.unknowns, q, strict=True) if u.name == name]
            of = [
                (u, x)
                for u, x in mine
                if u.experiment is None or (experiment and u.experiment == experiment.id)
            ]
            values[name] = float(np.mean([u.value(x) for u, x in of or mine]))
        return replace(case, values=values)

    def case(self, e: Experiment, q: np.ndarray) -> Case:
        base = self.base(q, e)
        return self.campaign.case(e, base) if e.kind == "cut" else base

    def predictions(self, q: np.ndarray) -> dict[str, Prediction]:
        """Of the train experiments, with slopes; computed once for each q. Raises ComputationFailed."""
        key = q.tobytes()
        if key not in self._known:
            try:
                cases = [self.case(e, q) for e in self.campaign.train]
            except BadInput as error:  # values that do not go together, which the fit has tried
                raise ComputationFailed(str(error)) from error
            tasks = [
                Task(e, case, self.grids[e.id], self.names(e))
                for e, case in zip(self.campaign.train, cases, strict=True)
            ]
            self._known[key] = dict(zip([e.id for e in self.campaign.train], self._run(tasks), strict=True))
        return self._known[key]

    def predicted(self, q: np.ndarray, experiments: Sequence[Experiment], *, fine: bool) -> list[Prediction]:
        """Of any experiments, without slopes; ``fine``: cuts with smaller elements and steps."""
        cases = [self.case(e, q) for e in experiments]
        cases = [finer(c) if fine and e.kind == "cut" else c for c, e in zip(cases, experiments, strict=True)]
        return self._run([Task(e, c, self.grids[e.id]) for e, c in zip(experiments, cases, strict=True)])

    def names(self, e: Experiment) -> tuple[str, ...]:
        """Of the unknowns that a test can depend on."""
        seen = visible(e, self.campaign.base)
        mine = [u.name for u in self.unknowns if u.name in seen and u.experiment in (None, e.id)]
        return tuple(dict.fromkeys(mine))

    def slopes(self, e: Experiment, prediction: Prediction, q: np.ndarray) -> np.ndarray:
        """dy/dq (m, k); of a cut no steeper than ``STEEP``."""
        J = self._derivatives(e, prediction, q)
        return J * self._gentle(e, J, prediction.y)[:, None]

    def _scaled(self, e: Experiment, prediction: Prediction, slopes: np.ndarray, q: np.ndarray) -> np.ndarray:
        """By the scaled unknowns (m, k) what is given by the prediction's names."""
        J = np.zeros((slopes.shape[0], len(self.unknowns)))
        for k, u in enumerate(self.unknowns):
            if u.name in prediction.names and u.experiment in (None, e.id):
                J[:, k] = slopes[:, prediction.names.index(u.name)] * u.slope(q[k])
        return J

    def _derivatives(self, e: Experiment, prediction: Prediction, q: np.ndarray) -> np.ndarray:
        J = self._scaled(e, prediction, prediction.slopes, q)
        if e.kind == "cut" and J.shape[1]:
            # Jags of the curve wander with the parameters: their derivatives are large and hold for no step.
            J = np.stack([smooth(along(self.grids[e.id]), column) for column in J.T], axis=1)
        return J

    @staticmethod
    def _gentle(e: Experiment, J: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Part (m,) of each reading's derivatives J (m, k) that counts."""
        if e.kind != "cut":
            return np.ones(y.size)
        limit = STEEP * np.abs(y).max()
        return np.minimum(1.0, limit / np.maximum(np.linalg.norm(J, axis=1), 1e-300))

    def _jumps(self, e: Experiment, prediction: Prediction, q: np.ndarray) -> np.ndarray:
        """Covariance (m, m) of a computed curve where it is too steep in the parameters to be trusted."""
        part = self._gentle(e, self._derivatives(e, prediction, q), prediction.y)
        return np.diag((1 - part**2) * (JUMP * np.abs(prediction.y).max()) ** 2)

    def guess_weights(self, q: np.ndarray) -> None:
        """From the readings, the curves at ``q`` and a guess of the computation's error."""
        found = self.predictions(q)
        for e in self.campaign.train:
            x = along(self.grids[e.id])
            error = self._jumps(e, found[e.id], q)
            if e.kind == "cut":
                error = error + guessed_error(x, found[e.id].y)
            self.weights[e.id] = Weights.of(self.grids[e.id], self.factors[e.kind], found[e.id].y, error)
            if e.fields:
                self.field_weights[e.id] = FieldWeights.of(e, found[e.id].fields)

    def measure_error(self, q: np.ndarray) -> list[str]:
        """Weights at ``q``, with the cuts computed on a finer mesh there; says what that found."""
        self.guess_weights(q)
        cuts = [e for e in self.campaign.train if e.kind == "cut"]
        if not cuts:
            return []
        coarse = self.predictions(q)
        try:
            fine = self.predicted(q, cuts, fine=True)
        except (ComputationFailed, BadInput) as error:
            return [f"The computation's own error is not known, 5 % were assumed: {error}"]
        notes = []
        for e, p in zip(cuts, fine, strict=True):
            grid, y = self.grids[e.id], coarse[e.id].y
            x = along(grid)
            shift = correction(x, y, p.y)
            part = 100 * np.sqrt(np.mean((p.y - y) ** 2)) / np.abs(y).max()
            notes.append(
                f"'{e.id}': finer numerics change the computed curve by {part:.1f} % of its"
                " maximum (root mean square); the fit allows for that."
            )
            error = measured_error(x, y, p.y) + self._jumps(e, coarse[e.id], q)
            self.weights[e.id] = Weights.of(grid, self.factors["cut"], y + shift, error, shift)
            if e.fields:
                self.field_weights[e.id] = FieldWeights.of(e, coarse[e.id].fields, p.fields)
        return notes

    def whitened(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (M,), computed less measured, and their derivatives (M, k)."""
        rows, slopes = [], []
        found = self.predictions(q)
        for e in self.campaign.train:
            p, w = found[e.id], self.weights[e.id]
            rows.append(w.white(p.y + w.shift - self.grids[e.id].mean))
            slopes.append(w.white(self.slopes(e, p, q)))
        # Fields last: what counts degrees of freedom by curves looks at the first rows.
        for e in self.campaign.train:
            if e.id in self.field_weights:
                w, p = self.field_weights[e.id], found[e.id]
                rows.append(w.white(p.fields - laid_out(e.fields)))
                slopes.append(w.white(self._scaled(e, p, p.field_slopes, q)))
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
