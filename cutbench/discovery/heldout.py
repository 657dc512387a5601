"""Does the extended model predict better what neither fit has seen? By how much, and how sure is that?

What is held out: experiments of role test, where there are any and they can tell; else one train experiment
after the other where three or more remain that still determine everything, else one repetition of each
experiment after the other, and of a test with a single repetition one fifth of its readings after the
other. Fits without the held-out part are one Gauss–Newton step away from the fit to all.

Two losses. The likelihood's, |r|² in standard deviations of noise and of what the better model misses,
decides: its difference between two models is linear in the readings, so that its standard error is known, 2
|d| with d the whitened difference of their predictions. The plain root mean square error is what a person
asks for, and is reported as the gain; it must not contradict, as it is or with each test's own factor
between specimens taken out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import lsq_linear

from cutbench.data.covariance import Block, Factors
from cutbench.data.discrepancy import SIZES, Discrepancies
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Averaged
from cutbench.discovery.point import Point, new_strengths

#: A parameter that the rest of the data knows worse than this (in q) is not determined by it.
LOST = 0.5
FEWEST_TESTS, FIFTHS = 3, 5
TESTS = "test experiments"
#: Predictions that differ by less than a standard deviation in all (2 |d|) tell nothing.
TELLING = 2.0
#: Less of a test's largest value is no change.
SHOWS = 1e-3


@dataclass(frozen=True)
class HeldOutPart:
    """Readings (m,) held out, their covariance (m, m) with what both models miss and that of their ``noise``
    alone, the deviation (m,) that this makes, and the value that errors are taken relative to."""

    experiment: Experiment
    measured: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    deviation: np.ndarray
    size: float


@dataclass(frozen=True)
class Heldout:
    """``better``: fall of the whitened squared error by the extension, ``better_se`` its standard error.

    ``gain``: fall of the root mean square error, relative, with its standard error; errors in ``unit``.
    ``gain_of_shape``: the same with the factor that fits each specimen best taken out of both predictions.
    """

    how: str
    better: float
    better_se: float
    gain: float
    gain_se: float
    baseline_rmse: float
    extended_rmse: float
    noise_floor: float
    unit: str
    gain_of_shape: float = 0.0

    @property
    def beyond_scatter(self) -> float:
        """The gain on what scatter and noise do not explain; nan where they explain the baseline's error."""
        wrong, left = (e**2 - self.noise_floor**2 for e in (self.baseline_rmse, self.extended_rmse))
        return 1 - math.sqrt(max(left, 0.0) / wrong) if wrong > 0 else math.nan

    @property
    def percent(self) -> str:
        return f"{100 * self.gain:+.0f} ± {100 * self.gain_se:.0f} %"

    @property
    def accepted(self) -> bool:
        return self.better > self.better_se and max(self.gain, self.gain_of_shape) > 0

    @property
    def worse(self) -> bool:
        """Whether the plain error grows by more than its standard error, with or without the factor."""
        return max(self.gain, self.gain_of_shape) < -self.gain_se

    @property
    def tells(self) -> bool:
        """Whether the two models' predictions differ at all and by more than the standard error of the
        difference, and the likelihood and the plain error do not contradict one another within theirs."""
        plain = max(self.gain, self.gain_of_shape)
        contradict = self.better > 0 >= plain > -self.gain_se
        return self.better_se > TELLING and abs(self.better) > self.better_se and not contradict


def decide(before: Point, after: Point) -> Heldout:
    """By the test experiments; where there are none, or they cannot tell the two models apart, by what is
    left out of the fitted ones.

    A drop that comes a little early or late counts for more in a cut's likelihood than all the rest of it:
    where that says worse and the plain error surely better, they do not tell. Nor do they where the extension
    does nothing in them, and only the other parameters' values differ.
    """
    by_tests = compare(before, after)
    if by_tests.how != TESTS:
        return by_tests
    jags = before.meshed and by_tests.better < 0 < by_tests.gain - by_tests.gain_se
    if ((by_tests.tells and not jags) or by_tests.worse) and _shows(before, after):
        return by_tests
    return compare(before, after, tests=False)


