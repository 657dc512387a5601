"""A model with a candidate added, fitted far enough to choose: what is accepted is fitted to the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import optimize

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration import by_work, lm, secant
from cutbench.calibration.emulated import Foreseeing
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.likely import likely
from cutbench.calibration.prediction import Prediction, Task
from cutbench.calibration.sparing import Sparing
from cutbench.calibration.survey import Survey
from cutbench.case.case import Case
from cutbench.discovery.anywhere import Looked, Shape
from cutbench.discovery.equivalent import by_formula, equivalent, strength_of
from cutbench.discovery.point import Point, gathered
from cutbench.discovery.score import Score
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import Mechanism

#: Fits without a mesh go to the bottom; with one, far enough to choose.
SMOOTH = lm.Settings(promise=0.05, evaluations=15, failures=5)
MESHED = lm.Settings(promise=0.3, evaluations=5, failures=2)
#: Parts of the score's step that a fit may start from.
PARTS, PARTS_MESHED = (1.0, 0.5, 0.2, 0.05), (1.0, 0.5)
#: How far away, in q, places of each test are computed to see what a law does: in its own values and in those
#: of the others; how many.
SHAPED, BESIDE, LOOKED = 1.0, 0.3, 4
#: So often a law's strength is corrected by what it did.
CORRECTED = 3
#: Strengths that are smaller, in typical ones, are none.
NOTHING = 1e-3


@dataclass(frozen=True)
class Place:
    """Where candidates are asked, and begin: ``shared`` unknowns, and what single tests have in their stead.

    ``inverse`` at ``q`` (k,) has the tests' own values, ``S`` (k, n) is 1 where one of them stands for one of
    the n shared. ``residual``: what the shared values leave by the derivatives there, (m,) by id."""

    inverse: Inverse
    q: np.ndarray
    S: np.ndarray
    shared: Sequence[Unknown]
    residual: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, point: Point) -> Place:
        """The point itself."""
        shared = point.inverse.at(point.q)
        return cls(point.inverse, point.q, np.eye(len(shared)), shared, point.residual)

    @property
    def apart(self) -> bool:
        """Whether tests have values of their own."""
        return len(self.S) > len(self.shared)

    @property
    def owned(self) -> str:
        """Of which parameter tests have values of their own."""
        return self.shared[int(np.argmax(self.S.sum(axis=0)))].name if self.apart else ""

    @property
    def case(self) -> Case:
        """With the shared values; where tests have their own, with the mean of these."""
        case = self.inverse.base(self.q)
        shared = {u.name: u.start for u in self.shared if u.experiment is None}
        return replace(case, values={**case.values, **shared})

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """Of each test (id), by label of the shared unknown."""
        mine, found = self.inverse.values(self.q), {}
        for e in self.inverse.campaign.train:
            own = np.array([u.experiment in (None, e.id) for u in self.inverse.unknowns])
            rows = [np.flatnonzero(own & (column > 0)) for column in self.S.T]
            found[e.id] = {
                u.label: float(mine[at[0]]) if at.size else u.start
                for u, at in zip(self.shared, rows, strict=True)
            }
        return found


def _unknowns(point: Point, score: Score, shapes: bool) -> list[Unknown]:
    """The candidate's parameters, from where the score puts them."""
    c, new = score.column.candidate, []
    strengths = score.strengths
    if point.meshed and c.slot == "rig":
        # Foreseen anywhere: the unit is what is usual, not the score's, where the model ended.
        strengths = np.array([q.typical * q.factor for q in c.strengths])
    starts = [q.off_value + value for q, value in zip(c.strengths, strengths, strict=True)]
    starts += [score.column.shapes[q.name] for q in c.shapes] if shapes else []
    for q, start in zip(c.parameters, starts, strict=False):
        low, high = point.campaign.plan.bounds.get(q.name, q.bounds)
        kind = Shape if q in c.shapes and low > 0 else Unknown
        u = kind(q, float(np.clip(start, low, high)), low, high)
        new.append(replace(u, start=u.value(0.0)))  # off a bound that is open
    return new


def extend(
    point: Point,
    score: Score,
    *,
    shapes: bool = True,
    place: Place | None = None,
    looked: Looked | None = None,
) -> Point:
    """The model with a candidate added, fitted from the step of the score on, which ``place`` was asked for,
    or from where it was ``looked`` at.

    ``shapes`` False: those of the score are kept. Raises ComputationFailed where nothing can be computed.
    """
    place = place or Place.of(point)
    if looked is not None:
        return gathered(*looked.extended(point.w.noise), point.w, point.test_shift)
    if point.meshed:
        return _by_work(point, place, score)
    inverse, _ = _extended(point, place, score, shapes)
    return _again(_by_score(point, inverse, score))


