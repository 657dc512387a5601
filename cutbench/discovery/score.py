"""The score test: how much of the residual each candidate would take away if it were let in a little.

Residuals and derivatives are whitened and freed of what the free parameters can take up (projection off the
span of their derivatives); what a candidate gains in χ² is then the squared length of the residual's part
along its columns, with strengths kept within their bounds (most of them cannot be negative). Rao (1948),
10.1017/S0305004100023987. How large a gain chance alone makes, with the best value of a shape picked
afterwards, is seen in draws of data without any effect, see ``Covariance.draw``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, stats

from cutbench.data.covariance import Covariance
from cutbench.discovery.columns import Column, Sensed

#: Draws without effect.
DRAWS = 240
#: Degrees of freedom tried for the tail of the draws.
TAILS = (1, 2, 3, 4, 6, 8, 12, 20, 40, 100, 1000)


@dataclass(frozen=True)
class Score:
    """Of one candidate, with its best shapes. ``strengths`` (p,) internal units; ``free`` (k,): the change of
    the free parameters that goes with them; ``direction`` (M,): its whitened change of the readings, freed of
    the free parameters'. ``p``: so much by chance."""

    column: Column
    gain: float
    strengths: np.ndarray
    free: np.ndarray
    direction: np.ndarray
    p: float = 1.0

    @property
    def name(self) -> str:
        return self.column.candidate.name

    @property
    def z(self) -> float:
        return deviations(self.p)


