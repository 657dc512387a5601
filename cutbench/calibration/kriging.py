"""Curves at places that were not computed, from those that were: a trend and what is alike nearby.

Universal kriging (Sacks, Welch, Mitchell, Wynn 1989, 10.1214/ss/1177012413) with a linear trend and Matérn's
covariance of 5/2. How far values are alike along each coordinate, and how much they jump from place to place,
is likeliest of what is expected.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from scipy import optimize
from scipy.linalg import cho_factor, cho_solve

#: Lengths that are expected, in units of the values' own scatter along each coordinate, and jumps relative to
#: it, by what factor (a standard deviation); jumps that are looked for.
LENGTH, NUGGET, FACTOR, NUGGETS = 2.0, 1e-3, 3.0, (1e-6, 0.3)
#: A coordinate along which values hardly change begins with this part of the one along which they do most.
LEAST = 0.05
#: Farthest of lengths from what is expected, in logarithms; shapes of curves that are this small beside the
#: largest are left out of the search. It goes to its end: what ends on the way ends elsewhere where sums
#: are rounded otherwise, and with it all that is foreseen.
WIDE, FEW, SEARCH = 4.0, 0.03, {"maxiter": 60, "ftol": 1e-9}
#: Shapes with a smaller part of the variance than this are left out of an error.
TINY = 1e-4


class Kriging:
    """Of values ``Y`` (n, m) at places ``X`` (n, d), n > d + 1. Rows may end early, in nan: columns are
    foreseen from the rows that reach them, and as the last that enough of them reach."""

    def __init__(self, X: np.ndarray, Y: np.ndarray):
        self.middle = X.mean(axis=0)
        rows, columns = _complete(np.isfinite(Y))
        found = _likeliest(X[rows], Y[np.ix_(rows, columns)])
        self.scale, self.jump = np.exp(found[:-1]), float(np.exp(found[-1]))
        self.Z = (X - self.middle) * self.scale
        A = np.column_stack([np.ones(len(X)), X - self.middle])
        K = _alike(np.linalg.norm(self.Z[:, None] - self.Z[None], axis=2)) + self.jump * np.eye(len(X))
        self.trend, self.weights = np.zeros((A.shape[1], Y.shape[1])), np.zeros(Y.shape)
        self._rest, self._free = np.zeros(Y.shape), np.ones(Y.shape[1])
        #: The first columns' likelihood, and their rows: those that most reach.
        self._most: list[tuple[_Likelihood, np.ndarray]] = []
        for some, which in _alike_known(np.isfinite(Y), A.shape[1]):
            part = _Likelihood(K[np.ix_(some, some)], A[some], Y[np.ix_(some, which)])
            self.trend[:, which] = part.trend
            self.weights[np.ix_(some, which)], self._rest[np.ix_(some, which)] = part.weights, part.rest
            self._free[which] = part.free
            self._most, last = self._most or [(part, some)], which[-1]
        for made in (self.trend, self.weights, self._rest):
            made[:, last + 1 :] = made[:, last : last + 1]
        self._free[last + 1 :] = self._free[last]

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """Values (p, m) at ``places`` (p, d)."""
        there = places - self.middle
        trend = self.trend[0] + there @ self.trend[1:]
        return trend + self._near(there) @ self.weights

    def error(self, place: np.ndarray) -> np.ndarray:
        """Root (m, k) of the covariance of what a computation at ``place`` (d,) has and is not foreseen."""
        there = place - self.middle
        ((most, some),) = self._most
        part = most.unknown(self._near(there[None])[0, some], np.append(1.0, there)) + self.jump
        return np.sqrt(part) * self._shapes

    @cached_property
    def _shapes(self) -> np.ndarray:
        """Root (m, k) of the covariance of values far from all that are known."""
        between = self._rest.T @ self.weights / np.sqrt(np.outer(self._free, self._free))
        sizes, shapes = np.linalg.eigh((between + between.T) / 2)
        kept = sizes > max(TINY * sizes[-1], 0.0)
        return shapes[:, kept] * np.sqrt(sizes[kept])

    def _near(self, there: np.ndarray) -> np.ndarray:
        return _alike(np.linalg.norm((there * self.scale)[:, None] - self.Z[None], axis=2))


def _complete(known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) and columns (k,) of the largest part of ``known`` (n, m) that has no holes; rows tell
    more than columns."""
    reach, order = known.sum(axis=0), np.arange(known.shape[1])
    last = int(np.argmax(reach * np.sqrt(order + 1.0)))
    return known[:, last], order[: last + 1]


