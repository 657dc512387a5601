"""Coordinates of a map as pictures need them: cell edges, scales, labels, colours of the drop."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator, RegularGridInterpolator

from cutbench.maps.dataset import ESTIMATE

#: Light (no drop) to dark; the darkest and lightest ends are left out so that markers and lines show.
DROP_COLOURS = LinearSegmentedColormap.from_list("drops", colormaps["cividis_r"](np.linspace(0.06, 0.9, 256)))
#: Levels of a continuous third axis that a picture shows.
MAX_PANELS = 6
#: Values below this are as good as none where their logarithm is taken.
SMALLEST_IN_LOG = 1e-3
#: Pieces that a whole axis is contoured in at the least.
_PIECES = 128


def panels_of(data: xr.Dataset, panel: str) -> tuple[xr.Dataset, xr.Dataset]:
    """The panels that are drawn, and the whole.

    Where the boundary was sought, the panels have the drop that its estimate says, which draws the line, and
    as ``drop_between`` what lies between the runs: far from the boundary the estimate knows the side alone.
    """
    if "margin" not in data:
        return data, data
    margin = data["margin"].clip(-0.995, 0.995)
    estimated = data.assign(
        drop_rel=np.minimum(data.attrs["drop_threshold"] * np.exp(np.arctanh(margin)), 1.0)
    )
    estimated["drop_rel"].attrs = data["drop_rel"].attrs
    estimated.attrs = data.attrs | {"surge_threshold": math.nan}
    estimated["drop_between"] = between(data, "drop_rel")
    if panel and panel in json.loads(data.attrs["continuous"]) and data.sizes[panel] > MAX_PANELS:
        estimated = estimated.isel(
            {panel: np.rint(np.linspace(0, data.sizes[panel] - 1, MAX_PANELS)).astype(int)}
        )
    return estimated, data


def between(data: xr.Dataset, name: str) -> xr.DataArray:
    """A variable between the points where it is known: linear in its logarithm on simplices in the axes' own
    scales, beyond them as at the nearest; nan everywhere if it is known nowhere. Where it was thought to be
    something everywhere beforehand, that: runs of such a search lie along the boundary alone."""
    if f"{name}_expected" in data:
        return data[f"{name}_expected"]
    values = data[name]
    places = np.argwhere(np.ones(values.shape)) / np.maximum(np.array(values.shape) - 1, 1)
    finite = np.isfinite(values.values).ravel()
    if not finite.any():
        return values
    logarithms = np.log(np.maximum(values.values.ravel()[finite], SMALLEST_IN_LOG))
    if len(values.shape) == 1:
        return values.copy(data=np.exp(np.interp(places[:, 0], places[finite, 0], logarithms)))
    filled = NearestNDInterpolator(places[finite], logarithms)(places)
    spread = np.linalg.matrix_rank(places[finite] - places[finite].mean(axis=0)) if finite.sum() > 1 else 0
    if spread == len(values.shape):
        inner = LinearNDInterpolator(places[finite], logarithms)(places)
        filled = np.where(np.isfinite(inner), inner, filled)
    return values.copy(data=np.exp(filled).reshape(values.shape))


def slab(whole: xr.Dataset, data: xr.Dataset, panel: str, level: int) -> xr.Dataset:
    """The part of ``whole`` that is nearer to this panel than to any other."""
    places = [int(np.argmin(np.abs(whole[panel].values - v))) for v in data[panel].values]
    nearest = np.argmin(np.abs(np.arange(whole.sizes[panel])[:, None] - places), axis=1)
    return whole.isel({panel: np.flatnonzero(nearest == level)})


def edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Cell boundaries half way between points, on the axis' own scale; the outer ones as far out."""
    v = np.log(values) if log else np.asarray(values, dtype=float)
    if v.size == 1:
        half = 0.5 if log or v[0] == 0 else 0.1 * abs(v[0])
        e = np.array([v[0] - half, v[0] + half])
    else:
        mid = (v[1:] + v[:-1]) / 2
        e = np.concatenate([[2 * v[0] - mid[0]], mid, [2 * v[-1] - mid[-1]]])
    return np.exp(e) if log else e


def finer(ticks: Sequence[np.ndarray], logs: Sequence[bool], z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Ticks of both axes, x first, and z (y, x), so fine that a contour is straight in the axes' own scales.

    Matplotlib finds a contour between points linearly in what it is given, which on a log axis of a few
    points is far off.
    """
    own = [np.log(t) if log else np.asarray(t, dtype=float) for t, log in zip(ticks, logs, strict=True)]
    fine = []
    for t in own:
        parts = max(1, math.ceil(_PIECES / (t.size - 1)))
        fine.append(np.interp(np.arange(parts * (t.size - 1) + 1) / parts, np.arange(t.size), t))
    v, u = np.meshgrid(fine[1], fine[0], indexing="ij")
    between = RegularGridInterpolator((own[1], own[0]), z)((v, u))
    return *(np.exp(t) if log else t for t, log in zip(fine, logs, strict=True)), between


def is_log(coordinate: xr.DataArray) -> bool:
    """Whether the axis has a logarithmic scale."""
    return coordinate.attrs.get("scale") == "log"


def set_scale(ax: Axes, which: str, coordinate: xr.DataArray) -> None:
    """The axis' own scale."""
    if is_log(coordinate):
        plain_log(ax, which, float(coordinate.values[0]), float(coordinate.values[-1]))


def drops_over(ax: Axes, coordinate: xr.DataArray) -> None:
    """The scales of drops over a coordinate, without room for what cannot be."""
    low, high = float(coordinate.min()), float(coordinate.max())
    margin = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    ax.set_xlim(low - margin if low < 0 else max(low - margin, 0.0), high + margin)
    ax.set_ylim(bottom=0.0)
    set_scale(ax, "x", coordinate.sortby(coordinate))


def plain_log(ax: Axes, which: str, low: float, high: float) -> None:
    """A log axis with plain numbers: 1 2 5 10 over less than two decades, else 0.1 1 10."""
    getattr(ax, f"set_{which}scale")("log")
    getattr(ax, f"set_{which}lim")(low, high)
    axis = getattr(ax, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if math.log10(high / low) < 2 else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def symbol(coordinate: xr.DataArray) -> str:
    """How pictures write the axis' quantity."""
    return coordinate.attrs.get("symbol") or str(coordinate.name)


def unit_of(coordinate: xr.DataArray) -> str:
    """Its unit after a number: a space and the unit, or nothing."""
    unit = coordinate.attrs.get("units", "1")
    return "" if unit == "1" else f" {unit}"


def axis_text(coordinate: xr.DataArray) -> str:
    """Name, symbol and unit beside an axis."""
    if coordinate.attrs.get("mechanism"):
        return f"{coordinate.attrs['long_name']} (0: no, 1: yes)"
    unit = unit_of(coordinate).strip()
    return f"{coordinate.attrs['long_name']}  {symbol(coordinate)}" + (f" [{unit}]" if unit else "")


def drop_text(data: xr.Dataset) -> str:
    """What a map's colours are: of a boundary that was sought from the atlas, what that expects."""
    expected = "drop_rel_expected" in data and not data.attrs[ESTIMATE]
    return "relative force drop" + expected * ", as estimated beforehand"


def nearest_level(value: float, levels: Sequence[float] | np.ndarray) -> int:
    """Index of the nearest level; ratios count among positive levels, and zero is a level like any."""
    v = np.asarray(levels, dtype=float)
    positive = np.abs(v[v != 0])
    small = positive.min() if positive.size else 1.0
    return int(np.argmin(np.abs(np.arcsinh(v / small) - np.arcsinh(value / small))))
