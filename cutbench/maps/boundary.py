"""Find where the regime changes: ask for runs where they tell most about the boundary, until it is known.

Runs may lie on a lattice of half the tolerance along each axis. What a run says is its margin, the
place of its measures against the study's thresholds (0 on the boundary). A Gaussian process through
the margins says where the boundary is and how sure that is (level-set estimation: Bryan et al.,
Active learning for identifying function threshold boundaries, NIPS 2005; Gotovos et al., IJCAI 2013).
All is decided from the runs that have ended, round by round, so the same runs give the same search on
any number of machines, and one that was interrupted goes on as it would have.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from cutbench.emulator.atlas import Measures
from cutbench.emulator.gaussian_process import GaussianProcess, Kernel
from cutbench.maps.axes import Axis, coarse_to_fine

#: Two-sided 95 % of a normal distribution: what "sure" means.
NORMAL_QUANTILE = 1.96
#: The kernel is chosen anew when there are so many times more runs than at the last choice.
_REFIT = 1.1
#: Rounds of probes on both sides of a boundary that seems known, none of which may contradict it; half as
#: many where it is thought to be there beforehand.
_PROBES = 4
#: Steepest rise of the margin, over the whole of an axis, that is taken as it is.
MAX_SLOPE = 14.0
#: Length along which margins are expected to change, in parts of the box, and bounds of their size.
#: Of their size where they are thought to be somewhere beforehand, in standard deviations of that.
EXPECTED_LENGTH, MARGIN_SIZES, INFORMED_SIZES = 0.5, (0.2, 3.0), (1.0, 3.0)
#: So often at most margins on the wrong side of zero are given less freedom.
_SIGN_ROUNDS = 4
#: Least nugget where no run is known yet, and least standard deviation of what is expected beforehand.
_MIN_NUGGET, _MIN_SPREAD = 1e-3, 0.02
#: Lattices larger than this are judged, and asked for, at every second point only.
_MAX_JUDGED = 8000

Index = tuple[int, ...]


def margin(
    drop_rel: np.ndarray, surge: np.ndarray, uncut: np.ndarray, *, drop: float, surge_min: float = math.nan
) -> np.ndarray:
    """−1 (smooth) to 1 (abrupt), 0 on the thresholds; nan where nothing was measured.

    tanh of the logarithm of measure over threshold: smooth through the boundary, level far from it.
    A material that was not cut at its depth may be cut either way below: nan, too.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(np.asarray(drop_rel, dtype=float) / drop)
        if math.isfinite(surge_min):
            ratio = np.minimum(ratio, np.log(np.asarray(surge, dtype=float) / surge_min))
    return np.where(uncut, np.nan, np.tanh(ratio))


