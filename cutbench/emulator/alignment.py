"""Curves of cuts, laid over each other with the beginnings of their cuts at one place.

A force rises until the cut begins, and drops: between two curves that drop at different depths lies one that
drops at a depth between, not half of each. So curves are aligned (registration: Ramsay & Li 1998,
10.1111/1467-9868.00129): until the cut begins along parts of the way to it, from then on along the travel
beyond. Where it begins, what is before and what is beyond are a process each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.special import log_ndtr

from cutbench.emulator.gaussian_process import GaussianProcess, Kernel
from cutbench.emulator.settings import SETTINGS


@dataclass(frozen=True)
class Course:
    """A computed curve: travel ``x`` (n,), ``force`` (n,), and where the cut begins, ``onset``; nan where it
    does not."""

    x: np.ndarray
    force: np.ndarray
    onset: float

    @property
    def end(self) -> float:
        """Where it ends."""
        return float(self.x[-1])


class AlignedCurves:
    """Curves at places, and what lies between them. With ``X`` (n, d), ``x`` (k,). Raises ValueError."""

    def __init__(
        self,
        X: np.ndarray,
        courses: Sequence[Course],
        x: np.ndarray,
        beyond: np.ndarray | None = None,
        kernels: Mapping[str, Kernel | None] | None = None,
    ):
        if len(X) < X.shape[1] + 1 + SETTINGS.spare:
            raise ValueError(f"{len(X)} curves are too few for {X.shape[1]} coordinates")
        self.x, self.X, self.courses, known = x, X, courses, kernels or {}
        largest = [int(np.abs(c.force).argmax()) for c in courses]
        ends = np.array([(abs(c.force[i]), c.x[i]) for i, c in zip(largest, courses, strict=True)])
        self.small, self._soft = (
            SETTINGS.small_force * np.median(ends[:, 0]),
            SETTINGS.small_force * np.median(ends[:, 0] / ends[:, 1]),
        )
        begun = np.isfinite([c.onset for c in courses])
        self._onset, at = _onsets(X, courses, begun, x[-1], known.get("onset"))
        #: Parts of the way to the onset, and the travel beyond it.
        self.part = np.linspace(0, 1, x.size)
        self.beyond = np.linspace(0, x[-1], x.size) if beyond is None else beyond
        # What it takes to cut matters little before: force over travel is smoother than force.
        rising = np.array([_force_at(self.part[1:] * o, c) for o, c in zip(at, courses, strict=True)])
        travel = self.part[1:] * at[:, None]
        self._before = Curves(X, np.arcsinh(rising / travel / self._soft), known.get("before"))
        self._after: Curves | None = None
        if self._onset is not None:
            after = [_force_at(self.beyond + o, c) for o, c, b in zip(at, courses, begun, strict=True) if b]
            # What is beyond, by that where the cut begins: so an error of that is not taken for a drop.
            there = np.arcsinh(rising[begun, -1:] / self.small)
            changes = np.arcsinh(np.array(after)[:, 1:] / self.small) - there
            self._after = Curves(X[begun], changes, known.get("after"))

    @property
    def kernels(self) -> dict[str, Kernel | None]:
        """Of the onset, of what is before it and of what is beyond; None where too few cuts begin."""
        parts = {"onset": self._onset, "before": self._before, "after": self._after}
        return {name: None if part is None else part.kernel for name, part in parts.items()}

    def draws(
        self, places: np.ndarray, normal: Callable[[int, int], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Curves that runs at places may have. With ``places`` (p, d); gives ``onset`` (p, s), ``before``
        (p, s, k), ``after`` (p, s, m)."""
        assert self._onset is not None and self._after is not None, "enough cuts begin"
        sd = self._onset.spread(places, runs=True)
        onset = np.exp(np.clip(self._onset.mean(places)[:, None] + sd[:, None] * normal(0, 1).T[0], -50, 50))
        rising = self._rising(self._before.draws(places, normal), onset)
        changes = self._after.draws(places, lambda part, r: normal(SETTINGS.reaches + part, r))
        return onset, rising, self._beyond(rising, changes)

    def parts(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The likeliest of ``draws``: ``onset`` (p,), ``before`` (p, k) and ``after`` (p, m)."""
        at = self.onset(places)
        rising = self._rising(self._before.mean(places), at)
        changes = (
            np.zeros((len(at), self.beyond.size - 1)) if self._after is None else self._after.mean(places)
        )
        return at, rising, self._beyond(rising, changes)

    def mean(self, places: np.ndarray) -> np.ndarray:
        """Forces (p, k) that are smooth in the places (p, d)."""
        found = []
        for o, rising, after in zip(*self.parts(places), strict=True):
            before, beyond = (
                np.interp(self.x, self.part * o, rising),
                np.interp(self.x - o, self.beyond, after),
            )
            found.append(np.where(self.x > o, beyond, before))
        return np.stack(found)

    def onset(self, places: np.ndarray) -> np.ndarray:
        """Travels (p,) at which the cuts begin at places (p, d); the last where none begins."""
        if self._onset is None:
            return np.full(len(places), self.x[-1])
        return np.exp(np.clip(self._onset.mean(places), -50, 50))

    def log_onset(self, places: np.ndarray, spread: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (p,) of the logarithm of where runs at places (p, d) begin to cut."""
        assert self._onset is not None, "enough cuts begin"
        mean = self._onset.mean(places)
        return mean, self._onset.spread(places, runs=True) if spread else np.zeros_like(mean)

    def computed(self, place: np.ndarray) -> Course | None:
        """The run at a place (d,); None where there is none."""
        same = np.flatnonzero(np.abs(self.X - place).max(axis=1, initial=0.0) <= 1e-9)  # but for rounding
        return self.courses[same[0]] if same.size else None

    def root(self, place: np.ndarray) -> np.ndarray:
        """Root (k, r) of the error's covariance at a place (d,): of what a run there would give."""
        (o,), (force,) = self.onset(place[None]), self.mean(place[None])
        size = np.hypot(force, self.small)
        along = [(self.part[1:] * o, self._before.root(place))]
        if self._after is not None:
            along.append((self.beyond + o, np.pad(self._after.root(place), ((1, 0), (0, 0)))))
        # Each goes on as it ends, and is as it begins before.
        columns = [np.interp(self.x, way, column) for way, root in along for column in root.T]
        if self._onset is not None:
            # A shift of the onset takes along what is beyond, with the force that it begins at.
            change = np.minimum(self.x, o) * np.gradient(force, self.x) - force
            columns.append(self._onset.spread(place[None], runs=True)[0] * change / size)
        return main_parts(size[:, None] * np.stack(columns, axis=1))

    def _rising(self, values: np.ndarray, onset: np.ndarray) -> np.ndarray:
        """Forces (…, k) at parts of the way to onsets (…), of values of their ratio to the travel there."""
        stiffness = np.sinh(np.clip(values, -50, 50)) * self._soft
        found = stiffness * self.part[1:] * onset[..., None]
        return np.concatenate([np.zeros_like(found[..., :1]), found], axis=-1)

    def _beyond(self, rising: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Forces (…, m) from the onset on, of ``changes`` (…, m − 1) since the last of those before."""
        begun = np.arcsinh(rising[..., -1:] / self.small)
        values = np.concatenate([begun, begun + changes], axis=-1)
        return np.sinh(np.clip(values, -50, 50)) * self.small


def _onsets(
    X: np.ndarray, courses: Sequence[Course], begun: np.ndarray, end: float, kernel: Kernel | None
) -> tuple[GaussianProcess | None, np.ndarray]:
    """The process of the onset's logarithm, None where too few cuts begin; and all onsets (n,)."""
    if begun.sum() < X.shape[1] + 1 + SETTINGS.spare:
        return None, np.full(len(X), end)
    values = np.log([c.onset if b else np.nan for c, b in zip(courses, begun, strict=True)])
    process = GaussianProcess(X[begun], values[begun], kernel=kernel)
    if not begun.all():
        # Of a cut that did not begin it is known that it begins later: its logarithm is as likely as before
        # from a hundredth beyond its end on, and has the mean and the variance of a normal variable that is
        # cut off there.
        last = np.log([1.01 * c.end for c in courses])[~begun]
        mean, sd = process.mean(X[~begun]), process.spread(X[~begun], runs=True)
        short = (last - mean) / sd
        hazard = np.exp(-(short**2) / 2 - log_ndtr(-short)) / math.sqrt(2 * math.pi)
        values[~begun] = mean + sd * hazard
        noise = np.full(len(X), process.kernel.nugget)
        noise[~begun] += (sd / process.size) ** 2 * (1 - hazard * (hazard - short))
        process = GaussianProcess(X, values, kernel=process.kernel, noise=noise)
    return process, np.exp(values)


def main_parts(root: np.ndarray) -> np.ndarray:
    """A root (k, r) of a covariance in fewer columns: what a twentieth of the largest part of an error adds
    is not felt, and there are many such parts."""
    vectors, sizes, _ = np.linalg.svd(root, full_matrices=False)
    kept = sizes > 0.05 * sizes[0]
    return vectors[:, kept] * sizes[kept]


class Curves:
    """A process of curves ``Y`` (n, m) that may end early, in nan: a value is said from the curves that reach
    it, and as the last one that enough of them reach."""

    def __init__(self, X: np.ndarray, Y: np.ndarray, kernel: Kernel | None = None):
        count = np.isfinite(Y).sum(axis=0)
        few = X.shape[1] + 1 + SETTINGS.spare
        last = int(np.flatnonzero(count >= min(few, count[0])).max()) + 1
        self.size = Y.shape[1]
        levels = np.unique(np.linspace(count[0], count[last - 1], SETTINGS.reaches).astype(int))[::-1]
        stops = [int(np.flatnonzero(count[:last] >= level).max()) + 1 for level in levels]
        if kernel is None:  # of as many values as there are of curves that all have them
            stop = stops[np.argmax(levels * stops)]
            rows = np.isfinite(Y[:, stop - 1])
            kernel = GaussianProcess(X[rows], Y[rows, :stop]).kernel
        self.kernel, self.blocks, self._X = kernel, list[GaussianProcess](), X
        weights, trend = np.zeros((len(X), self.size)), np.zeros((1 + X.shape[1], self.size))
        for first, stop in itertools.pairwise([0, *dict.fromkeys(stops)]):
            rows = np.isfinite(Y[:, stop - 1])
            made = GaussianProcess(X[rows], Y[rows, first:stop], kernel=kernel)
            self.blocks.append(made)
            weights[rows, first:stop], trend[:, first:stop] = made.weights, made.trend_from_zero
        # What is said beyond the last value is that one.
        weights[:, last:], trend[:, last:] = weights[:, last - 1, None], trend[:, last - 1, None]
        self._weights, self._trend = weights, trend

    def mean(self, places: np.ndarray) -> np.ndarray:
        """(p, m)."""
        near = self.kernel.correlation(places, self._X)
        return self._trend[0] + places @ self._trend[1:] + near @ self._weights

    def draws(self, places: np.ndarray, normal: Callable[[int, int], np.ndarray]) -> np.ndarray:
        """Values (p, s, m) that runs at places (p, d) may have; ``normal``: see ``AlignedCurves.draws``."""
        parts = []
        for number, made in enumerate(self.blocks):
            noise = normal(1 + number, made.curve_root.shape[1]) @ made.curve_root.T
            sd = made.spread(places, runs=True)
            parts.append(made.mean(places)[:, None, :] + sd[:, None, None] * noise)
        found = np.concatenate(parts, axis=2)
        return np.pad(found, ((0, 0), (0, 0), (0, self.size - found.shape[2])), mode="edge")

    def root(self, place: np.ndarray) -> np.ndarray:
        """(m, r); blocks err each by itself."""
        parts = [made.curve_root * made.spread(place[None], runs=True)[0] for made in self.blocks]
        root = block_diag(*parts)
        return np.pad(root, ((0, self.size - len(root)), (0, 0)), mode="edge")


def _force_at(at: np.ndarray, c: Course) -> np.ndarray:
    """The curve at travels, nan beyond its end."""
    return np.where(at <= c.x[-1] * (1 + 1e-9), np.interp(at, c.x, c.force), np.nan)
