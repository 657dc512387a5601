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
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from cutbench.calibration.cut_runs import ComputedCut
from cutbench.case.case import Case
from cutbench.data.covariance import (
    Block,
    local_mean,
    matern,
    positive_definite,
    roughness_variance,
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
        Error behind where a cut begins before it has been measured, as a part of the curve: of its smooth
        part, and of its roughness.
    before : float
        The same before a cut begins, where nothing but the bulk and a contact is computed, over that behind.
    onset, dof, common : float
        Where a cut begins moves by such a part of the way from run to run, as Student's t with ``dof``: a
        steep drop elsewhere costs by how far that is, not by how deep it is. With finer numerics it moves by
        ``common``, of all cuts of a campaign alike (docs/validation/convergence.md): that makes values
        unsure, as of G_c, and says nothing of why speeds differ.
    """

    added: float = 1.5
    unsure: float = 0.7
    window: float = 6.0
    length: float = 4.0
    smooth: float = 0.05
    rough: float = 0.02
    before: float = 0.1
    onset: float = 0.015
    dof: float = 3.0
    common: float = 0.015


MODEL = ErrorModel()
#: A side of so few values has no smooth part and no roughness.
FEWEST = 5
#: So many places where a cut may begin stand for their distribution.
SHIFTS = 24


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
    """The course (3, n) of a run as if its cut began where that of another does: what is before stays."""
    x, later = run.course[0], other.onset_mm - run.onset_mm
    if not math.isfinite(later) or np.any(np.diff(x) < 0):
        return run.course
    after = x >= run.onset_mm
    shift = np.array([[later], [0.0], [later * run.course[2, -1] / x[-1]]])
    moved = np.where(after, run.course + shift, run.course)
    return moved[:, after | (x < other.onset_mm)]


def guessed_error(
    grid: Averaged, y: np.ndarray, onset: float, sizes: tuple[float, float] = (1.0, 1.0)
) -> np.ndarray:
    """Covariance (m, m) of a computed curve's own error where it has not been measured. ``onset``: where it
    begins, nan where it does not; ``sizes``: before and behind that, over what is guessed."""
    return _guessed_shape(grid, y, onset, sizes) + _onset_error(grid, y, onset)


def sizes_of_error(grid: Averaged, y: np.ndarray, fine: np.ndarray, onset: float) -> tuple[float, float]:
    """How large a measured error usually is beside a guess: before the cut begins, never smaller, and behind
    it. A side that has no values is as the other."""
    measured, guessed = _measured_shape(grid, y, fine, onset), _guessed_shape(grid, y, onset, (1.0, 1.0))
    ratio, before = np.diag(measured) / np.diag(guessed), _before(grid, onset)
    own, behind = (math.sqrt(np.median(ratio[side] if side.any() else ratio)) for side in (before, ~before))
    return max(own, 1.0), behind


def _before(grid: Averaged, onset: float) -> np.ndarray:
    """Which values (m,) are before the cut begins; of measures none."""
    return ((grid.along < onset) | math.isnan(onset)) & (not grid.independent)


def _guessed_shape(grid: Averaged, y: np.ndarray, onset: float, sizes: tuple[float, float]) -> np.ndarray:
    x = grid.along
    if grid.independent:
        return np.diag((sizes[1] * MODEL.rough * y) ** 2)
    part = np.where(_before(grid, onset), sizes[0] * MODEL.before, sizes[1])
    size = part * np.maximum(np.abs(y), 0.1 * np.abs(y).max())
    length = np.ptp(x) / 3
    smooth = MODEL.smooth**2 * np.outer(size, size) * matern(np.abs(x[:, None] - x), length)
    rough = np.outer(size, size) * matern(np.abs(x[:, None] - x), MODEL.length * np.ptp(x) / (x.size - 1))
    return smooth + MODEL.rough**2 * rough + np.diag((0.1 * MODEL.rough * size) ** 2)


def _onset_error(grid: Averaged, y: np.ndarray, onset: float) -> np.ndarray:
    """Covariance (m, m) of a curve whose cut begins earlier or later: a steep drop has between two values of
    the grid what shape it has."""
    if grid.independent:
        return np.zeros((y.size, y.size))
    shifts = MODEL.onset * student.ppf((np.arange(SHIFTS) + 0.5) / SHIFTS, MODEL.dof)
    off, x = np.array([begun_later(grid, y, onset, shift) - y for shift in shifts]), grid.along
    return off.T @ off / SHIFTS * matern(np.abs(x[:, None] - x), np.ptp(x) / (x.size - 1))


def begun_later(grid: Averaged, y: np.ndarray, onset: float, part: float) -> np.ndarray:
    """A curve (m,) whose cut begins by a ``part`` of the way later: what is before goes on, what is behind is
    moved. As it is where it does not begin, and where it is measures."""
    x, before = grid.along, _before(grid, onset)
    if before.sum() < 2 or before.all():
        return y
    later, (a, b) = part * onset, np.flatnonzero(before)[-2:]
    goes_on = y[b] + (y[b] - y[a]) / (x[b] - x[a]) * (x - x[b])
    behind = np.interp(x - later, x[~before], y[~before])
    return np.where(x < onset + later, np.where(before, y, goes_on), behind)


def measured_error(grid: Averaged, y: np.ndarray, fine: np.ndarray, onset: float) -> np.ndarray:
    """Covariance (m, m) of a computed curve with ``correction`` added, on an even grid (m,)."""
    return _measured_shape(grid, y, fine, onset) + _onset_error(grid, fine, onset)


def _measured_shape(grid: Averaged, y: np.ndarray, fine: np.ndarray, onset: float) -> np.ndarray:
    if grid.independent:
        return np.diag((MODEL.unsure * (fine - y)) ** 2)
    x, spacing = grid.along, np.ptp(grid.along) / (grid.along.size - 1)
    gentle, none = _gentle(grid, fine - y, onset), np.zeros(y.size)
    missing = np.outer(gentle, gentle) * matern(np.abs(x[:, None] - x), np.ptp(x) / 3)
    jags = _on_each_side(grid, (fine - y - gentle) ** 2, onset, lambda x, e: local_mean(x, x, e), none)
    size = np.sqrt(2 * jags)  # of both meshes, and of what neither resolves
    rough = size[:, None] * size * matern(np.abs(x[:, None] - x), MODEL.length * spacing)
    white = sum(_on_each_side(grid, each, onset, roughness_variance, none) for each in (fine - y, y))
    return MODEL.unsure**2 * missing + rough + np.diag(white)


def correction(grid: Averaged, y: np.ndarray, fine: np.ndarray, onset: float) -> np.ndarray:
    """What (m,) brings a computed curve nearer to the limit of fine meshes."""
    if grid.independent:
        return MODEL.added * (fine - y)
    gentle = _gentle(grid, fine - y, onset)
    return MODEL.added * gentle + (fine - y - gentle)


def _gentle(grid: Averaged, e: np.ndarray, onset: float) -> np.ndarray:
    """The smooth part of ``e`` (m,); all of it where it has few values."""
    return _on_each_side(grid, e, onset, local_linear_smooth, e)


def _on_each_side(
    grid: Averaged,
    values: np.ndarray,
    onset: float,
    of: Callable[[np.ndarray, np.ndarray], np.ndarray],
    few: np.ndarray,
) -> np.ndarray:
    """What ``of`` makes of ``values`` (m,) before a cut begins and behind it, so that neither errs by the
    other; ``few`` (m,) where a side has too few values."""
    before, found = _before(grid, onset), few.copy()
    for side in (before, ~before):
        if side.sum() > FEWEST:
            found[side] = of(grid.along[side], values[side])
    return found


def local_linear_smooth(x: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Local lines through ``e`` (m,) under a Gaussian window."""
    width = MODEL.window * np.ptp(x) / (x.size - 1)
    d = x - x[:, None]
    weight = np.exp(-((d / width) ** 2) / 2)
    s0, s1, s2 = (weight.sum(axis=1), (weight * d).sum(axis=1), (weight * d * d).sum(axis=1))
    return (s2 * (weight @ e) - s1 * ((weight * d) @ e)) / (s0 * s2 - s1 * s1)