def _shows(before: Point, after: Point) -> bool:
    """Whether what ``after`` has more than ``before`` changes its predictions of the test experiments. With a
    mesh that is not asked: it would take runs."""
    new = new_strengths(before, after)
    if before.meshed or not any(new):
        return True
    unknowns = zip(after.inverse.unknowns, after.q, new, strict=True)
    q = np.array([u.q(u.quantity.off_value) if off else x for u, x, off in unknowns])
    for e in after.campaign.test:
        if (y := after.tests.get(e.id)) is None:
            continue
        (off,) = after.inverse.predicted(q, [e], fine=False)
        change = y - off.y - after.test_shift.get(e.id, 0.0)
        if np.abs(change).max() > SHOWS * np.abs(y).max():
            return True
    return False


def compare(before: Point, after: Point, *, tests: bool = True) -> Heldout:
    """The prediction of held-out readings by two fitted models; ``tests`` False: not of test experiments."""
    parts, one, other, how = _tests(before, after) if tests else ([], [], [], "")
    if not parts:
        parts, one, other, how = _folds(before, after)
    better = variance = 0.0
    plain = np.zeros(4)  # squared error of both, the variance of their difference, noise
    shape = np.zeros(2)  # squared error of both with the best factor
    count = 0
    units = {p.experiment.y_unit for p in parts}
    relative = len(units) > 1
    for p, y0, y1 in zip(parts, one, other, strict=True):
        L = cholesky(p.covariance, lower=True)
        r0, r1 = (solve_triangular(L, y - p.measured, lower=True) for y in (y0, y1))
        better += r0 @ r0 - r1 @ r1
        variance += 4 * (r0 - r1) @ (r0 - r1)
        d, scale = y1 - y0, p.size if relative else 1.0
        plain += np.array([
            ((y0 - p.measured) ** 2).sum(), ((y1 - p.measured) ** 2).sum(),
            4 * d @ p.noise @ d / scale**2, (p.deviation**2).sum(),
        ]) / scale**2  # fmt: skip
        shape += np.array([_beyond_factor(y, p.measured) for y in (y0, y1)]) / scale**2
        count += p.measured.size
    e0, e1 = np.sqrt(plain[:2] / count)
    gain = 1 - e1 / e0 if e0 > 0 else 0.0
    se = np.sqrt(plain[2]) / plain[0] / (2 * max(1 - gain, 0.2)) if e0 > 0 else 0.0
    return Heldout(
        how, float(better), float(np.sqrt(variance)), float(gain), float(se), float(e0), float(e1),
        float(np.sqrt(plain[3] / count)), "1" if relative else units.pop(),
        float(1 - np.sqrt(shape[1] / shape[0])) if shape[0] > 0 else 0.0,
    )  # fmt: skip


def _beyond_factor(y: np.ndarray, measured: np.ndarray) -> float:
    """Squared error of the prediction ``y`` (m,) times the factor that makes it least."""
    return float(((measured - y * (y @ measured) / max(y @ y, 1e-300)) ** 2).sum())


def _pooled(point: Point) -> dict[str, Factors]:
    grids: dict[str, list[Averaged]] = {}
    for e in point.campaign.experiments:
        grids.setdefault(e.kind, []).append(point.inverse.grids[e.id])
    return {kind: Factors.of(of_kind).usual for kind, of_kind in grids.items()}


def expected(point: Point, e: Experiment) -> Block:
    """Covariance of the mean of a test experiment's readings about what a right model predicts."""
    grid = point.inverse.grids[e.id]
    return Block.of(grid, _pooled(point)[e.kind], grid.mean)


def _tests(before: Point, after: Point):
    both = [e for e in before.campaign.test if e.id in before.tests and e.id in after.tests]
    one, other = ([point.tests[e.id] for e in both] for point in (before, after))
    parts = []
    for e, *predicted in zip(both, one, other, strict=True):
        grid = before.inverse.grids[e.id]
        parts.append(_part(e, grid.mean, _missing(expected(before, e), grid, predicted)))
    return parts, one, other, TESTS


def _missing(noise: Block, grid: Averaged, predicted: Sequence[np.ndarray]) -> Block:
    """``noise`` with what the better of two models misses: what both miss tells neither from the other."""
    tried = Discrepancies(noise, grid)
    gains = tried.gains(np.stack([y - grid.mean for y in predicted], axis=1))
    return noise.allowing(tried.covariance(float(SIZES[gains.argmax(axis=0)].min())))


def _part(e: Experiment, mean: np.ndarray, C: Block) -> HeldOutPart:
    return HeldOutPart(e, mean, C.total, C.noise, C.deviation, float(np.abs(mean).max()))


