"""What a model cannot describe, as a part of the model of the data: a smooth discrepancy, test by test.

readings = computed curve + d(s) + noise. d is a Gaussian process of mean 0 along the test with Matérn-3/2
correlation (Kennedy & O'Hagan 2001, 10.1111/1467-9868.00294); its size is the one that makes the residual
most likely, for each test its own, and 0 where noise explains the residual. It is one number for the whole
curve, no part of the computed or the measured ordinate: there is nothing to gain by a smaller curve.
Without it a model that is wrong is fitted to the few combinations of readings that are known best, whatever
it misses in the others (Brynjarsdóttir & O'Hagan 2014, 10.1088/0266-5611/30/11/114007).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from cutbench.data.covariance import Block, Covariance, matern, positive_definite
from cutbench.data.repetition import Averaged

#: Correlation length, as a part of a test's course: well within it, as a longer one would let a discrepancy
#: take up what the parameters can, and these would be anywhere.
LENGTH = 0.1
#: Sizes that are tried, as parts of a test's largest value.
SIZES = np.append(0.0, np.geomspace(1e-3, 1.0, 37))
#: A size is drawn towards that of all tests, which counts for so much of it: no test is given up for another.
SHARED = 0.5
#: Sizes and what the parameters take up are found by turns, so often at the most, until no test's size
#: changes by more than this part.
TURNS, SAME = 6, 0.02
#: Farthest that parameters may move to take up a residual, in q.
MAX_STEP = 2.0


class Discrepancies:
    """All sizes that are tried for one test. ``block``: its noise alone; ``grid``: its readings. Measures
    that are known each by itself have none."""

    def __init__(self, block: Block, grid: Averaged):
        self.scale, course = float(np.abs(grid.mean).max()), grid.course
        self.tried = SIZES[:1] if grid.independent else SIZES
        self.L = cholesky(block.noise, lower=True)
        self.correlation = matern(np.abs(course[:, None] - course), LENGTH)
        half = solve_triangular(self.L, self.correlation, lower=True)
        values, self.vectors = np.linalg.eigh(solve_triangular(self.L, half.T, lower=True))
        #: (sizes, m): what a size makes of the variances along ``vectors``.
        self.more = 1 + (self.scale * self.tried[:, None]) ** 2 * np.clip(values, 0, None)
        self.cost = np.log(self.more).sum(axis=1)

    def gains(self, residual: np.ndarray) -> np.ndarray:
        """Twice the log likelihood (sizes, c) of the columns of ``residual`` (m, c), above that of no
        discrepancy: what is won in the misfit less what the wider distribution costs."""
        z2 = (self.vectors.T @ solve_triangular(self.L, residual, lower=True)) ** 2
        return z2.sum(axis=0) - (1 / self.more) @ z2 - self.cost[:, None]

    def likelihood(self, residual: np.ndarray) -> np.ndarray:
        """Twice the log likelihood (c,) of the columns of ``residual`` (m, c), each with its likeliest size,
        but for a constant."""
        white = solve_triangular(self.L, residual, lower=True)
        return self.gains(residual).max(axis=0) - (white**2).sum(axis=0)

    def covariance(self, size: float) -> np.ndarray:
        return (self.scale * size) ** 2 * self.correlation


def likeliest_sizes(
    tried: Mapping[str, Discrepancies], residual: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """The likeliest by id, each drawn towards the others'."""
    own = {id: t.tried[t.gains(residual[id][:, None])[:, 0].argmax()] for id, t in tried.items()}
    smooth = [id for id, t in tried.items() if t.tried.size > 1]
    pooled = np.mean(np.square([own[id] for id in smooth])) if smooth else 0.0
    shared = {id: float(np.sqrt(SHARED * pooled + (1 - SHARED) * own[id] ** 2)) for id in smooth}
    return dict.fromkeys(own, 0.0) | shared


def with_discrepancy(
    noise: Covariance, residual: Mapping[str, np.ndarray], J: Mapping[str, np.ndarray]
) -> Covariance:
    """``noise`` with each test's likeliest discrepancy beside it, for ``residual`` (m,) by id of which the
    parameters take up what they can by the derivatives ``J`` (m, k)."""
    tried = {id: Discrepancies(block, noise.grids[id]) for id, block in noise.tests.items()}
    w, before = noise, dict.fromkeys(tried, 0.0)
    for _ in range(TURNS):
        found = likeliest_sizes(tried, projected_residual(w, residual, J))
        blocks = {id: noise.tests[id].with_discrepancy(t.covariance(found[id])) for id, t in tried.items()}
        w = replace(noise, tests=blocks)
        if all(abs(found[id] - before[id]) <= SAME * found[id] for id in found):
            break
        before = found
    return w


def twice_log_likelihood(noise: Covariance, residual: Mapping[str, np.ndarray]) -> float:
    """Twice the log likelihood of ``residual`` (m,) by id with each test's likeliest discrepancy."""
    tried = {id: Discrepancies(b, noise.grids[id]) for id, b in noise.tests.items()}
    return float(sum(t.likelihood(residual[id][:, None])[0] for id, t in tried.items()))


def projected_residual(w: Covariance, residual: Mapping[str, np.ndarray], J: Mapping[str, np.ndarray]):
    """``residual`` (m,) by id after the step of the parameters that makes it least."""
    white = w.white({id: np.column_stack([J[id], residual[id]]) for id in w.tests})
    size = np.linalg.norm(white[:, :-1], axis=0)
    size = np.where(size > 0, size, 1.0)
    step = np.linalg.lstsq(white[:, :-1] / size, -white[:, -1], rcond=1e-9)[0] / size
    step *= min(1.0, MAX_STEP / max(np.abs(step).max(initial=0.0), 1e-300))
    return {id: residual[id] + J[id] @ step for id in w.tests}


def discrepancy_mean(block: Block, residual: np.ndarray) -> np.ndarray:
    """The discrepancy (m,), measured less computed, that ``residual`` (m,), computed less measured, tells."""
    if not np.any(block.discrepancy):
        return np.zeros(residual.size)
    solved = np.linalg.solve(positive_definite(block.total), residual)
    return -(np.asarray(block.discrepancy) @ solved)


def relative_discrepancy(w: Covariance, id: str, residual: np.ndarray) -> float:
    """The root mean square of that, as a part of the largest reading of test ``id``."""
    gap = discrepancy_mean(w.tests[id], residual)
    return float(np.sqrt(np.mean(gap**2)) / np.abs(w.grids[id].mean).max())


def degrees_of_freedom(block: Block) -> float:
    """How many independent values of the discrepancy readings tell: degrees of freedom of its size."""
    return float(np.trace(np.linalg.solve(positive_definite(block.total), np.asarray(block.discrepancy))))
