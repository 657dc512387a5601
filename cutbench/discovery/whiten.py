"""How far measured and computed curves may differ by chance: the covariance that a discovery is held against.

As in a fit (``calibration.weights``), with what few repetitions cannot tell made up for by experience:
specimens of soft solids differ by a factor of some per cent and, less, in the shape of their curves. Without
it three specimens that happen to agree would make anything significant. ``draw`` makes up what a laboratory
might have found if the model were right: significance is read from such draws, each of which estimates
its own covariance anew, so that few repetitions cost what they should.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cutbench.calibration.weights import Factors, Weights, along, factors
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import Experiment
from cutbench.data.noise import matern
from cutbench.data.repetition import Averaged

#: Factor between specimens: what is taken for it before any is measured, and how many specimens that is
#: worth.
USUAL_FACTOR, WORTH = 0.02, 2
#: Smooth difference of one specimen's curve from another's where only one was measured, relative.
USUAL_SHAPE = 0.03
#: The same where several were, and the error of the laws' time steps.
LEAST_SHAPE = 0.002


@dataclass(frozen=True)
class Whitening:
    """Of all train experiments, in the order of ``ids``. ``computed`` (m, m): error of the computation."""

    ids: tuple[str, ...]
    grids: Mapping[str, Averaged]
    kinds: Mapping[str, str]
    y: Mapping[str, np.ndarray]
    computed: Mapping[str, np.ndarray]
    shift: Mapping[str, np.ndarray]
    weights: Mapping[str, Weights]

    def white(self, by: Mapping[str, np.ndarray]) -> np.ndarray:
        """Whitened values of all experiments stacked, (M,) or (M, k)."""
        return np.concatenate([self.weights[id].white(by[id]) for id in self.ids])

    def draw(self, rng: np.random.Generator) -> tuple[dict[str, np.ndarray], Whitening]:
        """Residuals by id, computed less measured, of data that the model describes, and their whitening."""
        grids, kinds = {}, self.kinds
        for id in self.ids:
            grid, w = self.grids[id], self.weights[id]
            curves = np.stack([self._specimen(id, w, rng) for _ in range(grid.repetitions)])
            grids[id] = replace(grid, curves=curves, mean=curves.mean(axis=0))
        made = _weights(self.ids, grids, kinds, self.y, self.computed, self.shift)
        error = {id: _root(self.computed[id]) @ rng.standard_normal(self.y[id].size) for id in self.ids}
        return {id: self.y[id] + error[id] - grids[id].mean for id in self.ids}, made

    def _specimen(self, id: str, w: Weights, rng: np.random.Generator) -> np.ndarray:
        grid, y, count = self.grids[id], self.y[id], self.grids[id].repetitions
        factor = np.trace(w.by_factor) * count / max(y @ y, 1e-300)
        normal = rng.standard_normal
        smooth = _root(w.other * count) @ normal(y.size)
        return y * (1 + np.sqrt(factor) * normal()) + smooth + grid.reading * normal(y.size)


def whitening(
    campaign: Campaign,
    grids: Mapping[str, Averaged],
    y: Mapping[str, np.ndarray],
    computed: Mapping[str, np.ndarray],
    shift: Mapping[str, np.ndarray],
) -> Whitening:
    """For the train experiments; ``y`` (m,) computed curves by id with their ``shift`` included."""
    train = sorted(campaign.train, key=lambda e: e.id)
    ids, kinds = tuple(e.id for e in train), {e.id: e.kind for e in train}
    return _weights(ids, {id: grids[id] for id in ids}, kinds, y, computed, shift)


def _weights(ids, grids, kinds, y, computed, shift) -> Whitening:
    pooled = {
        kind: usual(Factors.of([grids[id] for id in ids if kinds[id] == kind]))
        for kind in set(kinds.values())
    }
    weights = {id: _of(grids[id], pooled[kinds[id]], y[id], computed[id], shift[id]) for id in ids}
    return Whitening(ids, grids, kinds, y, computed, shift, weights)


def usual(measured: Factors) -> Factors:
    """The variance of the factor between specimens, drawn towards what is usual."""
    dof = measured.dof + WORTH
    return Factors((measured.dof * measured.variance + WORTH * USUAL_FACTOR**2) / dof, dof)


def _of(grid: Averaged, pooled: Factors, y: np.ndarray, computed: np.ndarray, shift: np.ndarray) -> Weights:
    w = Weights.of(grid, pooled, y, computed, shift)
    more = smooth(along(grid), y, USUAL_SHAPE if grid.repetitions == 1 else LEAST_SHAPE)
    other = w.other + more if grid.repetitions == 1 else w.other
    return replace(w, covariance=w.covariance + more, other=other)


def of_one(e: Experiment, grid: Averaged, pooled: Factors, y: np.ndarray, count: int) -> np.ndarray:
    """Covariance (m, m) of the mean of ``count`` specimens, measured as those of ``grid``, about ``y``."""
    w = _of(grid, pooled, y, np.zeros((y.size, y.size)), np.zeros(y.size))
    mine = w.by_factor + w.other + np.diag(grid.reading**2) / grid.repetitions
    C = mine * grid.repetitions / count + smooth(along(grid), y, LEAST_SHAPE)
    return C + 1e-10 * np.diag(np.diag(C))


def smooth(x: np.ndarray, y: np.ndarray, part: float) -> np.ndarray:
    """Covariance (m, m) of a deviation by ``part`` of ``y`` (m,), smooth along ``x`` over a third of it."""
    size = np.maximum(np.abs(y), 0.05 * np.abs(y).max())
    return part**2 * np.outer(size, size) * matern(np.abs(x[:, None] - x), np.ptp(x) / 3)


def _root(C: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((C + C.T) / 2)
    return vectors * np.sqrt(np.clip(values, 0, None))


__all__ = ["Whitening", "factors", "of_one", "smooth", "usual", "whitening"]
