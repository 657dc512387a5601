"""A model fitted to a campaign, ready to be questioned: its curves, their derivatives, what it may be wrong
by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.calibration import lm
from cutbench.calibration.emulated import settled_at
from cutbench.calibration.fitted import Fit
from cutbench.calibration.fitting import fit
from cutbench.calibration.identifiability import Unknown, information_inverse
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Predictor
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.covariance import Covariance
from cutbench.data.discrepancy import allowing, likeliest, misfit
from cutbench.discovery.candidates import Candidate


@dataclass(frozen=True)
class Point:
    """The model of ``inverse`` at ``q`` (k,). ``y``: computed curves (m,) with ``shift`` for the mesh, by id
    of train experiments; ``J`` (m, k); ``tests``: predicted curves (m,) of test experiments by id;
    ``trouble``: why some could not be predicted. ``r``: whitened residuals (M,), computed less measured."""

    inverse: Inverse
    q: np.ndarray
    w: Covariance
    y: Mapping[str, np.ndarray]
    J: Mapping[str, np.ndarray]
    tests: Mapping[str, np.ndarray]
    trouble: tuple[str, ...]
    onset_mm: Mapping[str, float]
    #: Error of the mesh in test experiments, as far as it is known.
    test_shift: Mapping[str, np.ndarray]

    @property
    def campaign(self) -> Campaign:
        return self.inverse.campaign

    @property
    def case(self) -> Case:
        return self.inverse.base(self.q)

    @property
    def meshed(self) -> bool:
        return any(e.kind == "cut" for e in self.campaign.train)

    @property
    def residual(self) -> dict[str, np.ndarray]:
        """Computed less measured (m,) by id."""
        return {id: self.y[id] - self.inverse.grids[id].mean for id in self.w.tests}

    @cached_property
    def J_inside(self) -> dict[str, np.ndarray]:
        """``J`` without parameters at a bound: they take up nothing of what is beyond it."""
        inside = self.inverse.inside(self.q)
        return {id: J * inside for id, J in self.J.items()}

    @property
    def r(self) -> np.ndarray:
        return self.w.white(self.residual)

    @property
    def chi2(self) -> float:
        return float(self.r @ self.r)

    @cached_property
    def likelihood(self) -> float:
        """Twice the log likelihood of the train data, what the model misses at its likeliest."""
        return likeliest(self.w.noise, self.residual)

    @cached_property
    def reweighed(self) -> Covariance:
        """``w`` with what this model misses in place of what its baseline did."""
        return allowing(self.w.noise, self.residual, self.J_inside)

    @cached_property
    def misfit(self) -> dict[str, float]:
        """What the model misses of each curve, as a part of its largest value (root mean square), by id."""
        left, w = self.residual, self.reweighed
        return {id: misfit(w, id, left[id]) for id in w.tests}

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by label, internal units."""
        return {u.label: u.value(x) for u, x in zip(self.inverse.unknowns, self.q, strict=True)}

    def deviations(self) -> np.ndarray:
        """Standard deviation (k,) of q, not widened."""
        return np.sqrt(np.diag(information_inverse(self.w.white(self.J))))


def gathered(inverse: Inverse, q: np.ndarray, w: Covariance, shift: Mapping[str, np.ndarray]) -> Point:
    """The model of ``inverse`` at ``q``, in the covariance ``w``; ``shift`` by id of test experiments."""
    found = inverse.predictions(q)
    y = {e.id: found[e.id].y + w.tests[e.id].shift for e in inverse.campaign.train}
    J = {e.id: inverse.slopes(e, found[e.id], q) for e in inverse.campaign.train}
    tests, trouble, onset = {}, [], {id: p.onset_mm for id, p in found.items()}
    for e in inverse.campaign.test:
        try:
            (p,) = inverse.predicted(q, [e], fine=False)
        except (ComputationFailed, BadInput) as error:
            trouble.append(f"'{e.id}' could not be predicted: {error}")
            continue
        tests[e.id], onset[e.id] = p.y + shift.get(e.id, 0.0), p.onset_mm
    return Point(inverse, q, w, y, J, tests, tuple(trouble), onset, shift)


