"""Curves at places that were not computed, from those that were: a trend and what is alike nearby.

Universal kriging (Sacks, Welch, Mitchell, Wynn 1989, 10.1214/ss/1177012413) with a linear trend and Matérn's
covariance of 5/2. A coordinate counts as much as the values change along it; how far values are
alike, and how much they jump from place to place, are likeliest of a few.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

#: Tried: lengths over which values are alike, in units of their own scatter, and jumps relative to it.
LENGTHS, NUGGETS = (0.5, 1.0, 2.0, 4.0, 8.0), (1e-4, 1e-3, 1e-2, 1e-1)
#: A coordinate along which values hardly change still counts this part of the one along which they do most.
LEAST = 1e-3


class Kriging:
    """Of values ``Y`` (n, m) at places ``X`` (n, d), n > d + 1."""

    def __init__(self, X: np.ndarray, Y: np.ndarray):
        self.middle = X.mean(axis=0)
        A = np.column_stack([np.ones(len(X)), X - self.middle])
        effect = np.sqrt(np.mean(np.linalg.lstsq(A, Y, rcond=1e-8)[0][1:] ** 2, axis=1))
        scatter = np.sqrt(np.mean((Y - Y.mean(axis=0)) ** 2))
        self.scale = np.maximum(effect, LEAST * effect.max(initial=0.0)) / max(scatter, 1e-300)
        self.Z = (X - self.middle) * self.scale
        apart = np.linalg.norm(self.Z[:, None] - self.Z[None], axis=2)
        best = -np.inf
        for length in LENGTHS:
            for nugget in NUGGETS:
                K = _alike(apart / length) + nugget * np.eye(len(X))
                likely, trend, weights = _likelihood(K, A, Y)
                if likely > best:
                    best, self.length, self.trend, self.weights = likely, length, trend, weights

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """Values (p, m) at ``places`` (p, d)."""
        there = places - self.middle
        apart = np.linalg.norm((there * self.scale)[:, None] - self.Z[None], axis=2)
        trend = self.trend[0] + there @ self.trend[1:]
        return trend + _alike(apart / self.length) @ self.weights


def _alike(apart: np.ndarray) -> np.ndarray:
    r = np.sqrt(5) * apart
    return (1 + r + r * r / 3) * np.exp(-r)


def _likelihood(K: np.ndarray, A: np.ndarray, Y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Restricted log likelihood of the correlation ``K`` (n, n), the trend (d + 1, m), K⁻¹ of the rest."""
    factor = cho_factor(K, lower=True)
    KA = cho_solve(factor, A)
    inner = A.T @ KA
    trend = np.linalg.lstsq(inner, KA.T @ Y, rcond=1e-12)[0]
    rest = Y - A @ trend
    weights = cho_solve(factor, rest)
    free, m = len(Y) - A.shape[1], Y.shape[1]
    size = max(float(np.sum(rest * weights)) / (free * m), 1e-300)
    volume = 2 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(inner)[1]
    return -m / 2 * (free * np.log(size) + volume), trend, weights
