"""What a block's middle carries: the curve of a blade of which all were as its middle is.

The force per length there, times the length of the block, stands beside a section's force, which has no ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cutbench.run.build import Built
from cutbench.solver.march import Accepted

#: Unit and meaning of each number of ``Middle.measures``.
MIDDLE: dict[str, tuple[str, str]] = {
    "middle_onset_mm": ("mm", "blade travel at which the cut has begun in the middle of the block"),
    "middle_peak_N": ("N", "first prominent maximum of the force, were all of the blade as its middle"),
    "middle_max_N": ("N", "largest force, likewise"),
    "middle_steady_N": ("N", "steady force, likewise"),
    "middle_drop_rel": ("1", "relative fall of the force at the transition, likewise"),
}


class Middle:
    """Follows a run step by step, as the front does. ``share`` is the length in mm along the blade, in the
    meshed part, that the points within ``near`` mm of the middle stand for; ``before_mm`` how long the cut is
    there at the start."""

    def __init__(self, built: Built, near: float, share: float, before_mm: float):
        self._length, self._share = built.case.p.length, share
        # A mesh without a split has one side of the cut plane.
        self._sides = 1.0 if built.geometry.split else 2.0
        self._there = {blade.name: np.abs(blade.faces.X[2]) <= near for blade in built.blades}
        self._weights = {blade.name: blade.faces.w for blade in built.blades}
        self._rows: list[tuple[float, float]] = [(0.0, before_mm)]

    def state(self) -> np.ndarray:
        return np.array(self._rows)

    def restore(self, state: np.ndarray) -> None:
        self._rows = [(float(force), float(cut)) for force, cut in state]

    def add(self, step: Accepted, cut_mm: float) -> None:
        """Take one accepted step, after which the cut is ``cut_mm`` long in the middle."""
        force = 0.0
        for name, there in self._there.items():
            state = step.states[name]
            traction = state["normal_traction"][1] + state["shear"][1]
            force -= float((traction * self._weights[name])[there].sum())
        self._rows.append((force / self._share * self._sides * self._length, cut_mm))

    def columns(self) -> dict[str, np.ndarray]:
        """Columns for the curve of the run, a row a step."""
        force, cut = np.array(self._rows).T
        return {"middle_force_N": force, "middle_cut_length_mm": cut}

    def measures(
        self, travel_mm: np.ndarray, taken: Callable[[Mapping[str, np.ndarray]], dict[str, float]]
    ) -> dict[str, float]:
        """The numbers of ``MIDDLE`` over the first of the steps, as those of a curve are ``taken``."""
        force, cut = (column[: travel_mm.size] for column in self.columns().values())
        found = taken({"displacement_mm": travel_mm, "force_N": force, "cut_length_mm": cut})
        return {name: found[name.removeprefix("middle_")] for name in MIDDLE}