def margins_by_atlas(estimates: Measures, drop: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Margins of what the atlas says, how many standard deviations these are from 0, and its relative
    drops; (p,) each."""
    falls = np.clip(estimates.drop[:, 0], 0.01, 1.0) ** 2
    margins = margin(falls, falls, np.zeros(falls.size, dtype=bool), drop=drop)
    return margins, estimates.falls(drop), falls


def spread_of(margins: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Standard deviations of margins that lie ``score`` of them from 0."""
    return np.abs(margins / np.where(score == 0, 1e-9, score))


def levels_of(axes: Sequence[Axis]) -> Iterator[tuple[Index, tuple[slice | int, ...]]]:
    """Of each combination of levels of the axes along which no boundary is sought its indices, and where it
    lies in an array over all axes."""
    levels = [k for k, axis in enumerate(axes) if not axis.continuous]
    for chosen in np.ndindex(*(len(axes[k].values) for k in levels)):
        fixed = dict(zip(levels, chosen, strict=True))
        yield chosen, tuple(fixed.get(k, slice(None)) for k in range(len(axes)))


@dataclass(frozen=True)
class BoundaryEstimate:
    """The margin on the lattice with its standard deviation; ``unsure`` is where its sign is not known
    with 95 % although the boundary is farther than the tolerance; ``drop``: the relative fall of the force as
    it is thought to be beforehand, if it is."""

    mean: np.ndarray
    spread: np.ndarray
    unsure: np.ndarray
    drop: np.ndarray | None = None


class Margins:
    """Margins on a lattice: what is expected of them beforehand, if anything is, and a process through how
    far those of runs are from that, in its standard deviations."""

    def __init__(
        self, process: GaussianProcess | None, shape: tuple[int, ...], expected: BoundaryEstimate | None
    ):
        self._process, self._last, self._expected = process, np.array(shape) - 1, expected
        self.kernel = (
            Kernel((EXPECTED_LENGTH,) * len(shape), _MIN_NUGGET) if process is None else process.kernel
        )
        self._size = 1.0 if process is None else process.size

    def prior(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is expected at places (p, d), and its standard deviation."""
        return prior_margins(self._expected, np.rint(at * self._last).astype(int))

    def mean(self, at: np.ndarray) -> np.ndarray:
        """(p,)."""
        mean, spread = self.prior(at)
        return mean if self._process is None else mean + spread * self._process.mean(at)

    def unit(self, at: np.ndarray) -> np.ndarray:
        """Standard deviations (p,) far from all runs."""
        return self._size * self.prior(at)[1]

    def spread(self, at: np.ndarray) -> np.ndarray:
        """Standard deviations (p,)."""
        unit = self.prior(at)[1]
        return unit if self._process is None else unit * self._process.spread(at)

    def influence(self, at: np.ndarray) -> np.ndarray:
        """See ``GaussianProcess.influence``."""
        return np.zeros((0, len(at))) if self._process is None else self._process.influence(at)


def prior_margins(expected: BoundaryEstimate | None, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is expected of margins at indices (p, d), and its standard deviation: 0 and 1 if nothing is."""
    if expected is None:
        return np.zeros(len(index)), np.ones(len(index))
    where = tuple(index.T)
    return expected.mean[where], np.maximum(expected.spread[where], _MIN_SPREAD)


class BoundarySearch:
    """The search over one box. ``shape`` are the points of its lattice, ``known`` margins by index
    (nan: a run that failed, or was not cut); ``expected``: margins as they are thought to be beforehand."""

    def __init__(
        self,
        shape: tuple[int, ...],
        *,
        start: int,
        batch: int,
        runs: int,
        expected: BoundaryEstimate | None = None,
    ):
        #: ``max_runs`` points are asked for at the most; ``asked`` are those so far, in their order.
        self.max_runs, self.asked = runs, list[Index]()
        self.shape, self._start, self._batch, self._before = shape, start, batch, expected
        index = np.stack(np.unravel_index(np.arange(math.prod(shape)), shape), axis=1)
        self._index = index
        self._places = index / (np.array(shape) - 1)
        self._step = 2 if len(index) > _MAX_JUDGED else 1
        self._judged = np.flatnonzero((index % self._step == 0).all(axis=1))
        self._free = np.ones(len(index), dtype=bool)
        self._expected: dict[Index, bool] = {}
        self._clean = 0
        self._kernel: Kernel | None = None
        self._fitted = 0

    def ask(self, known: Mapping[Index, float]) -> list[Index]:
        """The next runs; none when the boundary is known or the runs are spent."""
        if not self.asked and self._before is None:
            ticks = [np.rint(np.linspace(0, n - 1, self._start)).astype(int) for n in self.shape]
            first = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(self.shape))
            order = list(coarse_to_fine((self._start,) * len(self.shape)))
            return self._register(self._flat(first[order]))
        room = min(self._batch, self.max_runs - len(self.asked))
        process = self._process_through_margins(known, stand_ins=True) if room > 0 else None
        if process is None:
            return []
        judged = self._judged
        mean = process.mean(self._places[judged])
        spread = process.spread(self._places[judged])
        shape = tuple(-(-n // self._step) for n in self.shape)
        away = distance_to_boundary(mean.reshape(shape) >= 0).ravel() * self._step / 2  # in tolerances
        doubt = NORMAL_QUANTILE * spread - np.abs(mean)
        free = self._free[judged]
        if ((doubt > 0) & (away > 1)).any():
            self._clean, self._expected = 0, {}
            pool = np.flatnonzero((doubt > 0) & free)
            chosen = self._most_doubtful(process, pool, mean, spread, room)
            return self._register(judged[chosen])
        # It seems known. A process may be too sure of itself: try both sides of the boundary where
        # runs are far, and stop when they hold no surprise.
        surprise = any(
            not math.isnan(value := known.get(i, math.nan)) and (value >= 0) != side
            for i, side in self._expected.items()
        )
        self._clean = 0 if surprise else self._clean + bool(self._expected)
        if self._clean >= (_PROBES if self._before is None else _PROBES // 2):
            return []
        near = (away > 0.6) & (away < 1.3) if np.isfinite(away).any() else np.ones(len(judged), dtype=bool)
        pool = np.flatnonzero(near & free)
        chosen = self._most_doubtful(process, pool, 0 * mean, spread, room)
        asked = self._register(judged[chosen])
        self._expected = {i: bool(mean[k] >= 0) for i, k in zip(asked, chosen, strict=True)}
        return asked

    def estimate(self, known: Mapping[Index, float]) -> BoundaryEstimate:
        """What ``known`` says about the whole lattice; without a margin yet, nothing is sure.

        May be asked at any moment: the search goes on as if it had not been.
        """
        before = self._kernel, self._fitted
        process = self._process_through_margins(known, stand_ins=False)
        self._kernel, self._fitted = before
        if process is None:
            flat = np.zeros(self.shape)
            return BoundaryEstimate(flat, flat + 1, np.ones(self.shape, dtype=bool))
        mean = process.mean(self._places)
        spread = process.spread(self._places)
        away = distance_to_boundary(mean.reshape(self.shape) >= 0).ravel() / 2
        unsure = (NORMAL_QUANTILE * spread > np.abs(mean)) & (away > 1)
        mean, spread, unsure = (part.reshape(self.shape) for part in (mean, spread, unsure))
        return BoundaryEstimate(mean, spread, unsure, None if self._before is None else self._before.drop)

    def _process_through_margins(self, known: Mapping[Index, float], *, stand_ins: bool) -> Margins | None:
        """Through the margins; ``stand_ins``: and at runs that failed, or were not cut, through what is
        expected there, so that the search does not ask for their neighbours again and again."""
        good = sorted((i, m) for i, m in known.items() if not math.isnan(m))
        if not good:
            return None if self._before is None else Margins(None, self.shape, self._before)
        index = np.array([i for i, _ in good])
        at = self._places[self._flat(index)]
        values = limited_slope(at, np.array([m for _, m in good]))
        new = self._kernel is None or len(good) > _REFIT * self._fitted
        process = self._through(index, values, None if new else self._kernel)
        if new:
            self._fitted, self._kernel = len(good), process.kernel
        failed = sorted(i for i, m in known.items() if math.isnan(m))
        if not (stand_ins and failed):
            return process
        guessed = process.mean(self._places[self._flat(np.array(failed))])
        return self._through(np.concatenate([index, failed]), np.concatenate([values, guessed]), self._kernel)

    def _through(self, index: np.ndarray, values: np.ndarray, kernel: Kernel | None) -> Margins:
        at = self._places[self._flat(index)]
        before = None if self._before is None else prior_margins(self._before, index)
        return Margins(margins_between(at, values, kernel, before), self.shape, self._before)

    def _most_doubtful(
        self, process: Margins, pool: np.ndarray, mean: np.ndarray, spread: np.ndarray, count: int
    ) -> list[int]:
        """``count`` of ``pool``, each the most doubtful once those before it are known."""
        if pool.size > 3000:
            pool = pool[np.argsort(np.abs(mean[pool]) - NORMAL_QUANTILE * spread[pool], kind="stable")[:3000]]
        kernel = process.kernel
        at = self._places[self._judged[pool]]
        data, unit = process.influence(at), process.unit(at)
        left = (spread[pool] / unit) ** 2
        chosen: list[int] = []
        open_ = np.ones(pool.size, dtype=bool)
        for _ in range(min(count, pool.size)):
            score = NORMAL_QUANTILE * unit * np.sqrt(np.maximum(left, 0)) - np.abs(mean[pool])
            k = int(np.argmax(np.where(open_, score, -np.inf)))
            open_[k] = False
            chosen.append(int(pool[k]))
            shared = kernel.correlation(at, at[k : k + 1])[:, 0] - data.T @ data[:, k]
            alone = max(left[k], 0) + kernel.nugget + 1e-9
            data = np.vstack([data, shared / math.sqrt(alone)])
            left = left - shared**2 / alone
        return chosen

    def _flat(self, index: np.ndarray) -> np.ndarray:
        return np.ravel_multi_index(tuple(np.asarray(index).T), self.shape)

    def _register(self, flat: np.ndarray) -> list[Index]:
        asked = [tuple(map(int, self._index[i])) for i in flat]
        self._free[flat] = False
        self.asked += asked
        return asked


def margins_between(
    x: np.ndarray,
    y: np.ndarray,
    kernel: Kernel | None = None,
    before: tuple[np.ndarray, np.ndarray] | None = None,
) -> GaussianProcess:
    """The process through margins ``y`` (n,) at places ``x`` (n, d) of the unit box, far from which nothing
    is known; of how far off ``before`` was, what was expected of them and its standard deviations, if that
    is said.

    The sign of a margin is taken for certain, whatever differs from run to run: where margins jump, a
    process that smooths would else put runs on the wrong side of zero."""
    mean, spread = (np.zeros_like(y), np.ones_like(y)) if before is None else before
    z, sizes = (y - mean) / spread, MARGIN_SIZES if before is None else INFORMED_SIZES
    process = GaussianProcess(
        x, z, kernel=kernel, lengths=(EXPECTED_LENGTH,) * x.shape[1], trend="none", sizes=sizes
    )
    noise = np.full(y.size, process.kernel.nugget)
    for _ in range(_SIGN_ROUNDS):
        wrong = (mean + spread * process.mean(x) >= 0) != (y >= 0)
        if not wrong.any():
            break
        noise[wrong] = np.minimum(noise[wrong], 1e-3) / 100
        process = GaussianProcess(
            x, z, kernel=process.kernel, noise=noise, trend="none", sizes=(process.size,) * 2
        )
    return process


def limited_slope(at: np.ndarray, margins: np.ndarray) -> np.ndarray:
    """Margins (n,) at places (n, d) with jumps made ramps, of ``MAX_SLOPE`` a box at the most.

    Between two runs of different regime only the place of the boundary is unknown; a jump as such
    would make a smooth process ring. Signs stay, and what is less steep stays as it is.
    """
    up, down = np.flatnonzero(margins >= 0), np.flatnonzero(margins < 0)
    if up.size == 0 or down.size == 0:
        return margins
    apart = np.sqrt(((at[up][:, None] - at[down]) ** 2).sum(axis=2))
    rise = margins[up][:, None] - margins[down]
    part = np.minimum(1.0, MAX_SLOPE * apart / rise)
    soft = margins.copy()
    soft[up] *= part.min(axis=1)
    soft[down] *= part.min(axis=0)
    return soft


def distance_to_boundary(side: np.ndarray) -> np.ndarray:
    """Steps from each point of a lattice to the boundary between True and False; inf where there is none."""
    if side.all() or not side.any():
        return np.full(side.shape, np.inf)
    return np.where(side, distance_transform_edt(side), distance_transform_edt(~side)) - 0.5
