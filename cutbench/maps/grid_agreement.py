"""Hold a boundary that was sought against the map of a whole grid over the same axes."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from cutbench.base.errors import BadInput
from cutbench.maps.axes import Axis
from cutbench.maps.boundary import distance_to_boundary
from cutbench.maps.dataset import LABELS, axes_of, axis_of, places_of
from cutbench.run.measures import ABRUPT, SMOOTH


@dataclass(frozen=True)
class Agreement:
    """Counts of grid points: all with a regime, those farther than the tolerance from the boundary that was
    sought, and those of either that are on the other side. ``runs`` is what each took, ``whole`` what a grid
    as fine as this one takes over all of the search's box."""

    points: int
    far: int
    wrong: int
    wrong_far: int
    runs: tuple[int, int]
    whole: int

    def text(self) -> str:
        """In one sentence."""
        part = self.runs[0] / max(self.whole, 1)
        of_these = "" if self.runs[1] == self.whole else f", of which {self.runs[1]} are there"
        return (
            f"{self.runs[0]} runs of the search against {self.whole} of the grid{of_these} ({part:.3g}): the"
            f" regimes differ at {self.wrong} of {self.points} grid points, and at {self.wrong_far} of the"
            f" {self.far} farther from the boundary than the tolerance"
        )


def agreement(sought: xr.Dataset, grid: xr.Dataset) -> Agreement:
    """Compare at every point of ``grid``, which may cover a part of the box only.

    The distance is that from the boundary which the search found, in tolerances (Euclidean, each axis
    in units of its own). Raises BadInput unless ``sought`` was a search and both have the same axes.
    """
    names = axes_of(sought)
    if "margin" not in sought or sorted(axes_of(grid)) != sorted(names):
        raise BadInput(
            key="--against", value=grid.attrs["title"],
            expected=f"a grid over {', '.join(names)}, beside a map with mode = 'boundary'",
        )  # fmt: skip
    free = json.loads(sought.attrs["continuous"])
    axes = {name: axis_of(sought, name) for name in names}
    at = places_of(grid)
    labels = grid["label"].values
    decided = np.isin(labels, [LABELS.index(ABRUPT), LABELS.index(SMOOTH)])
    counts = np.zeros(4, dtype=int)
    fixed = [n for n in names if n not in free]
    for values in itertools.product(*(sought[name].values for name in fixed)):
        level = dict(zip(fixed, values, strict=True))
        part = sought[["margin"]].sel(level).transpose(*free)
        here = decided.copy()
        for name, value in level.items():
            here &= np.isclose(at[name], value)
        if not here.any():
            continue
        ticks = [np.array([axes[n].place(v) for v in part[n].values]) for n in free]
        x = np.stack([[axes[n].place(v) for v in at[n][here]] for n in free], axis=1)
        inside = ((x > -1e-6) & (x < 1 + 1e-6)).all(axis=1)
        x = np.clip(x, 0, 1)
        margin = RegularGridInterpolator(ticks, part["margin"].values)(x)
        # Lattice steps are half tolerances.
        away = RegularGridInterpolator(
            ticks, np.minimum(distance_to_boundary(part["margin"].values >= 0) / 2, 1e9)
        )(x)
        off = ((margin >= 0) != (labels[here] == LABELS.index(ABRUPT))) & inside
        beyond = (away > 1) & inside
        counts += np.sum([inside, beyond, off, off & beyond], axis=1)
    ran, gridded = (int((data["run_id"].values != "").sum()) for data in (sought, grid))
    whole = math.prod(_points(axes[n], grid[n].values) if n in free else len(axes[n].values) for n in names)
    points, far, wrong, wrong_far = map(int, counts)
    return Agreement(points, far, wrong, wrong_far, (ran, gridded), whole)


def _points(axis: Axis, values: np.ndarray) -> int:
    """Points over all of an axis that are as close as a grid's ``values``, which cover a part of it."""
    if values.size < 2:
        return 1
    step = (axis.place(values.max()) - axis.place(values.min())) / (np.unique(values).size - 1)
    return round(1 / step) + 1
