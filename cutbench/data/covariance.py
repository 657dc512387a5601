"""How far measured curves can be trusted: one covariance for fits, discovery and what data can tell.

The model of repetition r of a test at the abscissa s: y_r(s) = f(s) (1 + a_r) + b_r(s) + e_r(s). Specimens
differ above all by a factor, 1 + a_r: one is stiffer than the next from the first reading to the last. b_r is
what else differs between them, smooth along the curve; e_r is the noise of single readings, white.

- Reading noise. Each reading is held against the cubic through its four neighbours (few readings:
  the line through two). The difference, divided by sqrt(1 + sum of squared weights), has the
  variance of the noise; a smooth curve adds next to nothing to it (Gasser, Sroka & Jennen-Steinmetz
  1986, 10.1093/biomet/73.3.625). Its size is 1.4826 times the median of the absolute value, which
  jumps of the curve do not move; half from all readings, half from a window along the curve. What the force
  of a cut saws by in wider teeth comes on top (``cutbench.data.covariance``).
- Factor. Its variance is pooled over all tests of a kind: by the few repetitions of one test it would look
  far better known than it is. It is drawn towards what is usual of soft solids, worth a few specimens. It
  stands on a computed curve, not on the measured one: in proportion to the measured one, a curve that misses
  the readings' shape would come nearer to them by shrinking to nothing (Peelle's puzzle).
- Other differences. From the residuals e (R, n) of R repetitions, without their factors, about their mean,
  S = eᵀe/(R − 1) less the noise; with few repetitions S is singular, so it is drawn towards T = D M D, where
  D² is the diagonal of S smoothed along the curve and M a Matérn-3/2 correlation whose length is that of the
  residuals: (w T + (R − 1) S)/(w + R − 1), w = 4. Where one specimen was measured, the usual is taken: a
  smooth deviation by some per cent.

What a model cannot describe comes on top of that, as a smooth discrepancy, test by test:

readings = computed curve + d(s) + noise. d is a Gaussian process of mean 0 along the test with Matérn-3/2
correlation (Kennedy & O'Hagan 2001, 10.1111/1467-9868.00294); its size is the one that makes the residual
most likely, for each test its own, and 0 where noise explains the residual. It is one number for the whole
curve, no part of the computed or the measured ordinate: there is nothing to gain by a smaller curve.
Without it a model that is wrong is fitted to the few combinations of readings that are known best, whatever
it misses in the others (Brynjarsdóttir & O'Hagan 2014, 10.1088/0266-5611/30/11/114007).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import signal
from scipy.linalg import cholesky, solve_triangular

from cutbench.data.repetition import Averaged

#: Weight of the smooth target against the sample covariance, in repetitions.
TARGET_WEIGHT = 4.0
#: The noise is never taken for smaller than this part of the largest value: no load cell is better.
NOISE_FLOOR = 1e-3
#: 1/Φ⁻¹(3/4): from the median of |x| to the standard deviation of normal x.
_MAD_TO_SD = 1.4826
#: Factor between specimens: what is taken for it before any is measured, and how many specimens that is
#: worth.
USUAL_FACTOR, USUAL_FACTOR_WEIGHT = 0.02, 2
#: Smooth difference of one specimen's curve from another's where only one was measured, relative.
USUAL_SHAPE = 0.03
#: What is left to the laws' time steps; a fit does not count it.
MIN_SHAPE = 0.002


def roughness(s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Standard deviation (n,) of the reading noise of ``y`` (n,) along ``s`` (n,), ascending."""
    floor = NOISE_FLOOR * float(np.max(np.abs(y), initial=0.0))
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
    overall = _MAD_TO_SD * np.median(rough)
    half = max(5, middle.size // 12)
    centres = np.unique(np.linspace(0, middle.size - 1, min(middle.size, 60)).round().astype(int))
    here = _MAD_TO_SD * np.array([np.median(rough[max(0, i - half) : i + half + 1]) for i in centres])
    sigma = np.sqrt((overall**2 + here**2) / 2)
    along_s = np.interp(np.arange(s.size), middle[centres], sigma)
    return np.maximum(along_s[back.ravel()], floor)


def scatter_covariance(grid: np.ndarray, residuals: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance (n, n) between specimens along ``grid`` (n,) from ``residuals`` (R, n), R >= 2.

    ``noise`` (n, n) is the mean covariance of the repetitions' reading noise on the grid; it is
    taken off. The result is positive semidefinite.
    """
    count = residuals.shape[0] - 1
    sample = residuals.T @ residuals / count - noise
    variance = local_mean(grid, grid, np.clip(np.diag(sample), 0, None))
    deviation = np.sqrt(np.maximum(variance, 0.01 * variance.mean()))
    distance = np.abs(grid[:, None] - grid)
    target = deviation[:, None] * deviation * matern(distance, _length(grid, sample, deviation))
    C = (TARGET_WEIGHT * target + count * sample) / (TARGET_WEIGHT + count)
    root = _root(C)
    return root @ root.T


def matern(distance: np.ndarray, length: float) -> np.ndarray:
    """Matérn-3/2 correlation at ``distance``."""
    r = np.sqrt(3) * distance / length
    return (1 + r) * np.exp(-r)


def smooth_deviation(x: np.ndarray, y: np.ndarray, part: float) -> np.ndarray:
    """Covariance (m, m) of a deviation by ``part`` of ``y`` (m,), smooth along ``x`` over a third of it."""
    size = np.maximum(np.abs(y), 0.05 * np.abs(y).max())
    return part**2 * np.outer(size, size) * matern(np.abs(x[:, None] - x), np.ptp(x) / 3)


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


def _root(C: np.ndarray) -> np.ndarray:
    """The symmetric one: others turn with the last digit where eigenvalues are alike, and draws with them."""
    values, vectors = np.linalg.eigh((C + C.T) / 2)
    return (vectors * np.sqrt(np.clip(values, 0, None))) @ vectors.T


def positive_definite(C: np.ndarray) -> np.ndarray:
    """Symmetric, and with a diagonal that keeps it positive definite."""
    C = (C + C.T) / 2
    return C + np.diag(1e-8 * np.diag(C) + 1e-12 * np.diag(C).max())


@dataclass(frozen=True)
class Factors:
    """Variance of the factor by which specimens differ, with its degrees of freedom (0: not known)."""

    variance: float = 0.0
    dof: int = 0

    @classmethod
    def of(cls, grids: Sequence[Averaged]) -> Factors:
        """Pooled over tests: the factor of a repetition is that of its least-squares line on the mean."""
        total, dof = 0.0, sum(grid.dof for grid in grids)
        for grid in grids:
            a = grid.factors
            # What the reading noise does to a factor is no scatter.
            noise = (grid.reading**2 * grid.mean**2).sum() / (grid.mean**2).sum() ** 2
            total += max(((a - a.mean()) ** 2).sum() - grid.dof * noise, 0.0)
        return cls(total / dof, dof) if dof else cls()

    @property
    def usual(self) -> Factors:
        """Drawn towards what is usual."""
        dof = self.dof + USUAL_FACTOR_WEIGHT
        return Factors((self.dof * self.variance + USUAL_FACTOR_WEIGHT * USUAL_FACTOR**2) / dof, dof)


def _zero() -> np.ndarray:
    return np.zeros(())


@dataclass(frozen=True)
class Block:
    """Of one test: ``total`` (m, m) of the mean reading less the computed value.

    ``by_factor`` comes from the factors of specimens, ``other`` from their other differences, known with
    ``dof`` degrees of freedom; ``scatter`` is that of a single specimen as it is, smooth. ``computed`` is the
    error of the computed curve, and ``shift`` (m,) what is known of that and added to the curve.
    ``discrepancy`` is what the model cannot describe.
    ``deviation`` (m,): of each reading. ``known`` (m,): values that count; None: all.
    """

    total: np.ndarray
    by_factor: np.ndarray = field(default_factory=_zero)
    other: np.ndarray = field(default_factory=_zero)
    scatter: np.ndarray = field(default_factory=_zero)
    deviation: np.ndarray = field(default_factory=_zero)
    dof: int = 0
    computed: np.ndarray = field(default_factory=_zero)
    shift: np.ndarray = field(default_factory=_zero)
    known: np.ndarray | None = None
    discrepancy: np.ndarray = field(default_factory=_zero)

    @property
    def noise(self) -> np.ndarray:
        """(m, m), of the mean reading less what a right model computes."""
        return self.total - self.discrepancy if np.any(self.discrepancy) else self.total

    def with_discrepancy(self, discrepancy: np.ndarray) -> Block:
        """The same with ``discrepancy`` (m, m), in place of what it has."""
        return replace(self, total=self.noise + discrepancy, discrepancy=discrepancy)

    @classmethod
    def of(
        cls,
        grid: Averaged,
        pooled: Factors,
        y: np.ndarray,
        computed: np.ndarray | None = None,
        shift: np.ndarray | None = None,
        count: int | None = None,
    ) -> Block:
        """About the curve ``y`` (m,) with ``shift`` in it; of the mean of ``count`` specimens (default: those
        that were measured)."""
        count, along = count or grid.repetitions, grid.along
        computed, shift = (_zero() if part is None else part for part in (computed, shift))
        if grid.independent:
            total = positive_definite(np.diag(grid.reading**2) / count + computed)
            none, deviation = np.zeros(total.shape), np.sqrt(np.diag(total))
            return cls(total, none, none, none, deviation, grid.dof, computed, shift)
        if grid.repetitions > 1:
            alike = grid.curves / grid.factors[:, None]
            scatter = scatter_covariance(along, alike - alike.mean(axis=0), np.diag(grid.reading**2))
        else:
            scatter = smooth_deviation(along, y, USUAL_SHAPE)
        other = scatter / count
        by_factor = pooled.variance / count * np.outer(y, y)
        rest = np.diag(grid.reading**2) / count + computed
        least = smooth_deviation(along, y, MIN_SHAPE)
        deviation = np.sqrt(np.diag(by_factor + other + least + rest))
        total = positive_definite(by_factor + other + rest)
        return cls(total, by_factor, other, scatter, deviation, grid.dof, computed, shift)

    @cached_property
    def _lower(self) -> np.ndarray:
        return cholesky(self.total, lower=True)

    @property
    def volume(self) -> float:
        """The logarithm of the determinant of ``total``."""
        return 2 * float(np.log(np.diag(self._lower)).sum())

    def white(self, values: np.ndarray) -> np.ndarray:
        """L⁻¹ values for total = L Lᵀ, (m,) or (m, k); 0 where nothing is known."""
        if self.known is not None:
            known = self.known.reshape(-1, *(1,) * (values.ndim - 1))
            values = np.where(known & np.isfinite(values), values, 0.0)
        return solve_triangular(self._lower, values, lower=True)

    def share(self, gain: np.ndarray, part: np.ndarray) -> np.ndarray:
        """Variance (k,) of what ``gain`` (k, m) makes of whitened readings due to a ``part`` (m, m) of the
        covariance."""
        return np.einsum("km,mn,kn->k", gain, self.white(self.white(part).T), gain)


@dataclass(frozen=True)
class Covariance:
    """Of several tests, by id: ``grids`` as measured, ``y`` (m,) the computed curves that it stands on, their
    ``tests``, the ``factors`` of each kind of test; ``fields``: of displacements, where a test has some."""

    grids: Mapping[str, Averaged]
    kinds: Mapping[str, str]
    y: Mapping[str, np.ndarray]
    factors: Mapping[str, Factors]
    tests: Mapping[str, Block]
    fields: Mapping[str, Block] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        grids: Mapping[str, Averaged],
        kinds: Mapping[str, str],
        y: Mapping[str, np.ndarray],
        computed: Mapping[str, np.ndarray] | None = None,
        shift: Mapping[str, np.ndarray] | None = None,
        fields: Mapping[str, Block] | None = None,
    ) -> Covariance:
        """For the tests that ``kinds`` names. ``y``: with ``shift`` added."""
        pooled = {
            kind: Factors.of([grids[id] for id in kinds if kinds[id] == kind]).usual
            for kind in dict.fromkeys(kinds.values())
        }
        computed, shift = computed or {}, shift or {}
        tests = {
            id: Block.of(grids[id], pooled[kind], y[id], computed.get(id), shift.get(id))
            for id, kind in kinds.items()
        }
        return cls({id: grids[id] for id in kinds}, kinds, y, pooled, tests, fields or {})

    @property
    def noise(self) -> Covariance:
        """Without discrepancies."""
        alone = {id: replace(b, total=b.noise, discrepancy=_zero()) for id, b in self.tests.items()}
        return replace(self, tests=alone)

    def white(self, by: Mapping[str, np.ndarray]) -> np.ndarray:
        """Whitened values of all tests stacked, (M,) or (M, k)."""
        return np.concatenate([block.white(by[id]) for id, block in self.tests.items()])

    def reading(self, grids: Mapping[str, Averaged]) -> Covariance:
        """Of the same computed curves, with readings as ``grids`` have them; without discrepancies."""
        blocks = self.tests.items()
        computed, shift = {id: b.computed for id, b in blocks}, {id: b.shift for id, b in blocks}
        read = {id: grids[id] for id in self.tests}
        return Covariance.of(read, self.kinds, self.y, computed, shift, self.fields)

    def draw(self, rng: np.random.Generator) -> tuple[dict[str, np.ndarray], Covariance]:
        """Residuals by id, computed less measured, of data that the model describes, and the covariance that
        a laboratory would have estimated from these: few repetitions cost what they should."""
        grids, normal = {}, rng.standard_normal
        # The order of the tests in a file is not to change what is drawn.
        for id in sorted(self.tests):
            curves = np.stack([self._specimen(id, normal) for _ in range(self.grids[id].repetitions)])
            grids[id] = replace(self.grids[id], curves=curves, mean=curves.mean(axis=0))
        estimated, residual = self.reading(grids), {}
        for id in sorted(self.tests):
            y, (_, error) = self.y[id], self._roots[id]
            residual[id] = y + error @ normal(y.size) - grids[id].mean
        return residual, estimated

    @cached_property
    def _roots(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Of a specimen's smooth scatter and of the computed curve's error, for draws, by id."""
        return {
            id: (
                _root(np.asarray(b.scatter)),
                _root(smooth_deviation(self.grids[id].along, self.y[id], MIN_SHAPE) + b.computed),
            )
            for id, b in self.tests.items()
        }

    def _specimen(self, id: str, normal) -> np.ndarray:
        grid, y = self.grids[id], self.y[id]
        factor = 1 + np.sqrt(self.factors[self.kinds[id]].variance) * normal()
        smooth = self._roots[id][0] @ normal(y.size)
        return y * factor + smooth + grid.reading * normal(y.size)


# -- what is not smooth along a curve -----------------------------------------------------------------
def sawtooth_variance(x: np.ndarray, y: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Variance (m,) of the sawtooth of a cut's measured force behind its first peak. It is 0 where the
    variance ``noise`` (m,) of the readings may be all of it, or where a load cell's least noise may be.

    A tooth is many readings wide, and within it they are as smooth as anywhere: their noise is not its size.
    The fall behind the peak itself is no tooth; it is what a model is to describe.
    """
    top = np.abs(y).max()
    # Where the force has fallen by a twentieth of its largest, stick–slip may follow, behind the transition.
    peaks, _ = signal.find_peaks(y, prominence=0.05 * top)
    peak = peaks[0] if peaks.size else y.size
    steady = np.arange(2, y.size - 2) >= peak + 5
    if not steady.any():
        return np.zeros(y.size)
    size = local_mean(x, x[2:-2][steady], squared_roughness(y)[steady])
    # The mean square of a few values is known to within a half: twice the noise's variance is no tooth.
    least = np.maximum(2 * noise, (NOISE_FLOOR * top) ** 2)
    return np.where(np.arange(y.size) > peak, np.maximum(size - least, 0), 0)


def roughness_variance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Variance (m,) of what is not smooth in a curve on the even grid ``x`` (m,), where m >= 5.

    What each value differs from the cubic through its four neighbours, as ``data.covariance.roughness`` has
    it, but as a mean square: jags come one by one, and a median would not see them.
    """
    return local_mean(x, x[2:-2], squared_roughness(y))


def squared_roughness(y: np.ndarray) -> np.ndarray:
    """Square (m − 4,) of what each value but the outermost differs from the cubic through its neighbours."""
    return np.convolve(y, np.array([1, -4, 6, -4, 1]) / np.sqrt(70), mode="valid") ** 2


def local_mean(x: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean (m,) of ``values`` (n,), known ``at`` (n,), in a window about each x (m,), a tenth of all wide."""
    window = np.exp(-(((x[:, None] - at) / (np.ptp(x) / 10)) ** 2) / 2)
    return window @ values / window.sum(axis=1)


# -- what a model cannot describe ----------------------------------------------------------------------
#: Correlation length, as a part of a test's course: well within it, as a longer one would let a discrepancy
#: take up what the parameters can, and these would be anywhere.
DISCREPANCY_LENGTH = 0.1
#: Sizes that are tried, as parts of a test's largest value.
RELATIVE_SIZES = np.append(0.0, np.geomspace(1e-3, 1.0, 37))


class Discrepancies:
    """All sizes that are tried for one test. ``block``: its noise alone; ``grid``: its readings; ``length``:
    over which it is correlated. Measures that are known each by itself have none."""

    def __init__(self, block: Block, grid: Averaged, length: float = DISCREPANCY_LENGTH):
        self.scale, course = float(np.abs(grid.mean).max()), grid.course
        self.tried = RELATIVE_SIZES[:1] if grid.independent else RELATIVE_SIZES
        self.L = cholesky(block.noise, lower=True)
        self.correlation = matern(np.abs(course[:, None] - course), length)
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
    """The likeliest by id, each drawn by half towards that of all: no test is given up for another."""
    own = {id: t.tried[t.gains(residual[id][:, None])[:, 0].argmax()] for id, t in tried.items()}
    smooth = [id for id, t in tried.items() if t.tried.size > 1]
    pooled = np.mean(np.square([own[id] for id in smooth])) if smooth else 0.0
    shared = {id: float(np.sqrt(0.5 * pooled + 0.5 * own[id] ** 2)) for id in smooth}
    return dict.fromkeys(own, 0.0) | shared


def with_discrepancy(
    noise: Covariance, residual: Mapping[str, np.ndarray], J: Mapping[str, np.ndarray]
) -> Covariance:
    """``noise`` with each test's likeliest discrepancy beside it, for ``residual`` (m,) by id of which the
    parameters take up what they can by the derivatives ``J`` (m, k)."""
    tried = {id: Discrepancies(block, noise.grids[id]) for id, block in noise.tests.items()}
    w, before = noise, dict.fromkeys(tried, 0.0)
    # Sizes and what the parameters take up are found by turns, until no test's size changes much.
    for _ in range(6):
        sizes = likeliest_sizes(tried, projected_residual(w, residual, J))
        blocks = {id: noise.tests[id].with_discrepancy(t.covariance(sizes[id])) for id, t in tried.items()}
        w = replace(noise, tests=blocks)
        if all(abs(sizes[id] - before[id]) <= 0.02 * sizes[id] for id in sizes):
            break
        before = sizes
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
    step *= min(1.0, 2.0 / max(np.abs(step).max(initial=0.0), 1e-300))  # no parameter moves farther, in q
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
