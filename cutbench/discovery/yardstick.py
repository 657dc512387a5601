"""How wrong models of one campaign are, beside one another.

Where most of what the first of them leaves is no noise, in squares of what is missed beyond noise,
as parts of each curve's largest value: what a person sees. Elsewhere in squares of standard deviations, which
also count what is known more exactly than a curve as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutbench.data.covariance import Covariance
from cutbench.data.discrepancy import allowing, misfit, taken_up
from cutbench.discovery.columns import Sensed
from cutbench.discovery.point import Point
from cutbench.discovery.score import Score


@dataclass(frozen=True)
class Yardstick:
    """``first``: the model that others are held against; ``expected``: χ² of data that a model describes."""

    first: Point
    expected: float

    @cached_property
    def noise(self) -> Covariance:
        return self.first.w.noise

    @cached_property
    def plain(self) -> bool:
        missed = sum(self.first.misfit[id] ** 2 * r.size for id, r in self.first.residual.items())
        return missed > self._squares(self.first.residual) / 2

    def of(self, residual: Mapping[str, np.ndarray], J: Mapping[str, np.ndarray]) -> float:
        """Of ``residual`` (m,) by id, what is beyond noise and what parameters with derivatives ``J`` (m, k)
        take up."""
        if self.plain:
            w = allowing(self.noise, residual, J)
            return sum(misfit(w, id, residual[id]) ** 2 for id in w.tests)
        white = self.noise.white(taken_up(self.noise, residual, J))
        return max(float(white @ white) - self.expected, 0.0)

    def left(self, point: Point) -> float:
        """The part of what the first model gets wrong that ``point`` does; none where nothing is wrong."""
        return self._part(self.of(point.residual, point.J_inside))

    def _part(self, wrong: float) -> float:
        whole = self.of(self.first.residual, self.first.J_inside)
        return wrong / whole if whole > 0 else 0.0

    def after(self, sensed: Sensed, score: Score) -> float:
        """The part that is left after a score's step."""
        stepped = {
            id: r + sensed.J[id] @ score.free + score.column.by[id] @ score.strengths
            for id, r in self.first.residual.items()
        }
        return self._part(self.of(stepped, sensed.J))

    def _size(self, id: str) -> float:
        return float(np.abs(self.first.inverse.grids[id].mean).max())

    def _squares(self, residual: Mapping[str, np.ndarray]) -> float:
        return sum(float(r @ r) / self._size(id) ** 2 for id, r in residual.items())
