"""How much each reading of a campaign counts: measured covariance, and how good the computation is.

Specimens differ above all by a factor: one is stiffer than the next from the first reading to the last. That
part, a² y yᵀ with a² pooled over all tests of a kind, is kept apart from what else differs between specimens
(``cutbench.data.noise``, on the curves without their factors). Lumped together, the few repetitions of one
test would make the common factor of all readings look far better known than it is.

A computed curve depends on its mesh and steps. That error is often larger than the noise of averaged
readings, so a fit that ignores it trusts its readings too much. It is measured: the same case with steps,
elements and give of the contact about half as large gives e = y_fine − y. Its smooth part goes on under
refinement: if the error is of first order, the exact curve is y + 2 e; if of a higher one, a little beyond
y + e. The fit adds 1.5 e and takes 0.7 e for one standard deviation of what is still missing. What is left
of e are the jags of both meshes, an element or a step long: those of the finer take the place of the
others, and their size is that of an error that extends over a few grid values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from cutbench.case.case import Case
from cutbench.data.experiment import Experiment
from cutbench.data.fields import laid_out
from cutbench.data.noise import matern, scatter_covariance
from cutbench.data.repetition import Averaged

#: Numerics of the finer computation, relative to those of the fit.
FINER = {"h_mm": 0.7, "step_mm": 0.5, "penalty": 2.0, "stick": 2.0}
#: What is added of the difference's smooth part, and what stays uncertain of it.
ADDED, UNSURE = 1.5, 0.7
#: In grid values: the window of the smooth part (standard deviation), and the length of jags.
WINDOW, JAG = 6.0, 4.0
#: Specimens' displacements differ by this part: they hardly depend on how stiff all of a specimen is.
FIELD_FACTOR = 0.01
#: Error of a computed curve before it has been measured: of its smooth part, and of its jags.
FIRST_GUESS, FIRST_JAGS = 0.05, 0.02


@dataclass(frozen=True)
class Factors:
    """Variance of the factor by which specimens differ, with its degrees of freedom (0: not known)."""

    variance: float = 0.0
    dof: int = 0

    @classmethod
    def of(cls, grids: Sequence[Averaged]) -> Factors:
        """Pooled over tests: the factor of a repetition is that of its least-squares line on the mean."""
        total, dof = 0.0, 0
        for grid in grids:
            if grid.dof > 0:
                a = factors(grid)
                # What the reading noise does to a factor is no scatter.
                noise = (grid.reading**2 * grid.mean**2).sum() / (grid.mean**2).sum() ** 2
                total += max(((a - a.mean()) ** 2).sum() - grid.dof * noise, 0.0)
                dof += grid.dof
        return cls(total / dof, dof) if dof else cls()


def along(grid: Averaged) -> np.ndarray:
    """The coordinate (m,) along which a curve is smooth: x if it only grows, else the time, else the way."""
    if np.all(np.diff(grid.x) > 0):
        return grid.x
    if grid.time_s is not None:
        return grid.time_s
    return np.append(0.0, np.cumsum(np.abs(np.diff(grid.x)) + 1e-9 * np.ptp(grid.x)))


def factors(grid: Averaged) -> np.ndarray:
    """(R,), 1 on average."""
    return grid.curves @ grid.mean / (grid.mean @ grid.mean)


@dataclass(frozen=True)
class Weights:
    """Whitening of one experiment's residuals: ``covariance`` (m, m) of reading less computation.

    ``shift`` (m,) is added to the computed curve. Of the covariance, ``by_factor`` comes from the factors
    of specimens, ``other`` from their other differences, known with ``dof`` degrees of freedom.
    """

    covariance: np.ndarray
    by_factor: np.ndarray
    other: np.ndarray
    dof: int
    shift: np.ndarray

    @classmethod
    def of(
        cls,
        grid: Averaged,
        pooled: Factors,
        y: np.ndarray,
        computed: np.ndarray,
        shift: np.ndarray | None = None,
    ) -> Weights:
        """``y`` (m,) the computed curve; ``computed`` (m, m) the covariance of its own error, ``shift`` what
        is known of that.

        The factors stand on the computed curve: on the measured one they would draw the fit towards
        readings that happen to be low (Peelle's puzzle).
        """
        m, count = grid.x.size, grid.repetitions
        by_factor = pooled.variance / count * np.outer(y, y)
        reading = np.diag(grid.reading**2)
        other = np.zeros((m, m))
        if count > 1:
            alike = grid.curves / factors(grid)[:, None]
            other = scatter_covariance(along(grid), alike - alike.mean(axis=0), reading) / count
        total = by_factor + other + reading / count + computed
        return cls(_sound(total), by_factor, other, grid.dof, np.zeros(m) if shift is None else shift)

    def white(self, values: np.ndarray) -> np.ndarray:
        """L⁻¹ values for C = L Lᵀ; (m,) or (m, k)."""
        return solve_triangular(cholesky(self.covariance, lower=True), values, lower=True)


@dataclass(frozen=True)
class FieldWeights:
    """Whitening of one experiment's displacement fields; places that one of the two lacks count nothing.

    The covariance (f, f) has the noise at every place, the factor by which one specimen differs from others,
    and what finer numerics change: as a whole, and place by place.
    """

    known: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, e: Experiment, computed: np.ndarray, fine: np.ndarray | None = None) -> FieldWeights:
        """``computed`` (f,) displacements in mm, ``fine`` those with finer numerics, once they are known."""
        measured = laid_out(e.fields)
        known = np.isfinite(measured) & np.isfinite(computed)
        if fine is None:
            size = np.where(known, np.abs(computed), 0.0)
            change = FIRST_GUESS * size
        else:
            known &= np.isfinite(fine)
            change = np.where(known, fine - computed, 0.0)
        size = np.where(known, computed, 0.0)
        covariance = FIELD_FACTOR**2 * np.outer(size, size) + np.outer(change, change)
        # Next to the cut one step more or less moves much; nobody can use such a place.
        covariance += np.diag(change**2 + e.field_noise_mm**2)
        return cls(known, _sound(covariance))

    def white(self, values: np.ndarray) -> np.ndarray:
        """L⁻¹ values, (f,) or (f, k); 0 where nothing is known."""
        known = self.known.reshape(-1, *(1,) * (values.ndim - 1))
        clean = np.where(known & np.isfinite(values), values, 0.0)
        return solve_triangular(cholesky(self.covariance, lower=True), clean, lower=True)


def finer(case: Case) -> Case:
    """The same test with smaller elements and steps and a stiffer blade surface."""
    n = case.numerics
    numbers = {name: factor * getattr(n, name) for name, factor in FINER.items()}
    numbers["step_mm"] = max(numbers["step_mm"], n.step_min_mm)
    return case.set(**numbers)


def guessed_error(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Covariance (m, m) of a computed curve's own error before it has been measured."""
    size = np.maximum(np.abs(y), 0.1 * np.abs(y).max())
    length = np.ptp(x) / 3
    smooth = FIRST_GUESS**2 * np.outer(size, size) * matern(np.abs(x[:, None] - x), length)
    rough = np.outer(size, size) * matern(np.abs(x[:, None] - x), JAG * np.ptp(x) / (x.size - 1))
    return smooth + FIRST_JAGS**2 * rough + np.diag((0.1 * FIRST_JAGS * size) ** 2)


def measured_error(x: np.ndarray, y: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Covariance (m, m) of a computed curve with ``correction`` added, on ``x`` (m,), even."""
    e, spacing = fine - y, np.ptp(x) / (x.size - 1)
    gentle = smooth(x, e)
    missing = scatter_covariance(x, np.stack([gentle, -gentle]) / np.sqrt(2), np.zeros((x.size, x.size)))
    size = np.sqrt(2 * _nearby(x, x, (e - gentle) ** 2))  # of both meshes, and of what neither resolves
    rough = size[:, None] * size * matern(np.abs(x[:, None] - x), JAG * spacing)
    return UNSURE**2 * missing + rough + np.diag(jags(x, e) + jags(x, y))


def correction(x: np.ndarray, y: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """What (m,) brings a computed curve nearer to the limit of fine meshes."""
    gentle = smooth(x, fine - y)
    return ADDED * gentle + (fine - y - gentle)


def smooth(x: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Local lines through ``e`` (m,) under a Gaussian window."""
    width = WINDOW * np.ptp(x) / (x.size - 1)
    d = x - x[:, None]
    weight = np.exp(-((d / width) ** 2) / 2)
    s0, s1, s2 = (weight.sum(axis=1), (weight * d).sum(axis=1), (weight * d * d).sum(axis=1))
    return (s2 * (weight @ e) - s1 * ((weight * d) @ e)) / (s0 * s2 - s1 * s1)


def _nearby(x: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean (m,) of ``values`` (n,), known ``at`` (n,), in a window about each x (m,), a tenth of all wide."""
    window = np.exp(-(((x[:, None] - at) / (np.ptp(x) / 10)) ** 2) / 2)
    return window @ values / window.sum(axis=1)


def jags(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Variance (m,) of what is not smooth in a computed curve on ``x`` (m,), even.

    What each value differs from the cubic through its four neighbours, as ``data.noise.roughness`` has
    it, but as a mean square: the jags of a mesh come one by one, and a median would not see them.
    """
    weights = np.array([1, -4, 6, -4, 1]) / np.sqrt(70)
    rough = np.convolve(y, weights, mode="valid") ** 2
    return _nearby(x, x[2:-2], rough)


def _sound(C: np.ndarray) -> np.ndarray:
    """Symmetric, and with a diagonal that keeps it positive definite."""
    C = (C + C.T) / 2
    return C + np.diag(1e-8 * np.diag(C) + 1e-12 * np.diag(C).max())
