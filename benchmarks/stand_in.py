"""Cuts by the atlas in place of runs, for ``benchmarks.blind --stand-in``: a search in one or two minutes.

They are the atlas' off by smooth errors of its own size, and jag as runs do, so that a search has to learn
them. Laws that the atlas has not change nothing. What a search gives on these is no result: they are for
working on a method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cutbench.calibration.cut_runs import ComputedCut
from cutbench.case.case import Case
from cutbench.emulator.atlas import row_of, shipped
from cutbench.emulator.design_space import BLADES, MAX_DEPTH
from cutbench.emulator.groups import Groups
from cutbench.run.result import Outcome

#: Error of onset and forces, as a part: the atlas' own (docs/validation/maps.md); and how much curves jag.
OFF, JAG = 0.06, 0.004


class StandIn:
    """Computes cuts as ``cutbench.calibration.cut_runs.compute_cut`` does, of one material a ``seed``;
    ``count``: how many."""

    def __init__(self, seed: int):
        rng, self.count = np.random.default_rng(seed), 0
        kernel = shipped().curves.kernels["onset"]
        assert kernel is not None, "enough cuts begin"
        self._lengths = np.array(kernel.lengths)
        self._waves = rng.standard_normal((40, self._lengths.size))  # as smooth as the atlas
        self._phases, self._sizes = rng.uniform(0, 2 * np.pi, (3, 40)), rng.standard_normal((3, 40))

    def __call__(
        self, case: Case, names: Sequence[str], added: Sequence[Any], folder: Path | None, effort: float = 0.0
    ) -> ComputedCut:
        self.count += 1
        course, onset = self._course(case)
        nothing = np.zeros(course.shape[1])
        slopes = {name: self._slope(case, name) for name in names}
        by_added = [dict.fromkeys(each.names, nothing) for each in added]
        return ComputedCut(course, _done(case), onset, slopes, by_added)

    def run_case(self, case: Case) -> SimpleNamespace:
        """Stands in for ``cutbench.run.run_case`` where a truth is computed."""
        (x, force, _), _ = self._course(case)
        return SimpleNamespace(curve={"displacement_mm": x, "force_N": force}, outcome=_done(case))

    def _slope(self, case: Case, name: str) -> np.ndarray:
        q, value = case.model.parameters()[name], case.values[name]
        step = 1e-3 * (abs(value) or abs(q.typical * q.factor) or 1.0)
        moved = replace(case, values={**case.values, name: value + step})
        # A run's derivatives are those of its equations, which do not jag.
        return (self._course(moved, 0.0)[0][1] - self._course(case, 0.0)[0][1]) / step

    def _course(self, case: Case, jag: float = JAG) -> tuple[np.ndarray, float]:
        """Travel, force and time (3, n), and where the cut begins; nan where it does not."""
        values = dict(case.values)
        for law in case.model.all:
            values |= law.like(case.p)
        tool, units, atlas = case.model.tool, Groups.of(case), shipped()
        assert tool is not None and units is not None, "a cut"
        space = BLADES.get(tool.name, BLADES["contact"])
        row = np.array([row_of(space, space.of_values(units, case.model, values))], dtype=float)
        place, depth = atlas.coordinates(row)[0], values["depth"] / units.length(values)
        measures = atlas.measures(row, np.array([min(depth, MAX_DEPTH)]), spread=False)
        begins, x, where = (
            math.exp(measures.onset[0, 0]),
            np.linspace(0, depth, 240),
            1e4 * float(place.sum()),
        )
        angles = self._waves @ (place / self._lengths) + self._phases
        later, stiffer, tougher = OFF * math.sqrt(2 / 40) * (self._sizes * np.cos(angles)).sum(axis=1)
        later += 0.3 * jag * math.sin(where)
        onset = begins * math.exp(later)
        there = np.where(x < onset, x * math.exp(-later), x - onset + begins)
        force = atlas.forces(row, measures, there[None])[0]
        force = force * np.exp(stiffer + tougher * np.clip((x - onset) / 4, 0, 1))
        force *= 1 + jag * np.sin(4 * np.pi * x + 0.1 * where)
        mm = units.length(values)
        course = np.stack([x * mm, force * units.force(values), x * mm / values["speed"]])
        return course, onset * mm if onset < depth else math.nan


def _done(case: Case) -> Outcome:
    return Outcome("done", "", reached_mm=case.values["depth"])
