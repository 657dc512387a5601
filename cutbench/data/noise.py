"""How far measured curves can be trusted: reading noise, scatter between specimens, covariance of the mean.

The model of repetition r at the abscissa s: y_r(s) = f(s) + b_r(s) + e_r(s), with b_r the deviation
of the specimen, smooth along the curve, and e_r the noise of single readings, white. Both come from
the data:

- Reading noise. Each reading is held against the cubic through its four neighbours (few readings:
  the line through two). The difference, divided by sqrt(1 + sum of squared weights), has the
  variance of the noise; a smooth curve adds next to nothing to it (Gasser, Sroka & Jennen-Steinmetz
  1986, 10.1093/biomet/73.3.625). Its size is 1.4826 times the median of the absolute value, which
  jumps of the curve do not move; half from all readings, half from a window along the curve.
- Averages on a grid. Each repetition is brought to the grid by a matrix A: a local line through the
  readings nearer to this grid value than to another. The noise on the grid is A diag(v²) Aᵀ.
- Scatter. From the residuals e (R, n) of R repetitions about their mean, S = eᵀe/(R − 1) less the
  noise; with few repetitions S is singular, so it is drawn towards T = D M D, where D² is the
  diagonal of S smoothed along the curve and M a Matérn-3/2 correlation whose length is that of the
  residuals: C_s = (w T + (R − 1) S)/(w + R − 1), w = 4.
- Covariance of the mean: C = C_s/R + (1/R²) Σ_r A_r diag(v_r²) A_rᵀ.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Weight of the smooth target against the sample covariance, in repetitions.
PRIOR = 4.0
#: The noise is never taken for smaller than this part of the largest value: no load cell is better.
FLOOR = 1e-3
#: 1/Φ⁻¹(3/4): from the median of |x| to the standard deviation of normal x.
_MAD = 1.4826


def averaging(s: np.ndarray, grid: np.ndarray, sharp: np.ndarray | None = None) -> np.ndarray:
    """Matrix A (m, n) that brings readings at ``s`` (n,), ascending, to ``grid`` (m,), ascending.

    A local line through the readings between the midpoints to the neighbouring grid values, where
    four or more lie there on both sides; else, and where ``sharp`` (m,) is true (a turning point),
    linear interpolation.
    """
    A = np.zeros((grid.size, s.size))
    edges = np.concatenate([grid[:1], (grid[1:] + grid[:-1]) / 2, grid[-1:]])
    first = np.searchsorted(s, edges[:-1], side="left")
    last = np.searchsorted(s, edges[1:], side="right")
    for i, g in enumerate(grid):
        near = slice(first[i], last[i])
        x = s[near]
        if x.size >= 4 and x[0] <= g <= x[-1] and not (sharp is not None and sharp[i]):
            spread = ((x - x.mean()) ** 2).sum()
            if spread > 0:
                A[i, near] = 1 / x.size + (g - x.mean()) * (x - x.mean()) / spread
                continue
        j = int(np.clip(np.searchsorted(s, g), 1, s.size - 1))
        width = s[j] - s[j - 1]
        part = float(np.clip((g - s[j - 1]) / width, 0, 1)) if width > 0 else 1.0
        A[i, j - 1], A[i, j] = 1 - part, part
    return A


def roughness(s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Standard deviation (n,) of the reading noise of ``y`` (n,) along ``s`` (n,), ascending."""
    floor = FLOOR * float(np.max(np.abs(y), initial=0.0))
    s, where, back = np.unique(s, return_index=True, return_inverse=True)
    values = y[where]
    reach = 2 if s.size >= 12 else 1
    if s.size < 2 * reach + 1:
        return np.full(y.size, floor)
    middle = np.arange(reach, s.size - reach)
    offsets = [k for k in range(-reach, reach + 1) if k]
    guess, gain = np.zeros(middle.size), np.ones(middle.size)
    for k in offsets:
        weight = np.ones(middle.size)
        for j in offsets:
            if j != k:
                weight *= (s[middle] - s[middle + j]) / (s[middle + k] - s[middle + j])
        guess += weight * values[middle + k]
        gain += weight**2
    rough = np.abs(values[middle] - guess) / np.sqrt(gain)
    overall = _MAD * np.median(rough)
    half = max(5, middle.size // 12)
    centres = np.unique(np.linspace(0, middle.size - 1, min(middle.size, 60)).round().astype(int))
    here = _MAD * np.array([np.median(rough[max(0, i - half) : i + half + 1]) for i in centres])
    sigma = np.sqrt((overall**2 + here**2) / 2)
    along = np.interp(np.arange(s.size), middle[centres], sigma)
    return np.maximum(along[back.ravel()], floor)


def scatter_covariance(grid: np.ndarray, residuals: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance (n, n) between specimens along ``grid`` (n,) from ``residuals`` (R, n), R >= 2.

    ``noise`` (n, n) is the mean covariance of the repetitions' reading noise on the grid; it is
    taken off. The result is positive semidefinite.
    """
    count = residuals.shape[0] - 1
    sample = residuals.T @ residuals / count - noise
    variance = _smooth(grid, np.clip(np.diag(sample), 0, None))
    deviation = np.sqrt(np.maximum(variance, 0.01 * variance.mean()))
    distance = np.abs(grid[:, None] - grid)
    target = deviation[:, None] * deviation * matern(distance, _length(grid, sample, deviation))
    return _semidefinite((PRIOR * target + count * sample) / (PRIOR + count))


def matern(distance: np.ndarray, length: float) -> np.ndarray:
    """Matérn-3/2 correlation at ``distance``."""
    r = np.sqrt(3) * distance / length
    return (1 + r) * np.exp(-r)


def _smooth(grid: np.ndarray, values: np.ndarray) -> np.ndarray:
    """``values`` (n,) under a Gaussian window, a tenth of the grid wide."""
    width = (grid[-1] - grid[0]) / 10
    weight = np.exp(-(((grid[:, None] - grid) / width) ** 2) / 2)
    return weight @ values / weight.sum(axis=1)


def _length(grid: np.ndarray, sample: np.ndarray, deviation: np.ndarray) -> float:
    """Distance at which the correlation of the residuals falls to that of the Matérn curve at its length."""
    whole, spacing = grid[-1] - grid[0], (grid[-1] - grid[0]) / (grid.size - 1)
    scale = deviation[:, None] * deviation
    distance = np.abs(grid[:, None] - grid)
    level = float(matern(np.array(1.0), 1.0))
    for k in range(1, grid.size):
        ring = np.abs(distance - k * spacing) <= spacing / 2
        total = scale[ring].sum()
        if total > 0 and sample[ring].sum() / total < level:
            return float(max(k, 2) * spacing)
    return float(whole)


def _semidefinite(C: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((C + C.T) / 2)
    return (vectors * np.clip(values, 0, None)) @ vectors.T


def covariance_of_mean(
    grid: np.ndarray, curves: np.ndarray, noises: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Scatter between specimens (n, n) and covariance of the mean (n, n) of ``curves`` (R, n).

    ``noises`` are the R covariances (n, n) of the reading noise. With one curve the scatter is zero:
    nothing shows it.
    """
    count = curves.shape[0]
    reading = sum(noises) / count
    scatter = np.zeros_like(reading)
    if count > 1:
        scatter = scatter_covariance(grid, curves - curves.mean(axis=0), reading)
    return scatter, (scatter + reading) / count
