"""The gain on clean curves: what would test experiments read without noise and scatter between specimens?

What two models are off by there is what a person wants to know, and no difference between models and readings
says it: those hold the noise, and the factors of the specimens that happened to be tested. So the clean
curves f of all test experiments are estimated together from what is known of them,

    f = y + J dq + d,    readings = f (1 + a) + b + e,

with y the extended model's prediction, dq what its fit leaves open, d a smooth discrepancy of unknown size
and the scatter and noise of ``cutbench.data.covariance``. The variance of the factors a and the sizes of d
are drawn from what is known of them beforehand, f from its Gaussian distribution given the readings, by
Matheron's rule; each draw counts by how likely it makes the readings. The gain has its median and interval
from there: the few specimens of a campaign leave much of it open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, cholesky

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.identifiability import information_inverse
from cutbench.calibration.posterior import Estimated
from cutbench.data.covariance import (
    DISCREPANCY_LENGTH,
    RELATIVE_SIZES,
    Block,
    Factors,
    matern,
    positive_definite,
)
from cutbench.data.repetition import Averaged

#: Sizes of a discrepancy, and their probabilities beforehand: a quarter for none, else any up to 0.3.
SIZES = RELATIVE_SIZES[RELATIVE_SIZES <= 0.3]
PRIOR = np.append(0.25, np.full(SIZES.size - 1, 0.75 / (SIZES.size - 1)))
#: Gains that differ by less are the same to a person.
NEAR = 0.1


@dataclass(frozen=True)
class NoiseFreeGain:
    """Fall of the root mean square error against clean curves, relative: median and interval; ``near``: the
    chance that the median is off by less than 10 points."""

    value: float
    low: float
    high: float
    near: float

    @property
    def text(self) -> str:
        return f"{100 * self.value:.0f} % ({100 * self.low:.0f} to {100 * self.high:.0f} %)"


@dataclass(frozen=True)
class PredictedTest:
    """Of one test: readings' ``mean`` (m,), its ``before`` and ``after`` by both models, ``J`` (m, k) of the
    second, covariance of the mean without factors ``rest`` (m, m), Matérn ``correlation`` (m, m), number of
    ``repetitions``, ``kind`` and the ``size`` that errors are taken relative to; whether the values are
    ``independent`` measures."""

    mean: np.ndarray
    before: np.ndarray
    after: np.ndarray
    J: np.ndarray
    rest: np.ndarray
    correlation: np.ndarray
    repetitions: int
    kind: str
    size: float
    independent: bool = False

    @property
    def scale(self) -> float:
        return float(np.abs(self.mean).max())

    def by_factor(self, variance: float) -> np.ndarray:
        if self.independent:
            return np.zeros(self.rest.shape)
        return variance / self.repetitions * np.outer(self.after, self.after)


@dataclass(frozen=True)
class Evidence:
    """The ``tests`` that clean curves are wanted of, those that were fitted (``train``, with what the model
    misses in ``rest``), and the factors of each kind."""

    tests: Sequence[PredictedTest]
    train: Sequence[PredictedTest]
    factors: dict[str, Factors]


def noise_free_gain(before: Estimated, after: Estimated, seed: int = 0) -> NoiseFreeGain | None:
    """The gain on the clean curves of the tests that are predicted."""
    evidence = gather_evidence(before, after)
    return None if evidence is None else gain_from_draws(evidence, np.random.default_rng(seed))


def gather_evidence(before: Estimated, after: Estimated) -> Evidence | None:
    """What is known of the clean curves; None without any."""
    p = after.posterior.predictions
    every = p.campaign.experiments
    factors = {kind: Factors.of([p.grids[e.id] for e in every if e.kind == kind]).usual
               for kind in dict.fromkeys(e.kind for e in every)}  # fmt: skip
    relative = len({e.y_unit for e in p.campaign.test}) > 1
    tests, train = [], []
    for e in p.campaign.test:
        grid = p.grids[e.id]
        try:
            said, one, J = after.predicted(e), before.predicted(e).y, after.scaled_slopes(e)
        except ComputationFailed:
            continue
        rest = Block.of(grid, Factors(), said.y).total + said.root @ said.root.T
        size = float(np.abs(grid.mean).max()) if relative else 1.0
        tests.append(_predicted_test(grid, one, said.y, J, rest, e.kind, size))
    inside = after.posterior.inside(after.q)
    for e in after.posterior.tests if tests else ():
        grid, y, w = p.grids[e.id], after.at.y[e.id], after.w.tests[e.id]
        J = after.at.J[e.id] * inside
        train.append(_predicted_test(grid, before.at.y[e.id], y, J, w.total - w.by_factor, e.kind, 1.0))
    return Evidence(tests, train, factors) if tests else None


def _predicted_test(grid: Averaged, before, after, J, rest, kind: str, size: float) -> PredictedTest:
    course = grid.course
    correlation = matern(np.abs(course[:, None] - course), DISCREPANCY_LENGTH)
    return PredictedTest(
        grid.mean, before, after, J, rest, correlation, grid.repetitions, kind, size, grid.independent
    )


def gain_from_draws(evidence: Evidence, rng: np.random.Generator, draws: int = 1000) -> NoiseFreeGain:
    tests = evidence.tests
    roots = [cholesky(positive_definite(t.correlation), lower=True) * t.scale for t in tests]
    rest = [cholesky(positive_definite(t.rest), lower=True) for t in tests]
    J = np.vstack([t.J for t in tests])
    off = np.concatenate([t.mean - t.after for t in tests])
    apart = np.concatenate([(t.before - t.after) / t.size for t in tests])
    size = np.concatenate([np.full(t.mean.size, t.size) for t in tests])
    usual = {kind: f.variance for kind, f in evidence.factors.items()}
    chances = [
        _size_probabilities(t, t.J @ _root_of_fit_covariance(evidence.train, usual), usual[t.kind])
        for t in tests
    ]
    gains, likely = np.zeros(draws), np.zeros(draws)
    for k in range(draws):
        # One that each factor may have, by how well it is known.
        variance = {
            kind: f.dof * f.variance / float(rng.chisquare(f.dof)) for kind, f in evidence.factors.items()
        }
        which = [rng.choice(SIZES.size, p=chance) for chance in chances]
        d = SIZES[which]
        # What is drawn more often than it was expected beforehand counts by less.
        likely[k] = sum(np.log(PRIOR[i] / chance[i]) for i, chance in zip(which, chances, strict=True))
        root = _root_of_fit_covariance(evidence.train, variance)
        K = J @ root
        K = K @ K.T + block_diag(*((s * t.scale) ** 2 * t.correlation for s, t in zip(d, tests, strict=True)))
        V = block_diag(*(t.rest + t.by_factor(variance[t.kind]) for t in tests))
        both = cho_factor(positive_definite(K + V), lower=True)
        normal = rng.standard_normal
        f = J @ (root @ normal(root.shape[1]))
        f += np.concatenate([s * (L @ normal(len(L))) for s, L in zip(d, roots, strict=True)])
        noise = np.concatenate([
            L @ normal(len(L)) + np.sqrt(variance[t.kind] / t.repetitions) * normal() * t.after
            for L, t in zip(rest, tests, strict=True)
        ])  # fmt: skip
        f += K @ cho_solve(both, off - f - noise)
        wrong, left = (float(np.linalg.norm(each)) for each in (f / size - apart, f / size))
        gains[k] = 1 - left / max(wrong, 1e-300)
        likely[k] += -off @ cho_solve(both, off) / 2 - np.log(np.diag(both[0])).sum()
    weight = _tempered_weights(likely)
    order = np.argsort(gains)
    low, value, high = np.interp([0.05, 0.5, 0.95], np.cumsum(weight[order]), gains[order])
    near = weight[np.abs(gains - value) < NEAR].sum()
    return NoiseFreeGain(float(value), float(low), float(high), float(near))


def _size_probabilities(t: PredictedTest, moved: np.ndarray, variance: float) -> np.ndarray:
    """Of each possible size of the discrepancy of one test by itself; none is ruled out."""
    rest, off = t.rest + t.by_factor(variance) + moved @ moved.T, t.mean - t.after
    likely = np.log(PRIOR)
    for i, s in enumerate(SIZES):
        L = cho_factor(positive_definite(rest + (s * t.scale) ** 2 * t.correlation), lower=True)
        likely[i] += -off @ cho_solve(L, off) / 2 - np.log(np.diag(L[0])).sum()
    chance = np.exp(likely - likely.max())
    return 0.9 * chance / chance.sum() + 0.1 * PRIOR


def _tempered_weights(likely: np.ndarray) -> np.ndarray:
    """Of draws, 1 in all. Where fewer than some fifty would have it all they are made more alike, so that
    what is not known well is not said to be."""
    power = 1.0
    while True:
        weight = np.exp(power * (likely - likely.max()))
        weight = weight / float(weight.sum())
        if 1 / float(weight @ weight) >= min(50, likely.size / 2):
            return weight
        power *= 0.8


def _root_of_fit_covariance(train: Sequence[PredictedTest], variance: dict[str, float]) -> np.ndarray:
    """A root (k, k) of the covariance of the fitted parameters."""
    covariances = [positive_definite(t.rest + t.by_factor(variance[t.kind])) for t in train]
    white = [np.linalg.solve(cholesky(C, lower=True), t.J) for C, t in zip(covariances, train, strict=True)]
    # Nothing is known to change by more than a factor of e or so.
    J = np.vstack([*white, np.eye(white[0].shape[1])])
    values, vectors = np.linalg.eigh(information_inverse(J))
    return vectors * np.sqrt(np.clip(values, 0, None))