def _folds(before: Point, after: Point):
    train = sorted(before.campaign.train, key=lambda e: e.id)
    pooled, parts, ways = _pooled(before), [], []
    one: list[np.ndarray] = []
    other: list[np.ndarray] = []
    for e in train:
        grid = before.inverse.grids[e.id]
        every, mean = np.arange(grid.x.size), grid.mean
        # Of each fold: the curve, its readings that are held out, those that are kept, the mean of these.
        if len(train) >= FEWEST_TESTS and _determined(before, e.id) and _determined(after, e.id):
            count, way, folds = None, "one experiment", [(mean, every, every[:0], mean)]
        elif grid.repetitions > 1:
            count, way = 1, "one repetition"
            rests = [np.delete(grid.curves, k, axis=0).mean(axis=0) for k in range(grid.repetitions)]
            folds = [(curve, every, every, rest) for curve, rest in zip(grid.curves, rests, strict=True)]
        else:
            count, way = 1, "one fifth of the readings"
            gaps = np.array_split(every, FIFTHS)
            folds = [(mean, gap, np.setdiff1d(every, gap), mean) for gap in gaps]
        C, size = Block.of(grid, pooled[e.kind], mean, count=count), float(np.abs(mean).max())
        C = _missing(C, grid, [point.y[e.id] for point in (before, after)])
        for curve, out, kept, rest in folds:
            total, noise = (part[np.ix_(out, out)] for part in (C.total, C.noise))
            parts.append(HeldOutPart(e, curve[out], total, noise, C.deviation[out], size))
            for point, into in ((before, one), (after, other)):
                into.append(_without(point, e.id, kept, rest)[out])
        ways.append(f"{way} after the other")
    return parts, one, other, " and ".join(dict.fromkeys(ways))


def _information(white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """JᵀJ and Jᵀr of whitened derivatives with the residual as their last column."""
    return white[:, :-1].T @ white[:, :-1], white[:, :-1].T @ white[:, -1]


def _others(point: Point, skip: str) -> tuple[np.ndarray, np.ndarray]:
    """JᵀJ and Jᵀr of all train experiments but one."""
    A, g = np.zeros((point.q.size, point.q.size)), np.zeros(point.q.size)
    for id, w in point.w.tests.items():
        if id != skip:
            more = _information(w.white(np.column_stack([point.J[id], point.residual[id]])))
            A, g = A + more[0], g + more[1]
    return A, g


def _determined(point: Point, id: str) -> bool:
    A, _ = _others(point, id)
    size = np.sqrt(np.diag(A))
    if np.any(size <= 0):
        return False
    covariance = np.linalg.pinv(A / np.outer(size, size), rcond=1e-10) / np.outer(size, size)
    return bool(np.all(np.sqrt(np.diag(covariance)) < np.maximum(LOST, 2 * point.deviations())))


def _without(point: Point, id: str, kept: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Prediction (m,) of experiment ``id`` by a fit that has seen only its readings ``kept``, with ``rest``
    (m,) as their mean."""
    (A, g), J = _others(point, id), point.J[id]
    if kept.size:
        L = cholesky(point.w.tests[id].total[np.ix_(kept, kept)], lower=True)
        both = np.column_stack([J, point.y[id] - rest])
        more = _information(solve_triangular(L, both[kept], lower=True))
        A, g = A + more[0], g + more[1]
    # What the rest does not determine stays about where it is: q is not known to change by more than 1.
    low, high = (bound - point.q for bound in point.inverse.bounds)
    return point.y[id] + J @ within(A + np.eye(g.size), g, low, high)


def within(A: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step (k,) between ``low`` and ``high`` that makes ½ sᵀ A s + gᵀ s least, A positive definite.

    One that a bound stops changes where the others go: cutting the free step off at the bounds would leave
    them where they only belong beside it.
    """
    L = cholesky(A, lower=True)
    free = cho_solve((L, True), -g)
    if np.all((low <= free) & (free <= high)):
        return free
    return lsq_linear(L.T, L.T @ free, (low, high), method="bvls").x


def better_than(one: Point, other: Point) -> Sequence[float]:
    """Fall of χ² of the train data from ``one`` to ``other``, with what ``other`` misses in their covariance,
    and its standard error 2 |d|."""
    w = other.reweighed
    a, b = (w.white(point.residual) for point in (one, other))
    return float(a @ a - b @ b), float(2 * np.linalg.norm(a - b))
