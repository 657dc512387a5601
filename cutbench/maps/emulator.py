"""A Gaussian process through what runs said: a value and its uncertainty everywhere between them.

Matérn 5/2 covariance with a length of its own for each axis, the lengths, the amplitude and the
scatter chosen by the likelihood of the values (Rasmussen & Williams, Gaussian Processes for Machine
Learning, 2006, ch. 2 and 5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

#: Bounds of the lengths (parts of the box), the scatter (variance over that of the values), the amplitude.
_LENGTH = (0.03, 3.0)
_SCATTER = (1e-6, 0.1)
_AMPLITUDE = (0.2, 3.0)
#: So often at most values on the wrong side of zero are given less scatter.
_SIGN_ROUNDS = 4
_ROOT5 = 5.0**0.5


@dataclass(frozen=True)
class Kernel:
    """Amplitude (standard deviation of values), lengths by axis, and relative variance of the scatter."""

    amplitude: float
    lengths: tuple[float, ...]
    scatter: float

    def correlation(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(n, m) for points (n, d) and (m, d)."""
        a, b = a / np.array(self.lengths), b / np.array(self.lengths)
        square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
        r = _ROOT5 * np.sqrt(np.maximum(square, 0.0))
        return (1 + r + r**2 / 3) * np.exp(-r)


class Emulator:
    """The process given values ``y`` (n,) at points ``x`` (n, d) of the unit box; without data its mean is 0.

    The sign of a value is taken for certain, whatever its scatter: where the values jump, a process
    that smooths would else put points on the wrong side of zero.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray, kernel: Kernel | None = None):
        """With ``kernel``, or the likeliest one. Raises ValueError without points."""
        x, y = np.atleast_2d(np.asarray(x, dtype=float)), np.asarray(y, dtype=float)
        if y.size == 0 or len(x) != y.size:
            raise ValueError("an emulator needs as many values as points, and one at least")
        self.x, self.y = x, y
        self.kernel = kernel or likeliest(x, y)
        C = self.kernel.correlation(x, x)
        scatter = np.full(y.size, self.kernel.scatter)
        for _ in range(_SIGN_ROUNDS):
            self._L = cholesky(C + np.diag(scatter + 1e-9), lower=True)
            self._weights = cho_solve((self._L, True), y)
            wrong = (C @ self._weights >= 0) != (y >= 0)
            if not wrong.any():
                break
            scatter[wrong] = np.minimum(scatter[wrong], 1e-3) / 100

    def mean(self, at: np.ndarray) -> np.ndarray:
        """Expected values (m,) at points (m, d)."""
        return np.concatenate(
            [self.kernel.correlation(part, self.x) @ self._weights for part in _parts(np.atleast_2d(at))]
        )

    def spread(self, at: np.ndarray) -> np.ndarray:
        """Standard deviations (m,) of the values without their scatter."""
        found = []
        for part in _parts(np.atleast_2d(at)):
            V = self.influence(part)
            found.append(self.kernel.amplitude * np.sqrt(np.maximum(1 - (V**2).sum(0), 1e-12)))
        return np.concatenate(found)

    def influence(self, at: np.ndarray) -> np.ndarray:
        """L⁻¹ c (n, m): its columns' inner products are what the data take off the correlation."""
        return solve_triangular(self._L, self.kernel.correlation(self.x, at), lower=True, check_finite=False)


def likeliest(x: np.ndarray, y: np.ndarray) -> Kernel:
    """The kernel that gives ``y`` the largest likelihood, from two fixed starts, so always the same."""
    d = x.shape[1]
    gaps = [(x[:, k][:, None] - x[:, k]) ** 2 for k in range(d)]
    bounds = [tuple(np.log(_AMPLITUDE)), *[tuple(np.log(_LENGTH))] * d, tuple(np.log(_SCATTER))]
    starts = [np.log([1.0, *[length] * d, 1e-4]) for length in (0.3, 1.0)]
    found = [minimize(cost, start, (gaps, y), jac=True, method="L-BFGS-B", bounds=bounds,
                      options={"maxiter": 40}) for start in starts]  # fmt: skip
    amplitude, *lengths, scatter = np.exp(min(found, key=lambda best: best.fun).x)
    return Kernel(float(amplitude), tuple(map(float, lengths)), float(scatter))


def cost(theta: np.ndarray, gaps: list[np.ndarray], y: np.ndarray) -> tuple[float, np.ndarray]:
    """Minus the log likelihood (constant left out), with a broad prior on the lengths, and its gradient."""
    amplitude, *lengths, scatter = np.exp(theta)
    square = sum(g / length**2 for g, length in zip(gaps, lengths, strict=True))
    r = _ROOT5 * np.sqrt(square)
    decay = np.exp(-r)
    C = (1 + r + r**2 / 3) * decay
    C[np.diag_indices_from(C)] += scatter + 1e-9
    try:
        L = cholesky(C, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return 1e10, np.zeros_like(theta)
    inverse = cho_solve((L, True), np.eye(y.size), check_finite=False)
    weights = inverse @ y
    fit = y @ weights / amplitude**2
    # Log-normal, a factor of three around 0.5 of the box: few points must not say "flat" or "noise".
    prior = (np.array(theta[1:-1]) - np.log(0.5)) / 1.1
    cost = 0.5 * fit + np.log(np.diag(L)).sum() + y.size * theta[0] + 0.5 * (prior**2).sum()
    M = inverse - np.outer(weights, weights) / amplitude**2
    slope = np.empty_like(theta)
    slope[0] = y.size - fit
    bend = M * (5 / 3 * (1 + r) * decay)
    for k, (g, length) in enumerate(zip(gaps, lengths, strict=True)):
        slope[1 + k] = 0.5 * (bend * g).sum() / length**2 + prior[k] / 1.1
    slope[-1] = 0.5 * scatter * np.trace(M)
    return float(cost), slope


def _parts(at: np.ndarray, size: int = 4000):
    return np.array_split(at, max(1, -(-len(at) // size)))
