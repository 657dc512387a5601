"""The atlas in place of runs of one's own: what it says of a campaign's cuts, and how surely."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cutbench.case.case import Case
from cutbench.emulator.alignment import main_parts
from cutbench.emulator.atlas import depth_of, row_of, shipped, space_of
from cutbench.emulator.database import TRAVEL_POINTS, Emulator, OutOfRange
from cutbench.emulator.groups import Groups


class AtlasCuts(Emulator):
    """An emulator of cuts like a case, with any values within the atlas. Raises NotInAtlas."""

    def __init__(self, case: Case):
        self.space, groups = space_of(case), Groups.of(case)
        assert groups is not None, "of the atlas' model"
        self.groups, self.model, self._depth = groups, case.model, depth_of(case)
        self.x = np.linspace(0.0, self._depth, TRAVEL_POINTS + 1)

    def forces(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        rows, force = self._rows(each), [self.groups.force(values) for values in each]
        m = shipped().measures(rows, np.full(len(rows), self._depth))
        there = np.broadcast_to(self.x, (len(rows), self.x.size))
        return np.array(force)[:, None] * shipped().forces(rows, m, there)

    def computed(self, values: Mapping[str, float]) -> None:
        """No run of the atlas is one of the campaign's."""

    def root(self, values: Mapping[str, float]) -> np.ndarray:
        """Compute a root of the covariance of the error of predicted forces. Gives (k, r)."""
        row = self._rows([values])
        m = shipped().measures(row, np.array([self._depth]))
        drawn = np.array(shipped().drawn(row, m, self.x))
        off = (drawn[1:] - drawn[0]) / math.sqrt(len(drawn) - 1)
        return self.groups.force(values) * main_parts(off.T)

    def onset_mm(self, values: Mapping[str, float]) -> float:
        """Predict where the cut begins."""
        m = shipped().measures(self._rows([values]), np.array([self._depth]))
        return math.exp(m.onset[0, 0]) * self.groups.length(values)

    def _rows(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        rows = []
        for values in each:
            found = self.space.of_values(self.groups, self.model, values)
            if beyond := self.space.beyond(found):
                raise OutOfRange(f"the atlas ends before: {', '.join(side.name for side, _ in beyond)}")
            rows.append(row_of(self.space, found))
        return np.array(rows, dtype=float)