def point_of(fitted: Fit, run: Predictor) -> Point:
    """The model where a fit has left it: its problem, its answer, its covariance."""
    inverse, shift = fitted.inverse, {}
    curves = {c.experiment.id: c.fitted for c in fitted.compared}
    for e in fitted.campaign.test:
        if e.kind == "cut" and e.id in curves:
            (p,) = inverse.predicted(fitted.q, [e], fine=False)
            shift[e.id] = curves[e.id] - p.y
    meshed = any(e.kind == "cut" for e in fitted.campaign.train)
    there = settled_at(inverse, fitted.q, run) if meshed else inverse.moved(fitted.q, run)
    return gathered(there, np.zeros(fitted.q.size), fitted.data_covariance, shift)


def settled(point: Point, run: Predictor, refine: bool, on_progress: OnProgress) -> Point:
    """An extended model fitted as the baseline was, with a covariance of its own; for choosing between
    candidates that of the baseline and a few steps were enough.

    Raises KeyboardInterrupt.
    """
    on_progress(math.nan, math.nan, "fitting the extended model")

    def told(done: float, total: float, text: str) -> None:
        on_progress(done, total, f"extended model, {text}")

    try:
        return refitted(point, point.inverse.at(point.q), point.case, run, refine, told, near=True)
    except (ComputationFailed, BadInput) as error:
        on_progress(math.nan, math.nan, f"not fitted further: {error}")
        return point


def refitted(
    point: Point,
    looked_for: Sequence[Unknown],
    case: Case,
    run: Predictor,
    refine: bool = False,
    on_progress: OnProgress = silent,
    near: bool = False,
) -> Point:
    """Another model, ``case`` with the unknowns ``looked_for``, fitted to the data of ``point``.

    Raises ComputationFailed, BadInput, KeyboardInterrupt.
    """
    return point_of(fit_again(point, looked_for, case, run, refine, on_progress, near), run)


def fit_again(
    point: Point,
    looked_for: Sequence[Unknown],
    case: Case,
    run: Predictor,
    refine: bool = False,
    on_progress: OnProgress = silent,
    near: bool = False,
) -> Fit:
    """The fit that ``refitted`` makes. Raises as it does."""
    fitted = fit(
        point.campaign, refine=refine, run=run, looked_for=looked_for, start=case, grids=point.inverse.grids,
        on_progress=on_progress, near=near,
    )  # fmt: skip
    if fitted.status == lm.INTERRUPTED:
        raise KeyboardInterrupt
    return fitted


def new_strengths(before: Point, after: Point) -> list[bool]:
    """Of the unknowns of ``after``, which are strengths of what ``before`` has not."""
    known = {u.name for u in before.inverse.unknowns}
    return [u.name not in known and u.quantity.off is not None for u in after.inverse.unknowns]


def undetermined(point: Point, c: Candidate) -> bool:
    """Whether the data leave a shape of the candidate ``point`` was extended by open, by a factor of e or
    more."""
    names = {q.name for q in c.shapes}
    deviations = point.deviations()
    return any(
        u.name in names and d * (1 if u.logarithmic else u.scale / max(abs(u.start), 1e-300)) > 1
        for u, d in zip(point.inverse.unknowns, deviations, strict=True)
    )


def own_part(point: Point, c: Candidate) -> float:
    """The part of the computed train curves (root mean square) that the specimen makes where the candidate
    ``point`` was extended by is an error of the reading or a machine: without it, over with it. 1 of any
    other, and with a mesh."""
    if point.meshed or c.cause not in ("reading", "rig"):
        return 1.0
    off = {q.name: q.off_value for q in c.strengths}
    q = [
        u.q(off[u.name]) if u.name in off else x for u, x in zip(point.inverse.unknowns, point.q, strict=True)
    ]
    alone = point.inverse.predictions(np.array(q))
    size = [(np.sum(alone[id].y ** 2), np.sum(y**2)) for id, y in point.y.items()]
    return math.sqrt(sum(a for a, _ in size) / sum(b for _, b in size))