def _extended(
    point: Point, place: Place, score: Score, shapes: bool = True
) -> tuple[Inverse, Mapping[str, float]]:
    """The problem of the extended model, and what switches the candidate off."""
    new = _unknowns(point, score, shapes)
    model, off = place.case.model.extended(*score.column.candidate.added)
    values = {**place.case.values, **off, **score.column.shapes, **{u.name: u.start for u in new}}
    case = replace(place.case, mechanisms=model.mechanisms, values=values)
    return point.inverse.other([*place.shared, *new], case), off


def _by_score(point: Point, inverse: Inverse, score: Score) -> Point:
    def residual(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return inverse.whitened(q, point.w)

    low, high = inverse.bounds
    q, r, J = _begun(inverse, score, residual, PARTS)
    found = lm.minimise(residual, q, low, high, SMOOTH, first=(r, J))
    if found.message == lm.INTERRUPTED:
        raise KeyboardInterrupt
    return gathered(inverse, found.q, point.w, point.test_shift)


def _begun(
    inverse: Inverse, score: Score, residual: lm.Residual, parts: Sequence[float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best start of those ``parts`` of the score's step, with what is left there and its derivatives."""
    best, reason = None, ""
    for part in parts:
        q = _start(inverse, score, part)
        try:
            r, J = residual(q)
        except (ComputationFailed, BadInput) as error:
            reason = str(error)
            continue
        if best is not None and not r @ r < best[1] @ best[1]:
            break
        best = q, r, J
    if best is None:
        raise ComputationFailed(reason)
    return best


def _start(inverse: Inverse, score: Score, part: float) -> np.ndarray:
    """The ``part`` of a score's step in the unknowns (k,), shapes where they are."""
    low, high = inverse.bounds
    q = np.zeros(low.size)
    q[: score.free.size] = np.clip(part * score.free, -1.0, 1.0)
    rest = inverse.unknowns[score.free.size :]
    strengths = score.column.candidate.strengths
    for i, (u, s, value) in enumerate(zip(rest, strengths, score.strengths, strict=False), score.free.size):
        q[i] = u.q(float(np.clip(s.off_value + part * value, u.low, u.high)))
    return np.clip(q, low, high)


def _by_work(point: Point, place: Place, score: Score) -> Point:
    """Of cuts: a score's step moves drops, and forces lead on from there to the nearest minimum, so the step
    is the one by the works, and these come first; where cuts have values of their own, these know it."""
    inverse, off = _extended(point, place, score)
    if not place.apart:
        score = _stepped(Sparing(inverse, *_at_off(place, score, off)), score)
        inverse, off = _extended(point, place, score)
    if (foreseen := _foreseen(point, place, inverse, score)) is not None:
        return foreseen
    inverse = Sparing(inverse, *_at_off(place, score, off))
    difference = partial(by_work.difference, inverse)
    low, high = inverse.bounds
    q, r, J = _begun(inverse, score, difference, PARTS_MESHED)
    if names := [s.name for s in score.column.candidate.shapes]:
        # Of its shapes nothing was known where it did nothing.
        inverse.know(q, secant.across(inverse, q, inverse.predictions(q), names))
        r, J = difference(q)
    found = lm.minimise(difference, q, low, high, replace(MESHED, enough=0.3), first=(r, J))
    if found.message != lm.INTERRUPTED:
        found = lm.minimise(lambda q: inverse.whitened(q, point.w), found.q, low, high, MESHED)
    if found.message == lm.INTERRUPTED:
        raise KeyboardInterrupt
    return gathered(inverse, found.q, point.w, point.test_shift)


def _foreseen(point: Point, place: Place, inverse: Inverse, score: Score) -> Point | None:
    """The extended model where its data are likeliest of what is foreseen; None where nothing can be."""
    c, start, off = score.column.candidate, _start(inverse, score, 1.0), _start(inverse, score, 0.0)
    survey = Survey(inverse, [start, off])
    if not survey.problem.emulable:
        return None
    if c.slot != "rig":
        law = registry().get(c.name) if place.apart else None
        said = law is not None and place.owned in law.like(inverse.base(start).p)
        if place.apart and (said or len(c.strengths) == 1) and Foreseeing(place.inverse).able:
            start = _equivalent(place, inverse, start, score.free.size, law if said else None)
        survey = Survey(inverse, [start, off])
        if not said:
            # What its strength and shapes do is not known from runs that lack it.
            reach = np.where(np.arange(start.size) < score.free.size, BESIDE, SHAPED)
            reach[~survey.free] = 0.0
            survey.around(start, reach, LOOKED)
            # There alone: where the law does next to nothing all is known, and nothing new.
            low, high = inverse.bounds
            survey.within = np.maximum(survey.low - BESIDE, low), np.minimum(survey.high + BESIDE, high)
    if not survey.problem.able:
        return None
    least = likely(point.inverse, point.w.noise, point.q)
    q = survey.likeliest(point.w.noise, start, least=least)
    return gathered(survey.problem, q, point.w, point.test_shift)


def _equivalent(
    place: Place, inverse: Inverse, start: np.ndarray, strength: int, law: Mechanism | None
) -> np.ndarray:
    """``start`` (k,) with the shared value and the strength, the unknown of that number, with which the law
    does what the cuts' own values do: by the word of ``law``, or by its runs."""
    train, j = inverse.campaign.train, [u.name for u in place.shared].index(place.owned)
    column = place.S[:, j] > 0
    own = {u.experiment: i for i, u in enumerate(place.inverse.unknowns) if column[i] and u.experiment}
    wanted = np.array([place.inverse.unknowns[i].value(place.q[i]) for i in own.values()])
    if law is not None:
        each = [inverse.checked_case(e, start).p for e in train if e.id in own]
        mine, there = [j, *range(strength, start.size)], start.copy()
        there[mine] = by_formula(law, wanted, each, [inverse.unknowns[i] for i in mine], start[mine])
        return there
    s, start = inverse.unknowns[strength], start.copy()
    start[strength] = something(s, start[strength])
    for _ in range(CORRECTED):
        tasks = [Task(e, inverse.checked_case(e, start), inverse.grids[e.id]) for e in train]
        found = {e.id: p for e, p in zip(train, secant.tried(inverse, tasks), strict=True) if p}
        if len(found) < len(train):
            break
        equal = equivalent(Foreseeing(place.inverse), place.q, own, found)
        u = inverse.unknowns[j]
        values = strength_of(wanted, equal, u.value(start[j]), s.value(start[strength]))
        start = start.copy()
        start[j], start[strength] = (np.clip(x.q(v), *x.reach) for x, v in zip((u, s), values, strict=True))
    return start


def something(u: Unknown, q: float) -> float:
    """``q`` of a strength, or that of its typical value where it is nothing: of a law that does nothing runs
    tell nothing."""
    typical = u.quantity.typical * u.quantity.factor
    nothing = abs(u.value(q) - u.quantity.off_value) < NOTHING * abs(typical)
    return float(np.clip(u.q(typical), *u.reach)) if nothing else q


def _stepped(inverse: Sparing, score: Score) -> Score:
    """``score`` with the step that makes the works' difference least, by what is known without a run; as it
    is where that switches the candidate off."""
    q, c, k = _start(inverse, score, 0.0), score.column.candidate, score.free.size
    r, J = by_work.compared(inverse, inverse.carried(q), q)
    low, high = (bound[: k + len(c.strengths)] for bound in inverse.bounds)
    size = len(low)
    low[:k], high[:k] = np.clip(low[:k], -1.0, 0.0), np.clip(high[:k], 0.0, 1.0)
    room = 1e-9
    step = optimize.lsq_linear(J[:, :size], -r, (low - q[:size] - room, high - q[:size] + room)).x
    there = q.copy()
    there[:size] += step
    new = list(zip(inverse.unknowns[k:size], there[k:size], c.strengths, strict=True))
    strengths = np.array([u.value(x) - s.off_value for u, x, s in new])
    typical = np.array([s.typical * s.factor for s in c.strengths])
    if np.all(np.abs(strengths) < NOTHING * np.abs(typical)):
        return score
    return replace(score, free=step[:k], strengths=strengths)


def _at_off(
    place: Place, score: Score, off: Mapping[str, float]
) -> tuple[dict[str, dict[str, float]], dict[str, Prediction]]:
    """Values of all unknowns by id and label where the candidate does nothing, and the curves by id with the
    slopes that the score has: none of its shapes."""
    c = score.column.candidate
    strengths, shapes = [q.name for q in c.strengths], [q.name for q in c.shapes]
    new = {q.name: q.off_value for q in c.strengths}
    new |= {name: score.column.shapes.get(name, off.get(name, 0.0)) for name in shapes}
    found = {}
    for id, p in place.inverse.predictions(place.q).items():
        columns, none = score.column.by[id], np.zeros((p.y.size, len(shapes)))
        fields = np.zeros((p.fields.size, len(strengths) + len(shapes)))
        found[id] = replace(
            p, names=(*p.names, *strengths, *shapes), slopes=np.hstack([p.slopes, columns, none]),
            field_slopes=np.hstack([p.field_slopes, fields]) if p.fields.size else p.field_slopes,
        )  # fmt: skip
    return {id: {**values, **new} for id, values in place.values.items()}, found


def _again(point: Point) -> Point:
    """Fitted in the covariance that its own misfit leaves: what explains more can be told more exactly."""
    w, inverse = point.reweighed, point.inverse
    low, high = inverse.bounds
    found = lm.minimise(lambda q: inverse.whitened(q, w), point.q, low, high, SMOOTH)
    if found.message == lm.INTERRUPTED:
        raise KeyboardInterrupt
    made = gathered(inverse, found.q, w, point.test_shift)
    return made if made.likelihood > point.likelihood else point
