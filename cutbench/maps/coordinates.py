"""Coordinates of a map as pictures need them: cell edges, scales, labels, and where materials lie."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator, RegularGridInterpolator

from cutbench.base.figure_style import Look

_HALO = [patheffects.withStroke(linewidth=2.2, foreground="white")]
MATERIAL: Look = {"marker": "D", "mfc": "#D55E00", "mec": "white", "ms": 6.0, "mew": 0.9, "ls": ""}


#: Levels of a continuous third axis that a picture shows.
PANELS = 6
#: Values below this are as good as none where their logarithm is taken.
LEAST = 1e-3
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
    if panel and panel in json.loads(data.attrs["continuous"]) and data.sizes[panel] > PANELS:
        estimated = estimated.isel(
            {panel: np.rint(np.linspace(0, data.sizes[panel] - 1, PANELS)).astype(int)}
        )
    return estimated, data


def between(data: xr.Dataset, name: str) -> xr.DataArray:
    """A variable between the points where it is known: linear in its logarithm on simplices in the axes' own
    scales, beyond them as at the nearest; nan everywhere if it is known nowhere."""
    values = data[name]
    places = np.argwhere(np.ones(values.shape)) / np.maximum(np.array(values.shape) - 1, 1)
    known = np.isfinite(values.values).ravel()
    if not known.any():
        return values
    size = np.log(np.maximum(values.values.ravel()[known], LEAST))
    if len(values.shape) == 1:
        return values.copy(data=np.exp(np.interp(places[:, 0], places[known, 0], size)))
    found = NearestNDInterpolator(places[known], size)(places)
    spread = np.linalg.matrix_rank(places[known] - places[known].mean(axis=0)) if known.sum() > 1 else 0
    if spread == len(values.shape):
        inner = LinearNDInterpolator(places[known], size)(places)
        found = np.where(np.isfinite(inner), inner, found)
    return values.copy(data=np.exp(found).reshape(values.shape))


def slab(whole: xr.Dataset, data: xr.Dataset, panel: str, level: int) -> xr.Dataset:
    """The part of ``whole`` that is nearer to this panel than to any other."""
    shown = [int(np.argmin(np.abs(whole[panel].values - v))) for v in data[panel].values]
    nearest = np.argmin(np.abs(np.arange(whole.sizes[panel])[:, None] - shown), axis=1)
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


def marks_of(data: xr.Dataset, x: str, y: str, panel: str) -> tuple[list[dict], list[str]]:
    """The materials of the study, each on the panel of the nearest level; and those outside the axes."""
    inside: list[dict] = []
    outside: list[str] = []
    for mark in json.loads(data.attrs["marks"]):
        ranges = [edges(data[n].values, is_log(data[n])) for n in (x, y) if n]
        here = [mark[n] for n in (x, y) if n]
        if not all(e[0] <= v <= e[-1] for e, v in zip(ranges, here, strict=True)):
            outside.append(mark["name"])
            continue
        level, text = 0, ""
        if panel:
            values = data[panel].values
            level = nearest_level(mark[panel], values)
            if abs(mark[panel] - values[level]) > 0.02 * max(abs(mark[panel]), abs(values[level])):
                text = f" ({mark[panel]:.2g})"
        text = mark["name"] + text
        for other in inside:
            # Where a picture lacks the axis that parts two materials, they share a mark.
            if other["panel"] == level and all(
                math.isclose(other[n], mark[n], rel_tol=0.02) for n in (x, y) if n
            ):
                other["text"] += f", {text}"
                break
        else:
            inside.append({**mark, "panel": level, "text": text})
    return inside, outside


def nearest_level(value: float, levels: Sequence[float] | np.ndarray) -> int:
    """Index of the nearest level; ratios count among positive levels, and zero is a level like any."""
    v = np.asarray(levels, dtype=float)
    positive = np.abs(v[v != 0])
    small = positive.min() if positive.size else 1.0
    return int(np.argmin(np.abs(np.arcsinh(v / small) - np.arcsinh(value / small))))


def draw_materials(ax: Axes, marks: list[Mapping], x: str, y: str, part: xr.Dataset) -> None:
    drop = part.attrs["drop_threshold"]
    for mark in marks:
        px, py = mark[x], (mark[y] if y else drop)
        ax.plot([px], [py], zorder=6, clip_on=False, **MATERIAL)
        # The label goes to the side with more room, above or below, away from the rows of markers.
        place = ax.transData.transform((px, py))
        right = ax.transAxes.inverted().transform(place)[0] < 0.6
        up = 1
        if y:
            points = ax.figure.dpi / 72
            rows = ax.transData.transform([(px, v) for v in part[y].values])[:, 1]
            free = {sign: np.abs(rows - (place[1] + sign * 9 * points)).min() for sign in (1, -1)}
            up = 1 if free[1] >= free[-1] else -1
        ax.annotate(
            mark["text"], (px, py), xytext=(5 if right else -5, 4 * up), textcoords="offset points",
            ha="left" if right else "right", va="bottom" if up > 0 else "top",
            fontsize=8.5, fontweight="bold", zorder=7, path_effects=_HALO,
        )  # fmt: skip
