"""How far a computed curve is from what its equations say: its mesh and steps, measured on finer ones.

That error is often larger than the noise of averaged readings, so a fit that ignores it trusts its readings
too much. The same case with steps, elements and give of the contact about half as large gives e = y_fine −
y. Its smooth part goes on under refinement: if the error is of first order, the exact curve is y + 2 e; if
of a higher one, a little beyond y + e. The fit adds 1.5 e and takes 0.7 e for one standard deviation of
what is still missing. What is left of e are the jags of both meshes, an element or a step long: those of
the finer take the place of the others, and their size is that of an error that extends over a few grid
values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from cutbench.calibration.cut_runs import ComputedCut
from cutbench.case.case import Case
from cutbench.data.covariance import (
    Block,
    local_mean,
    matern,
    positive_definite,
    roughness_variance,
    scatter_covariance,
)
from cutbench.data.experiment import Experiment
from cutbench.data.fields import laid_out
from cutbench.data.repetition import Averaged


@dataclass(frozen=True)
class ErrorModel:
    """What is taken for the error of a computed curve.

    Attributes
    ----------
    added, unsure : float
        What is added of the difference's smooth part, and what stays uncertain of it; see above.
    window, length : float
        In grid values: the window of the smooth part (standard deviation), and the length of its roughness.
    smooth, rough : float
        Error before it has been measured, as a part of the curve: of its smooth part, and of its roughness.
    onset : float
        Where a cut begins is known to this part of the way: so far it moves under refinement
        (docs/validation/convergence.md), and jags from run to run.
    """

    added: float = 1.5
    unsure: float = 0.7
    window: float = 6.0
    length: float = 4.0
    smooth: float = 0.05
    rough: float = 0.02
    onset: float = 0.015


MODEL = ErrorModel()


def field_block(e: Experiment, computed: np.ndarray, fine: np.ndarray | None = None) -> Block:
    """Covariance (f, f) of one experiment's displacement fields; places that one of the two lacks count
    nothing.

    It has the noise at every place, the factor by which one specimen differs from others, and what finer
    numerics change: as a whole, and place by place. ``computed`` (f,) in mm, ``fine`` with finer numerics.
    """
    known = np.isfinite(laid_out(e.fields)) & np.isfinite(computed)
    if fine is None:
        change = MODEL.smooth * np.where(known, np.abs(computed), 0.0)
    else:
        known &= np.isfinite(fine)
        change = np.where(known, fine - computed, 0.0)
    size = np.where(known, computed, 0.0)
    # Displacements hardly depend on how stiff all of a specimen is: by a hundredth.
    total = 0.01**2 * np.outer(size, size) + np.outer(change, change)
    # Next to the cut one step more or less moves much; nobody can use such a place.
    return Block(positive_definite(total + np.diag(change**2 + e.field_noise_mm**2)), known=known)


def refined_case(case: Case) -> Case:
    """The same test with smaller elements and steps and a stiffer blade surface."""
    finer = case.numerics.finer(h=0.7, step=0.5, step_min=0.5, penalty=2.0, stick=2.0)
    return replace(case, numerics=finer)


def aligned(run: ComputedCut, other: ComputedCut) -> np.ndarray:
    """The course (3, n) of a run as if its cut began where that of another does."""
    x, force, time_s = run.course
    mine, its = run.onset_mm, other.onset_mm
    if not math.isfinite(mine + its) or np.any(np.diff(x) < 0):
        return run.course
    return np.stack([np.where(x < mine, x * its / mine, x - mine + its), force, time_s])


def guessed_error(grid: Averaged, y: np.ndarray, size: float = 1.0) -> np.ndarray:
    """Covariance (m, m) of a computed curve's own error where it has not been measured; ``size``: over what
    is guessed."""
    return size**2 * _guessed_shape(grid, y) + _onset_error(grid, y)


def size_of_error(grid: Averaged, y: np.ndarray, fine: np.ndarray) -> float:
    """How large a measured error usually is beside a guess, but for where the cut begins."""
    measured, guessed = _measured_shape(grid, y, fine), _guessed_shape(grid, y)
    return math.sqrt(np.median(np.diag(measured) / np.diag(guessed)))


def _guessed_shape(grid: Averaged, y: np.ndarray) -> np.ndarray:
    x = grid.along
    if grid.independent:
        return np.diag((MODEL.rough * y) ** 2)
    size = np.maximum(np.abs(y), 0.1 * np.abs(y).max())
    length = np.ptp(x) / 3
    smooth = MODEL.smooth**2 * np.outer(size, size) * matern(np.abs(x[:, None] - x), length)
    rough = np.outer(size, size) * matern(np.abs(x[:, None] - x), MODEL.length * np.ptp(x) / (x.size - 1))
    return smooth + MODEL.rough**2 * rough + np.diag((0.1 * MODEL.rough * size) ** 2)


def _onset_error(grid: Averaged, y: np.ndarray) -> np.ndarray:
    """Covariance (m, m) of a curve whose cut begins earlier or later: a steep drop is elsewhere, and has
    between two values of the grid what shape it has."""
    if grid.independent:
        return np.zeros((y.size, y.size))
    x = grid.along
    shifts = MODEL.onset * norm.ppf((np.arange(12) + 0.5) / 12)
    off = np.array([np.interp((1 + shift) * x, x, y) - y for shift in shifts])
    return off.T @ off / len(shifts) * matern(np.abs(x[:, None] - x), np.ptp(x) / (x.size - 1))


def measured_error(grid: Averaged, y: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Covariance (m, m) of a computed curve with ``correction`` added, on an even grid (m,)."""
    return _measured_shape(grid, y, fine) + _onset_error(grid, fine)


def _measured_shape(grid: Averaged, y: np.ndarray, fine: np.ndarray) -> np.ndarray:
    if grid.independent:
        return np.diag((MODEL.unsure * (fine - y)) ** 2)
    x = grid.along
    e, spacing = fine - y, np.ptp(x) / (x.size - 1)
    gentle = local_linear_smooth(x, e)
    missing = scatter_covariance(x, np.stack([gentle, -gentle]) / np.sqrt(2), np.zeros((x.size, x.size)))
    size = np.sqrt(2 * local_mean(x, x, (e - gentle) ** 2))  # of both meshes, and of what neither resolves
    rough = size[:, None] * size * matern(np.abs(x[:, None] - x), MODEL.length * spacing)
    return MODEL.unsure**2 * missing + rough + np.diag(roughness_variance(x, e) + roughness_variance(x, y))


def correction(grid: Averaged, y: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """What (m,) brings a computed curve nearer to the limit of fine meshes."""
    if grid.independent:
        return MODEL.added * (fine - y)
    x = grid.along
    gentle = local_linear_smooth(x, fine - y)
    return MODEL.added * gentle + (fine - y - gentle)


def local_linear_smooth(x: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Local lines through ``e`` (m,) under a Gaussian window."""
    width = MODEL.window * np.ptp(x) / (x.size - 1)
    d = x - x[:, None]
    weight = np.exp(-((d / width) ** 2) / 2)
    s0, s1, s2 = (weight.sum(axis=1), (weight * d).sum(axis=1), (weight * d * d).sum(axis=1))
    return (s2 * (weight @ e) - s1 * ((weight * d) @ e)) / (s0 * s2 - s1 * s1)