@dataclass(frozen=True)
class Scores:
    """``chi2`` of the residual freed of the free parameters, with ``dof``; ``p_residual`` of so much by
    chance.

    ``others``: by candidate, its scores with other values of its shapes. ``expected``: the mean χ² of data
    that the model describes. ``scale``: the gain that each candidate makes by chance in one of ten such data
    sets; ``largest`` (draws,): the largest gain of any over its scale.
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
        return tail(self.largest, gain / self.scale[name])

    @property
    def excess(self) -> float:
        """χ² beyond what noise explains."""
        return max(self.chi2 - self.expected, 0.0)


def deviations(p: float) -> float:
    """How many standard deviations a normal variable has to be off for a two-sided probability ``p``."""
    return float(stats.norm.isf(max(p, 1e-300) / 2))


def score(
    sensed: Sensed, w: Covariance, residual: Mapping[str, np.ndarray], draws: int = DRAWS, seed: int = 0
) -> Scores:
    """``residual`` (m,) by id, computed less measured. The answer does not depend on the experiments'
    order."""
    columns = sensed.columns
    stacked = _Stack(sensed, columns)
    found = stacked.gains(w, residual)
    best: dict[str, int] = {}
    for i, column in enumerate(columns):
        name = column.candidate.name
        if name not in best or found.gain[i] > found.gain[best[name]]:
            best[name] = i
    rng = np.random.default_rng(seed)
    by_name = {name: np.empty(draws) for name in best}
    chi2 = np.empty(draws)
    for k in range(draws):
        drawn = stacked.gains(*reversed(w.draw(rng)))
        chi2[k] = drawn.chi2
        for name in best:
            mine = [g for g, c in zip(drawn.gain, columns, strict=True) if c.candidate.name == name]
            by_name[name][k] = max(mine)
    # Candidates with more parameters gain more by chance: each is measured against its own draws.
    scale = {name: max(float(np.quantile(g, 0.9)), 1e-12) for name, g in by_name.items()}
    largest = np.max([by_name[n] / scale[n] for n in best], axis=0) if best else np.zeros(draws)
    scores = []
    for name, i in best.items():
        g = found.gain[i]
        scores.append(
            Score(
                columns[i], g, found.strengths[i], found.free[i], found.direction[i],
                tail(by_name[name], g),
            )
        )  # fmt: skip
    others = {
        name: [Score(c, found.gain[j], found.strengths[j], found.free[j], found.direction[j])
               for j, c in enumerate(columns) if c.candidate.name == name and j != i]
        for name, i in best.items()
    }  # fmt: skip
    scores.sort(key=lambda s: (-s.gain, s.name))
    return Scores(
        scores, others, found.chi2, stacked.dof, tail(chi2, found.chi2), float(chi2.mean()), scale, largest
    )


def tail(draws: np.ndarray, value: float) -> float:
    """Probability of ``value`` or more: counted where draws reach it, else by the F distribution whose
    quantiles are most like theirs."""
    count = int((draws >= value).sum())
    if count >= 10 or not np.any(draws > 0):
        return (count + 1) / (draws.size + 1)
    levels = np.array([0.5, 0.8, 0.9, 0.95, 0.98])
    seen = np.quantile(draws, levels)
    use = seen > 0.01 * seen[-1]
    fits = []
    for a, b in itertools.product((1, 2, 3, 6, 12, 40), TAILS):
        like = stats.f.ppf(levels[use], a, b)
        ratio = np.log(seen[use] / like)
        fits.append((ratio.std(), a, b, math.exp(ratio.mean())))
    _, a, b, scale = min(fits, key=lambda fit: fit[0])
    return float(min(stats.f.sf(value / scale, a, b), (count + 1) / (draws.size + 1)))


@dataclass(frozen=True)
class _Gains:
    chi2: float
    gain: np.ndarray
    strengths: list[np.ndarray]
    free: list[np.ndarray]
    direction: list[np.ndarray]


class _Stack:
    """All columns side by side, so that one triangular solve whitens them."""

    def __init__(self, sensed: Sensed, columns: Sequence[Column]):
        self.sensed, self.columns = sensed, columns
        self.k = next(iter(sensed.J.values())).shape[1]
        self.sizes = [len(c.candidate.strengths) for c in columns]
        self.all = {id: np.hstack([sensed.J[id], *(c.by[id] for c in columns)]) for id in sensed.J}
        self.dof = sum(y.size for y in sensed.y.values()) - self.k

    def gains(self, w: Covariance, residual: Mapping[str, np.ndarray]) -> _Gains:
        white = w.white({id: np.column_stack([self.all[id], residual[id]]) for id in w.tests})
        J, C, r = white[:, : self.k], white[:, self.k : -1], white[:, -1]
        size = np.linalg.norm(J, axis=0)
        Q, R, _ = linalg.qr(J / np.where(size > 0, size, 1), mode="economic", pivoting=True)
        Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(np.abs(np.diag(R)).max(initial=0.0), 1e-300)]
        rest, cols = r - Q @ (Q.T @ r), C - Q @ (Q.T @ C)
        own = np.linalg.norm(C, axis=0)
        gain, strengths, free, direction, first = [], [], [], [], 0
        back = (
            np.linalg.pinv(J / np.where(size > 0, size, 1), rcond=1e-9) / np.where(size > 0, size, 1)[:, None]
        )
        for column, p in zip(self.columns, self.sizes, strict=True):
            part = cols[:, first : first + p].copy()
            # A column that the free parameters can make is no column.
            part[:, np.linalg.norm(part, axis=0) <= 1e-6 * own[first : first + p]] = 0
            b = _bounded(part, rest, _signs(column))
            moved = rest + part @ b
            gain.append(max(float(rest @ rest - moved @ moved), 0.0))
            strengths.append(b)
            direction.append(part @ b)
            free.append(-back @ (r + C[:, first : first + p] @ b))
            first += p
        return _Gains(float(rest @ rest), np.array(gain), strengths, free, direction)


def _signs(column: Column) -> list[int]:
    """1 for a strength that can only grow from off, -1 only fall, 0 both."""
    signs = []
    for q in column.candidate.strengths:
        low, high = column.candidate.range(q)
        signs.append(1 if q.off_value <= low else -1 if q.off_value >= high else 0)
    return signs


def _bounded(A: np.ndarray, r: np.ndarray, signs: Sequence[int]) -> np.ndarray:
    """b (p,) of the right signs that makes |r + A b| least."""
    size = np.linalg.norm(A, axis=0)
    size = np.where(size > 0, size, 1.0)
    # What may have either sign is the difference of two that may not.
    parts = [(j, s) for j, sign in enumerate(signs) for s in ((sign,) if sign else (1, -1))]
    number, sign = (np.array(each) for each in zip(*parts, strict=True))
    found, _ = optimize.nnls(A[:, number] / size[number] * sign, -r)
    return np.bincount(number, found * sign, A.shape[1]) / size
