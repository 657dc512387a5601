"""A Gaussian process through what runs said: a value, its slope and its uncertainty between them.

Universal kriging (Sacks, Welch, Mitchell & Wynn 1989, 10.1214/ss/1177012413): values are a trend and a
process with Matérn's 5/2 correlation, with a length of its own along each coordinate, and what differs from
one run to the next however near they are (a nugget). Several values at each place (a curve) share the
correlation, and have one covariance among themselves. Lengths and nugget are those of the largest restricted
likelihood times a broad prior (Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, ch. 2
and 5); the size follows in closed form.

It is written out here because scikit-learn's process has neither a trend nor a covariance among the values
of a curve, and both are needed. Derivatives of runs do not enter: they are exact up to where a cut begins,
and there twenty runs leave an error of a thousandth of the largest force without them; what is beyond, where
the error is forty times as large, they do not tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular


@dataclass(frozen=True)
class Priors:
    """What is taken for likely before any value is seen. The only settings of the process.

    Attributes
    ----------
    length : float
        Expected length along a coordinate, in units of the distance along which the linear trend changes
        values by their own standard deviation: a response that bends over its range, not a straight one.
    factor : float
        By what factor lengths may differ from that, one standard deviation of the logarithm.
    least : float
        Effect of a coordinate that hardly matters, relative to the largest: it has a length, too.
    nugget : float
        Where the search for the part of the variance that differs from run to run begins. Nothing is expected
        of it: some meshes leave jags of a few per cent in a force, others none.
    wide : float
        Lengths are sought up to so many times what is expected, or as many times below.
    nuggets : tuple of float
        Between these the nugget is sought: what is below is no more than a computation's last digits, and
        above it values are mostly chance.
    jitter : float
        Part of the variance that is added to every diagonal, so that places may lie close to each other.
    """

    length: float = 2.0
    factor: float = 3.0
    least: float = 0.05
    nugget: float = 1e-3
    wide: float = math.exp(4.0)
    nuggets: tuple[float, float] = (1e-6, 0.3)
    jitter: float = 1e-9


PRIORS = Priors()


@dataclass(frozen=True)
class Kernel:
    """A kernel is Matérn's correlation of order 5/2, with a nugget.

    Attributes
    ----------
    lengths : tuple of float
        Lengths over which values change, a coordinate each.
    nugget : float
        Relative variance of what differs from run to run.
    """

    lengths: tuple[float, ...]
    nugget: float

    def correlation(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Compute the correlation of the smooth part between places. With ``a`` (n, d), ``b`` (m, d); gives
        (n, m)."""
        r = math.sqrt(5.0) * self.distances(a, b)
        return (1 + r + r**2 / 3) * np.exp(-r)

    def distances(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Compute the distances between places, in lengths. With ``a`` (n, d), ``b`` (m, d); gives (n, m)."""
        a, b = a / np.array(self.lengths), b / np.array(self.lengths)
        square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
        return np.sqrt(np.maximum(square, 0.0))


class GaussianProcess:
    """A Gaussian process predicts values at any place, given those at some. With ``X`` (n, d), ``Y`` (n,),
    ``noise`` (n,). Raises ValueError."""

    def __init__(
        self,
        X: np.ndarray,
        Y: np.ndarray,
        *,
        trend: str = "linear",
        kernel: Kernel | None = None,
        lengths: Sequence[float] | None = None,
        noise: np.ndarray | None = None,
        sizes: tuple[float, float] = (0.0, math.inf),
    ):
        self.X, self.Y = np.atleast_2d(np.asarray(X, dtype=float)), np.asarray(Y, dtype=float)
        self.trend, self.sizes = trend, sizes
        self._middle = self.X.mean(axis=0) if self.X.size else 0.0
        if len(self.X) != len(self.Y) or len(self.X) <= self._basis(self.X).shape[1]:
            raise ValueError("a process needs as many values as places, and more of them than its trend has")
        columns = self.Y.reshape(len(self.X), -1)
        self.kernel = kernel or self._likeliest_kernel(columns, lengths)
        own = np.broadcast_to(self.kernel.nugget if noise is None else noise, len(self.X))
        K = self.kernel.correlation(self.X, self.X) + np.diag(own + PRIORS.jitter)
        self._fit = _Fit(K, self._basis(self.X), columns, sizes)
        #: The standard deviation of values about the trend; of a curve's in the root mean square.
        self.size: float = self._fit.size
        #: The weights (n, m) of the places: what each adds to a mean, by its correlation.
        self.weights: np.ndarray = self._fit.weights

    # -- what it says -------------------------------------------------------------------------------
    def mean(self, at: np.ndarray) -> np.ndarray:
        """Predict values, without what differs from run to run. With ``at`` (p, d); gives (p,)."""
        parts = [
            self._basis(part) @ self._fit.trend + self.kernel.correlation(part, self.X) @ self.weights
            for part in _chunks(at)
        ]
        return np.concatenate(parts).reshape(-1, *self.Y.shape[1:])

    def spread(self, at: np.ndarray, runs: bool = False) -> np.ndarray:
        """Compute the standard deviations of predicted values. With ``at`` (p, d); gives (p,)."""
        found = []
        for part in _chunks(at):
            V = self.influence(part)
            left = 1 + (self.kernel.nugget + PRIORS.jitter) * runs - (V**2).sum(axis=0)
            found.append(np.maximum(left, 1e-12) + self._fit.trend_variance(self._basis(part), V))
        return np.sqrt(np.concatenate(found)) * (self._fit.size if self.Y.ndim == 1 else 1.0)

    @cached_property
    def curve_root(self) -> np.ndarray:
        """The root (m, k) of the covariance among the values of a curve, far from all places."""
        found, vectors = np.linalg.eigh(self._fit.between)
        kept = found > max(1e-4 * found[-1], 0.0)
        return vectors[:, kept] * np.sqrt(found[kept])

    @property
    def trend_from_zero(self) -> np.ndarray:
        """The linear trend (1 + d, m): its values at the origin, and its slopes."""
        at_middle, slopes = self._fit.trend[:1], self._fit.trend[1:]
        return np.concatenate([at_middle - self._middle @ slopes, slopes])

    def influence(self, at: np.ndarray) -> np.ndarray:
        """Compute the whitened correlation L⁻¹ c of the data with places.

        Inner products of its columns are what the data take off the correlation of these. With ``at`` (p,
        d); gives (n, p).
        """
        return self._fit.whitened(self.kernel.correlation(np.atleast_2d(at), self.X).T)

    def _basis(self, at: np.ndarray) -> np.ndarray:
        columns = {"none": 0, "constant": 1, "linear": 1 + at.shape[1]}[self.trend]
        return np.column_stack([np.ones(len(at)), at - self._middle])[:, :columns]

    # -- its lengths --------------------------------------------------------------------------------
    def _likeliest_kernel(self, Y: np.ndarray, lengths: Sequence[float] | None) -> Kernel:
        """The kernel of the largest likelihood times the prior, from two fixed starts, so always the same."""
        from scipy.optimize import (
            minimize,
        )  # takes a while to load, and is not needed where lengths are known

        expected = np.log(self._expected_lengths(Y) if lengths is None else np.array(lengths, dtype=float))
        middle = np.append(expected, math.log(PRIORS.nugget))
        far = math.log(PRIORS.wide)
        bounds = [*((x - far, x + far) for x in expected), tuple(np.log(PRIORS.nuggets))]
        squares = (self.X.T[:, :, None] - self.X.T[:, None]) ** 2
        A = self._basis(self.X)
        # Values along one curve change together: what is left to tell is next to nothing.
        _, sizes, shapes = np.linalg.svd(Y - A @ np.linalg.lstsq(A, Y, rcond=1e-8)[0], full_matrices=False)
        few = Y @ shapes[sizes >= 0.03 * sizes.max(initial=0.0)].T
        asked = squares, A, few, middle, self.sizes
        starts = [middle + np.append(np.full(expected.size, shift), 0.0) for shift in (-0.5, 0.7)]
        found = [
            minimize(
                negative_log_posterior,
                start,
                asked,
                jac=True,
                method="L-BFGS-B",
                bounds=bounds,
                options={"maxiter": 60},
            )
            for start in starts
        ]
        best = min(found, key=lambda each: each.fun).x
        return Kernel(tuple(map(float, np.exp(best[:-1]))), float(np.exp(best[-1])))

    def _expected_lengths(self, Y: np.ndarray) -> np.ndarray:
        A = np.column_stack([np.ones(len(self.X)), self.X - self._middle])
        effect = np.sqrt(np.mean(np.linalg.lstsq(A, Y, rcond=1e-8)[0][1:] ** 2, axis=1))
        effect = np.maximum(effect, PRIORS.least * effect.max(initial=0.0))
        scatter = np.sqrt(np.mean((Y - Y.mean(axis=0)) ** 2))
        return PRIORS.length * max(scatter, 1e-300) / np.maximum(effect, 1e-300)


def negative_log_posterior(
    parameters: np.ndarray,
    squares: np.ndarray,
    A: np.ndarray,
    Y: np.ndarray,
    middle: np.ndarray,
    sizes: tuple[float, float] = (0.0, math.inf),
) -> tuple[float, np.ndarray]:
    """Minus the logarithm of restricted likelihood and prior, but for a constant, and its gradient. With
    ``parameters`` (d + 1,), ``squares`` (d, n, n), ``A`` (n, k), ``Y`` (n, m), ``middle`` (d + 1,); gives
    (d + 1,)."""
    steep, nugget = np.exp(-2 * parameters[:-1]), math.exp(parameters[-1])
    r = math.sqrt(5.0) * np.sqrt(np.tensordot(steep, squares, 1))
    decay = np.exp(-r)
    K = (1 + r + r**2 / 3) * decay
    K[np.diag_indices_from(K)] += nugget + PRIORS.jitter
    try:
        found = _Fit(K, A, Y, sizes)
    except LinAlgError:
        return 1e10, np.zeros_like(parameters)
    far = (parameters - middle) / math.log(PRIORS.factor)
    far[-1] = 0.0  # of the nugget nothing is expected
    by_K = found.by_covariance
    by_length = np.tensordot(squares, by_K * (5 / 3 * (1 + r) * decay), 2) * steep
    slope = np.append(by_length, np.trace(by_K) * nugget)
    return 0.5 * float(far @ far) - found.value, far / math.log(PRIORS.factor) - slope


class _Fit:
    """Values ``Y`` (n, m) with the correlation ``K`` (n, n) about a trend in ``A`` (n, k).

    ``value``: the restricted log likelihood of a column; ``trend`` (k, m); ``weights`` (n, m): K⁻¹ of the
    rest; ``size``: the standard deviation.
    """

    def __init__(self, K: np.ndarray, A: np.ndarray, Y: np.ndarray, sizes: tuple[float, float]):
        self._L = cholesky(K, lower=True)
        self._white = self.whitened(A)
        inner = self._white.T @ self._white
        self._inverse = np.linalg.pinv(inner, rcond=1e-12, hermitian=True)
        y = self.whitened(Y)
        self.trend = self._inverse @ (self._white.T @ y)
        rest = y - self._white @ self.trend
        self.weights = solve_triangular(self._L, rest, lower=True, trans="T", check_finite=False)
        free, columns = max(len(Y) - A.shape[1], 1), Y.shape[1]
        self.between = rest.T @ rest / free
        square = max(float((rest**2).sum()) / (free * columns), 1e-300)
        self.size = float(np.clip(math.sqrt(square), *sizes))
        volume = 2 * np.log(np.diag(self._L)).sum()
        volume += np.linalg.slogdet(inner + 1e-12 * np.trace(inner) * np.eye(len(inner)))[1]
        self.value = -0.5 * (free * (2 * math.log(self.size) + square / self.size**2) + volume)
        self._columns = columns

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """L⁻¹ values, for K = L Lᵀ."""
        return solve_triangular(self._L, values, lower=True, check_finite=False)

    def trend_variance(self, basis: np.ndarray, V: np.ndarray) -> np.ndarray:
        """Relative variance (p,) that the trend leaves, at rows ``basis`` (p, k) with the whitened
        correlation ``V`` (n, p)."""
        left = basis - V.T @ self._white
        return np.maximum(np.einsum("pi,ij,pj->p", left, self._inverse, left), 0.0)

    @property
    def by_covariance(self) -> np.ndarray:
        """Derivative (n, n) of the ``value`` by ``K``."""
        half = self.whitened(np.eye(len(self._L)))
        along = half.T @ self._white
        inverse = half.T @ half - along @ self._inverse @ along.T
        return 0.5 * (self.weights @ self.weights.T / (self._columns * self.size**2) - inverse)


def _chunks(at: np.ndarray) -> list[np.ndarray]:
    """Places in parts, of as many as a matrix of theirs has room for in memory."""
    at = np.atleast_2d(at)
    return np.array_split(at, max(1, -(-len(at) // 4000)))
