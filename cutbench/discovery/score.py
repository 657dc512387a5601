"""The score test: how much of the residual each candidate would take away if it were let in a little.

Residuals and derivatives are whitened, with what the baseline misses as a part of their covariance, and freed
of what the free parameters can take up (projection off the span of their derivatives); a candidate's step is
the one along its columns that leaves least, with strengths kept within their bounds (most of them cannot be
negative). Rao (1948), 10.1017/S0305004100023987. What it gains is twice the logarithm by which what it leaves
is likelier than what was there, each with its likeliest discrepancy: the fall of χ² where noise explains
the residual. How large a gain chance alone makes, with the best value of a shape picked afterwards, is
seen in draws of data without any effect, see ``Covariance.draw``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize, stats

from cutbench.data.covariance import Covariance, Discrepancies, with_discrepancy
from cutbench.discovery.screening import CandidateSensitivity, Sensitivities

#: Draws without effect.
DRAWS = 240
#: Degrees of freedom tried for the tail of the draws.
TAIL_DOF = (1, 2, 3, 4, 6, 8, 12, 20, 40, 100, 1000)


@dataclass(frozen=True)
class Score:
    """Of one candidate, with its best shapes. ``strengths`` (p,) internal units; ``free`` (k,): the change of
    the free parameters that goes with them; ``direction`` (M,): its whitened change of the readings, freed of
    the free parameters'. ``p``: so much by chance."""

    sensitivity: CandidateSensitivity
    gain: float
    strengths: np.ndarray
    free: np.ndarray
    direction: np.ndarray
    p: float = 1.0

    @property
    def name(self) -> str:
        return self.sensitivity.candidate.name

    @property
    def z(self) -> float:
        return z_score(self.p)


@dataclass(frozen=True)
class Scores:
    """``chi2`` of the residual freed of the free parameters in the noise alone, with ``dof``; ``p_residual``
    of so much by chance.

    ``others``: by candidate, its scores with other values of its shapes, the largest gain first.
    ``expected``: the mean χ² of data that the model describes. ``scale``: the gain that each candidate makes
    by chance in one of ten such data sets; ``largest`` (draws,): the largest gain of any over its scale.
    """

    scores: list[Score]
    others: Mapping[str, list[Score]]
    chi2: float
    dof: int
    p_residual: float
    expected: float
    scale: Mapping[str, float]
    largest: np.ndarray

    def p_any(self, name: str, gain: float) -> float:
        """Probability that chance alone makes any candidate gain as much, for its kind, as this one."""
        return tail_probability(self.largest, gain / self.scale[name])


def z_score(p: float) -> float:
    """How many standard deviations a normal variable has to be off for a two-sided probability ``p``."""
    return float(stats.norm.isf(max(p, 1e-300) / 2))


def score(
    sensitivities: Sensitivities,
    w: Covariance,
    residual: Mapping[str, np.ndarray],
    draws: int = DRAWS,
    seed: int = 0,
) -> Scores:
    """``residual`` (m,) by id, computed less measured; ``w``: the noise alone. The order of tests does not
    matter."""
    stacked = _StackedSensitivities(sensitivities)
    chi2, found = stacked.scored(w, residual)
    mine: dict[str, list[int]] = {}
    for i, s in enumerate(found):
        mine.setdefault(s.name, []).append(i)
    rng = np.random.default_rng(seed)
    drawn = (stacked.scored(*reversed(w.draw(rng))) for _ in range(draws))
    rows = np.array([[value, *(s.gain for s in scores)] for value, scores in drawn])
    noise, gains = rows[:, 0], rows[:, 1:]
    by_name = {name: gains[:, numbers].max(axis=1) for name, numbers in mine.items()}
    # Candidates with more parameters gain more by chance: each is measured against its own draws.
    scale = {name: max(float(np.quantile(g, 0.9)), 1e-12) for name, g in by_name.items()}
    largest = np.max([g / scale[n] for n, g in by_name.items()], axis=0) if mine else np.zeros(draws)
    best, others = [], {}
    for name, numbers in mine.items():
        s, *others[name] = sorted((found[i] for i in numbers), key=lambda s: -s.gain)
        best.append(replace(s, p=tail_probability(by_name[name], s.gain)))
    best.sort(key=lambda s: (-s.gain, s.name))
    return Scores(
        best, others, chi2, stacked.dof, tail_probability(noise, chi2), float(noise.mean()), scale, largest
    )


