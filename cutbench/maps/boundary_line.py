"""The line between the regimes in pictures, and the strips about it within which it may lie instead."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from scipy.interpolate import griddata
from scipy.spatial import QhullError

from cutbench.base.figure_style import Look
from cutbench.maps.plot_coordinates import SMALLEST_IN_LOG, edges, finer, is_log
from cutbench.maps.uncertainty import MODEL, NUMERICS, total_change, uncertainty_strips

#: The wide strip is drawn first: the one of numerics lies in that of both.
_STRIPS: dict[str, tuple[float, str]] = {
    MODEL: (0.38, "what the model leaves open may move it here"),
    NUMERICS: (0.5, "numerics may move it here"),
}


def _field(part: xr.Dataset, x: str, y: str) -> tuple[list[np.ndarray], np.ndarray, bool] | None:
    """Coordinates and the logarithm of measure over threshold between them, in the axes' own scales, and
    whether it is known everywhere; None where nothing can be drawn."""
    margin = part["drop_rel"] / part.attrs["drop_threshold"]
    if math.isfinite(part.attrs["surge_threshold"]):
        margin = np.minimum(margin, part["surge"] / part.attrs["surge_threshold"])
    z = margin.transpose(y, x).values
    if min(z.shape) < 2 or not np.isfinite(z).any():
        return None
    # A logarithm keeps a steep drop from pushing the line towards the smooth side.
    z = np.log(np.maximum(z, SMALLEST_IN_LOG))
    whole = bool(np.isfinite(z).all())
    if not whole:
        z = _fill(z)
    # The outer cells reach beyond their points: hold the value there, so that the line meets the frame.
    z = np.pad(z, 1, mode="edge")
    grids, logs = [], [is_log(part[n]) for n in (x, y)]
    for name, log in zip((x, y), logs, strict=True):
        e = edges(part[name].values, log)
        grids.append(np.concatenate([e[:1], part[name].values, e[-1:]]))
    *grids, z = finer(grids, logs, z)
    return grids, z, whole


def draw_line(ax: Axes, part: xr.Dataset, x: str, y: str) -> bool:
    """The line on which the measures pass the threshold; dashed, and True, where it bridges gaps."""
    found = _field(part, x, y)
    if found is None or not np.nanmin(found[1]) < 0 <= np.nanmax(found[1]):
        return False
    grids, z, whole = found
    lines = ax.contour(
        *grids, np.ma.masked_invalid(z), levels=[0.0], colors="black",
        linewidths=1.5 if whole else 1.2, linestyles="solid" if whole else "dashed", zorder=3,
    )  # fmt: skip
    if whole:
        lines.set_path_effects([patheffects.withStroke(linewidth=3.0, foreground="white")])
    return not whole


def draw_strips(ax: Axes, part: xr.Dataset, x: str, y: str) -> None:
    """Where the line may lie by numerics, and by numerics and what the model leaves open together.

    Between runs far from the line its estimate falls back to what it expects of any point: there the drop
    that lies between the runs says how far it is, where both are on one side.
    """
    found = _field(part, x, y)
    if found is None:
        return
    grids, z, _ = found
    if "drop_between" in part and (runs := _field(part.assign(drop_rel=part["drop_between"]), x, y)):
        farther = (np.sign(runs[1]) == np.sign(z)) & (np.abs(runs[1]) > np.abs(z))
        z = np.where(farther, runs[1], z)
    for strip in shown_strips(part):
        low, high = -strip["high"], -strip["low"]
        if low < high and np.nanmin(z) < high and np.nanmax(z) >= low:
            alpha, _ = _STRIPS[strip["cause"]]
            look: Look = {"levels": [low, high], "colors": ["white"], "alpha": alpha, "zorder": 2.4}
            ax.contourf(*grids, np.ma.masked_invalid(z), **look)


def shown_strips(data: xr.Dataset) -> list[dict]:
    """What pictures show, the widest first: ``cause``, ``text``, and ``low`` and ``high``: what the
    logarithm of measure over threshold may change by, of the model together with the numerics."""
    strips = uncertainty_strips(data)
    found = []
    for cause, (_, text) in _STRIPS.items():
        if cause in strips:
            low, high = total_change(strip for name, strip in strips.items() if cause in (name, MODEL))
            found.append({"cause": cause, "text": text, "low": low, "high": high})
    return found


def strip_handles(data: xr.Dataset) -> list[Patch]:
    """What the legend says of the strips that there are."""
    found, grey = [], 0.45
    for strip in shown_strips(data):  # each lies on the one before
        grey += (1 - grey) * _STRIPS[strip["cause"]][0]
        found.append(Patch(facecolor=str(round(grey, 3)), edgecolor="0.4", lw=0.5, label=strip["text"]))
    return found


def _fill(z: np.ndarray) -> np.ndarray:
    """``z`` with its gaps interpolated along the grid; those outside the known points stay nan."""
    known = np.isfinite(z)
    try:
        filled = griddata(np.argwhere(known), z[known], tuple(np.indices(z.shape)), method="linear")
    except QhullError:  # too few points, or all on a line
        return z
    return np.where(known, z, filled)
