"""The atlas in place of runs of one's own: what it says of a campaign's cuts, and how surely."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from cutbench.case.case import Case
from cutbench.emulator.alignment import main_parts
from cutbench.emulator.atlas import row_of, shipped, space_of
from cutbench.emulator.database import Emulator, OutOfRange
from cutbench.emulator.groups import Groups
from cutbench.emulator.settings import SETTINGS


class AtlasCuts(Emulator):
    """An emulator of cuts by the atlas.

    The model of ``cases`` is that of ``plain``, which the atlas has, perhaps with laws beside it that do what
    another value does. Raises NotInAtlas where it lacks ``plain``, ValueError where it does not say what a
    ``free`` parameter does.
    """

    def __init__(self, plain: Case, cases: Sequence[Case], free: Collection[str]):
        groups, (self._space, _) = Groups.of(cases[0]), space_of(plain)
        assert groups is not None, "of the atlas' model"
        self.groups, self.model = groups, cases[0].model
        self._equal, others = self.equal_laws(cases[0])
        of = self._space.parameters
        known = {
            *of.values(),
            groups.modulus,
            *others,
            *(n for law in self._equal for n in law.like(cases[0].p)),
        }
        if silent := [n for n in free if n in groups.powers and n not in known]:
            raise ValueError(f"no run tells what {', '.join(silent)} does")
        # Errors grow beyond the atlas, and a search ends there: only sizes that are given may lie beyond.
        searched = {*free, of["cohesion"], of["viscosity"]}
        self._margins = {name: SETTINGS.beyond for name, q in of.items() if q not in searched}
        ends = [c.values["depth"] / groups.length(c.values) for c in cases]
        self.x = np.linspace(0.0, max(ends), SETTINGS.points + 1)

    def forces(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        rows, depths = self._rows(each)
        there = np.broadcast_to(self.x, (len(rows), self.x.size))
        m = shipped().measures(rows, depths, spread=False)
        return self._units(each)[:, None] * shipped().forces(rows, m, there)

    def computed(self, values: Mapping[str, float]) -> None:
        """No run of the atlas is one of the campaign's."""

    def root(self, values: Mapping[str, float]) -> np.ndarray:
        """Compute a root of the covariance of the error of predicted forces. Gives (k, r)."""
        rows, depths = self._rows([values])
        drawn = shipped().drawn(rows, shipped().measures(rows, depths), self.x)
        off = (drawn[1:] - drawn[0]) / math.sqrt(len(drawn) - 1)
        return self._units([values])[0] * main_parts(off.T)

    def onset_mm(self, values: Mapping[str, float]) -> float:
        """Predict where the cut begins."""
        m = shipped().measures(*self._rows([values]), spread=False)
        return math.exp(m.onset[0, 0]) * self.groups.length(values)

    def _rows(self, each: Sequence[Mapping[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Groups (p, d) of the atlas, and depths (p,). Raises OutOfRange."""
        rows, depths = [], []
        for values in each:
            found = self._space.of_values(self.groups, self.model, self._with_equal_laws_replaced(values))
            if beyond := self._space.beyond(found, self._margins):
                raise OutOfRange(f"the atlas ends before: {', '.join(side.name for side, _ in beyond)}")
            rows.append(row_of(self._space, found))
            depths.append(values["depth"] / self.groups.length(values))
        return np.array(rows, dtype=float), np.array(depths)