def tail_probability(draws: np.ndarray, value: float) -> float:
    """Probability of ``value`` or more: counted where draws reach it, else by the F distribution whose
    quantiles are most like theirs."""
    count = int((draws >= value).sum())
    if count >= 10 or not np.any(draws > 0):
        return (count + 1) / (draws.size + 1)
    levels = np.array([0.5, 0.8, 0.9, 0.95, 0.98])
    seen = np.quantile(draws, levels)
    use = seen > 0.01 * seen[-1]
    fits = []
    for a, b in itertools.product((1, 2, 3, 6, 12, 40), TAIL_DOF):
        ratio = np.log(seen[use] / stats.f.ppf(levels[use], a, b))
        fits.append((ratio.std(), a, b, math.exp(ratio.mean())))
    _, a, b, scale = min(fits, key=lambda fit: fit[0])
    return float(min(stats.f.sf(value / scale, a, b), (count + 1) / (draws.size + 1)))


class _StackedSensitivities:
    """All columns side by side, so that one triangular solve whitens them."""

    def __init__(self, sensitivities: Sensitivities):
        self.by_candidate = sensitivities.by_candidate
        self.k = next(iter(sensitivities.J.values())).shape[1]
        self.all = {
            id: np.hstack([J, *(c.by[id] for c in self.by_candidate)]) for id, J in sensitivities.J.items()
        }
        self.dof = sum(y.size for y in sensitivities.y.values()) - self.k

    def scored(self, w: Covariance, residual: Mapping[str, np.ndarray]) -> tuple[float, list[Score]]:
        """χ² of the residual freed of the free parameters, and each column's score."""
        J_by, k = {id: all_[:, : self.k] for id, all_ in self.all.items()}, self.k
        beside = {id: np.column_stack([self.all[id], residual[id]]) for id in w.tests}
        plain = w.white({id: beside[id][:, [*range(k), -1]] for id in w.tests})
        rest = Projection(plain[:, :k]).of(plain[:, k])
        white = with_discrepancy(w, residual, J_by).white(beside)
        C, r, freed = white[:, k:-1], white[:, -1], Projection(white[:, :k])
        left, cols = freed.of(r), freed.of(C)
        # A column that the free parameters can make is no column.
        cols[:, np.linalg.norm(cols, axis=0) <= 1e-6 * np.linalg.norm(C, axis=0)] = 0
        strengths, directions, first = np.zeros((C.shape[1], len(self.by_candidate))), [], 0
        for i, column in enumerate(self.by_candidate):
            own = slice(first, first := first + len(column.candidate.strengths))
            strengths[own, i] = _bounded_least_squares(cols[:, own], left, _signs(column))
            directions.append(cols[:, own] @ strengths[own, i])
        # The last is that of the free parameters alone.
        strengths = np.column_stack([strengths, np.zeros(C.shape[1])])
        free = -freed.back @ (r[:, None] + C @ strengths)
        steps, likely = np.vstack([free, strengths]), np.zeros(strengths.shape[1])
        for id, block in w.tests.items():
            likely += Discrepancies(block, w.grids[id]).likelihood(
                residual[id][:, None] + self.all[id] @ steps
            )
        gains = np.maximum(likely[:-1] - likely[-1], 0.0)
        scores, first = [], 0
        for i, column in enumerate(self.by_candidate):
            own = slice(first, first := first + len(column.candidate.strengths))
            scores.append(Score(column, float(gains[i]), strengths[own, i], free[:, i], directions[i]))
        return float(rest @ rest), scores


class Projection:
    """What is left of whitened values when the span of ``J`` (M, k) is taken out; ``back``: its inverse."""

    def __init__(self, J: np.ndarray):
        size = np.linalg.norm(J, axis=0)
        size = np.where(size > 0, size, 1)
        Q, R, _ = linalg.qr(J / size, mode="economic", pivoting=True)
        self.Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(np.abs(np.diag(R)).max(initial=0.0), 1e-300)]
        self.back = np.linalg.pinv(J / size, rcond=1e-9) / size[:, None]

    def of(self, values: np.ndarray) -> np.ndarray:
        return values - self.Q @ (self.Q.T @ values)


def _signs(column: CandidateSensitivity) -> list[int]:
    """1 for a strength that can only grow from off, -1 only fall, 0 both."""
    strengths = column.candidate.strengths
    return [int(q.off_value <= q.bounds[0]) or -int(q.off_value >= q.bounds[1]) for q in strengths]


def _bounded_least_squares(A: np.ndarray, r: np.ndarray, signs: Sequence[int]) -> np.ndarray:
    """b (p,) of the right signs that makes |r + A b| least."""
    size = np.linalg.norm(A, axis=0)
    size = np.where(size > 0, size, 1.0)
    # What may have either sign is the difference of two that may not.
    parts = [(j, s) for j, sign in enumerate(signs) for s in ((sign,) if sign else (1, -1))]
    number, sign = (np.array(each) for each in zip(*parts, strict=True))
    found, _ = optimize.nnls(A[:, number] / size[number] * sign, -r)
    return np.bincount(number, found * sign, A.shape[1]) / size
