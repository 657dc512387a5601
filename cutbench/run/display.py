"""A run in words, as a picture, as tables, as files."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from cutbench.run.figures.curve import FORCE, draw_force
from cutbench.run.files import write_run as write
from cutbench.run.result import Result, summary_lines

__all__ = ["dataset", "plot", "summary_lines", "table", "write"]


def plot(result: Result, ax: Axes) -> None:
    """Force over travel, or over time where the blade rests or turns, with onset and peak; of several runs,
    the name of each is in the legend."""
    several = any(line.get_gid() == FORCE for line in ax.lines)
    ax.set_title("" if several else result.name, loc="left")
    draw_force(ax, result)


def table(result: Result) -> dict[str, np.ndarray]:
    """The curve, a row a step; units in the names."""
    return dict(result.curve)


def dataset(result: Result) -> xr.Dataset:
    """The curve over its steps; the blade's travel and the time are coordinates."""
    data = xr.Dataset(attrs={"case": result.case.name, "run": result.id, "said": result.sentence()})
    for name, values in result.curve.items():
        head, _, unit = name.rpartition("_")
        known = unit in ("mm", "N", "s", "mJ")
        data[head if known else name] = ("step", values, {"units": unit if known else "1"})
    return data.set_coords(["displacement", "time"])