def _alike_known(known: np.ndarray, few: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Columns that the same rows reach, in order: those rows, and which columns; more than ``few`` rows."""
    first = 0
    for j in range(1, known.shape[1] + 1):
        if j == known.shape[1] or not np.array_equal(known[:, j], known[:, first]):
            if known[:, first].sum() > few or not first:
                yield np.flatnonzero(known[:, first]), np.arange(first, j)
            first = j


def _likeliest(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Logarithms (d + 1,) of what lengths along each coordinate are divided by, and of the jumps."""
    A = np.column_stack([np.ones(len(X)), X - X.mean(axis=0)])
    effect = np.sqrt(np.mean(np.linalg.lstsq(A, Y, rcond=1e-8)[0][1:] ** 2, axis=1))
    scatter = np.sqrt(np.mean((Y - Y.mean(axis=0)) ** 2))
    alike = np.maximum(effect, LEAST * effect.max(initial=0.0)) / max(scatter, 1e-300) / LENGTH
    start = np.log(np.append(np.maximum(alike, 1e-300), NUGGET))
    bounds = [*((x - WIDE, x + WIDE) for x in start[:-1]), tuple(np.log(NUGGETS))]
    squares = (X.T[:, :, None] - X.T[:, None]) ** 2
    # Values along one curve change together: what is left to tell is next to nothing.
    _, sizes, shapes = np.linalg.svd(Y - A @ np.linalg.lstsq(A, Y, rcond=1e-8)[0], full_matrices=False)
    few = Y @ shapes[sizes > FEW * sizes.max(initial=0.0)].T

    def apart(parameters: np.ndarray) -> np.ndarray:
        return np.sqrt(np.tensordot(np.exp(2 * parameters[:-1]), squares, 1))

    def covariance(parameters: np.ndarray) -> np.ndarray:
        return _alike(apart(parameters)) + np.exp(parameters[-1]) * np.eye(len(X))

    def unlikely(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        far = (parameters - start) / np.log(FACTOR)
        found = _Likelihood(covariance(parameters), A, few)
        by_K = found.by_covariance
        by_length = np.tensordot(squares, by_K * _slope(apart(parameters)), 2) * np.exp(2 * parameters[:-1])
        slope = np.append(by_length, np.trace(by_K) * np.exp(parameters[-1]))
        return 0.5 * float(far @ far) - found.value, far / np.log(FACTOR) - slope

    return optimize.minimize(unlikely, start, method="L-BFGS-B", jac=True, bounds=bounds, options=SEARCH).x


def _alike(apart: np.ndarray) -> np.ndarray:
    r = np.sqrt(5) * apart
    return (1 + r + r * r / 3) * np.exp(-r)


def _slope(apart: np.ndarray) -> np.ndarray:
    """Of ``_alike`` by the logarithm of a length's inverse, over the square of what lies along it."""
    r = np.sqrt(5) * apart
    return -5 / 3 * (1 + r) * np.exp(-r)


class _Likelihood:
    """Of values ``Y`` (n, m) with the correlation ``K`` (n, n) about a trend in ``A`` (n, d + 1): ``value``,
    the restricted log likelihood of a column; the ``trend`` (d + 1, m); ``weights`` (n, m), K⁻¹ of the
    rest."""

    def __init__(self, K: np.ndarray, A: np.ndarray, Y: np.ndarray):
        self._factor = cho_factor(K, lower=True)
        self._KA = cho_solve(self._factor, A)
        self._inner = A.T @ self._KA
        self.trend = np.linalg.lstsq(self._inner, self._KA.T @ Y, rcond=1e-12)[0]
        self.rest = Y - A @ self.trend
        self.weights = cho_solve(self._factor, self.rest)
        self.free = len(Y) - A.shape[1]
        self._squares = max(float(np.sum(self.rest * self.weights)), 1e-300)
        volume = 2 * np.log(np.diag(self._factor[0])).sum() + np.linalg.slogdet(self._inner)[1]
        size = self._squares / (self.free * Y.shape[1])
        self.value = -0.5 * (self.free * np.log(size) + volume)

    def unknown(self, near: np.ndarray, at: np.ndarray) -> float:
        """Variance of a value, relative to that, whose correlation with the known is ``near`` (n,), at a row
        ``at`` (d + 1,) of the trend: without a jump of its own."""
        solved = cho_solve(self._factor, near)
        trend = at - self._KA.T @ near
        more = trend @ np.linalg.lstsq(self._inner, trend, rcond=1e-12)[0]
        return max(float(1.0 - near @ solved + more), 0.0)

    @property
    def by_covariance(self) -> np.ndarray:
        """Derivative (n, n) of the ``value`` by ``K``."""
        inverse = cho_solve(self._factor, np.eye(len(self._KA)))
        inverse -= self._KA @ np.linalg.pinv(self._inner, rcond=1e-12) @ self._KA.T
        return 0.5 * (self.free / self._squares * self.weights @ self.weights.T - inverse)
