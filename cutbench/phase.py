"""The phase diagram: where cutting is smooth and where it is abrupt, from a map.

One panel a level of the third axis; the cells show the relative force drop, the line where it
passes the study's threshold, the markers what was computed. It reads in grey: the colours run
monotonically from light to dark, and the regimes differ by filled and open markers.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib import colormaps, patheffects
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.interpolate import griddata
from scipy.spatial import QhullError

from cutbench.curve import ABRUPT, SMOOTH, UNCUT
from cutbench.maps import LABELS, NOT_COMPUTED, OUTCOME_FLAGS
from cutbench.plots.style import DOUBLE_MM, new_figure, save, style

#: Light (no drop) to dark; the darkest and lightest ends are left out so that markers and lines show.
DROPS = LinearSegmentedColormap.from_list("drops", colormaps["cividis_r"](np.linspace(0.06, 0.9, 256)))

_HALO = [patheffects.withStroke(linewidth=2.2, foreground="white")]
_MARKERS = {
    ABRUPT: {"marker": "o", "mfc": "black", "mec": "white", "ms": 4.2, "mew": 0.6, "label": "abrupt"},
    SMOOTH: {"marker": "o", "mfc": "white", "mec": "black", "ms": 3.8, "mew": 0.7, "label": "smooth"},
    UNCUT: {"marker": "_", "mfc": "black", "mec": "black", "ms": 5, "mew": 1.0, "label": "no cut"},
    NOT_COMPUTED: {"marker": "x", "mec": "0.35", "ms": 4, "mew": 0.9, "label": "not computed"},
}
MISSING = "to come"
_MARKERS[MISSING] = {"marker": ".", "mec": "0.55", "mfc": "0.55", "ms": 3.5, "mew": 0.0, "label": MISSING}
_MATERIAL = {"marker": "D", "mfc": "#D55E00", "mec": "white", "ms": 6.0, "mew": 0.9, "ls": ""}


def draw_phase(data: xr.Dataset) -> Figure:
    """The figure of a map as ``cutbench.maps.build_map`` makes it, complete or not."""
    data, fixed = _reduce(data)
    x, y, panel = (data.attrs[f"plot_{name}"] for name in ("x", "y", "panel"))
    levels = [None] if not panel else list(range(data.sizes[panel]))
    columns = 2 if len(levels) == 4 else min(3, len(levels))
    rows = math.ceil(len(levels) / columns)
    with style():
        figure = new_figure(DOUBLE_MM, (66 if columns > 1 else 84) * rows + 16)
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        top = _top(data)
        marks, outside = _marks(data, x, y, panel)
        seen: set[str] = set()
        image, bridged = None, False
        for k, ax in enumerate(axes.flat):
            if k >= len(levels):
                ax.set_visible(False)
                continue
            part = data if levels[k] is None else data.isel({panel: levels[k]})
            if y:
                image = _cells(ax, part, x, y, top)
                bridged |= _boundary(ax, part, x, y)
            else:
                _profile(ax, part, x)
            seen |= _points(ax, part, x, y)
            _materials(ax, [m for m in marks if m["panel"] == (levels[k] or 0)], x, y, part)
            _title(ax, data, panel, levels[k], k if len(levels) > 1 else None)
            if k // columns == rows - 1 or k + columns >= len(levels):
                ax.set_xlabel(_axis_text(data[x]))
                ax.tick_params(labelbottom=True)
            if k % columns == 0:
                ax.set_ylabel(_axis_text(data[y]) if y else "relative force drop")
        if image is not None:
            bar = figure.colorbar(image, ax=list(axes.flat), pad=0.015, aspect=28, shrink=0.96)
            bar.set_label("relative force drop")
            bar.ax.axhline(data.attrs["drop_threshold"], color="black", lw=1.4)
            bar.outline.set_linewidth(0.6)
        _legend(figure, data, seen, bool(marks), bool(y), bridged)
        note = "; ".join([*fixed, *([f"outside the map: {', '.join(outside)}"] if outside else [])])
        if note:
            figure.supxlabel(note, fontsize=7.5, color="0.3")
    return figure


def save_phase(data: xr.Dataset, folder: str | Path) -> list[Path]:
    """Write ``phase.png`` and ``phase.svg`` into ``folder``; returns their paths."""
    return save(draw_phase(data), Path(folder) / "phase.png", also=("svg",))


def _reduce(data: xr.Dataset) -> tuple[xr.Dataset, list[str]]:
    """Fix the axes that a plane picture cannot show at their middle value, and say so."""
    shown = {data.attrs[f"plot_{name}"] for name in ("x", "y", "panel")}
    texts = []
    for dim in list(data["label"].dims):
        if dim not in shown:
            value = data[dim].values[data.sizes[dim] // 2]
            texts.append(f"at {_symbol(data[dim])} = {value:.3g}{_unit(data[dim])}")
            data = data.isel({dim: data.sizes[dim] // 2})
    return data, texts


def _top(data: xr.Dataset) -> float:
    """Upper end of the colour scale: the tenth above the largest drop, at least twice the threshold."""
    drop = data["drop_rel"].values
    largest = float(np.nanmax(drop)) if np.isfinite(drop).any() else 0.0
    return min(1.0, max(math.ceil(10 * largest - 1e-9) / 10, 2 * data.attrs["drop_threshold"]))


def _edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Cell boundaries half way between points, on the axis' own scale; the outer ones as far out."""
    v = np.log(values) if log else np.asarray(values, dtype=float)
    if v.size == 1:
        half = 0.5 if log or v[0] == 0 else 0.1 * abs(v[0])
        e = np.array([v[0] - half, v[0] + half])
    else:
        mid = (v[1:] + v[:-1]) / 2
        e = np.concatenate([[2 * v[0] - mid[0]], mid, [2 * v[-1] - mid[-1]]])
    return np.exp(e) if log else e


def _log(coordinate: xr.DataArray) -> bool:
    return coordinate.attrs.get("scale") == "log"


def _scale(ax: Axes, which: str, coordinate: xr.DataArray) -> None:
    """A log axis with plain numbers: 1 2 5 10 over less than two decades, else 0.1 1 10."""
    if not _log(coordinate):
        return
    getattr(ax, f"set_{which}scale")("log")
    decades = math.log10(coordinate.values[-1] / coordinate.values[0])
    axis = getattr(ax, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 2 else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _cells(ax: Axes, part: xr.Dataset, x: str, y: str, top: float):
    for name, which in ((x, "x"), (y, "y")):
        _scale(ax, which, part[name])
    drop = part["drop_rel"].transpose(y, x).values
    ax.set_facecolor("0.93")
    image = ax.pcolormesh(
        _edges(part[x].values, _log(part[x])),
        _edges(part[y].values, _log(part[y])),
        np.ma.masked_invalid(drop),
        cmap=DROPS,
        vmin=0,
        vmax=top,
        edgecolors="white",
        linewidth=0.25,
        rasterized=True,
    )
    for which, edges in (("x", part[x]), ("y", part[y])):
        e = _edges(edges.values, _log(edges))
        getattr(ax, f"set_{which}lim")(e[0], e[-1])
        getattr(ax, f"{which}axis").set_tick_params(which="minor", size=1.5, width=0.4)
    return image


def _boundary(ax: Axes, part: xr.Dataset, x: str, y: str) -> bool:
    """The line on which the measures pass the threshold; dashed, and True, where it bridges gaps."""
    margin = part["drop_rel"] / part.attrs["drop_threshold"]
    if math.isfinite(part.attrs["surge_threshold"]):
        margin = np.minimum(margin, part["surge"] / part.attrs["surge_threshold"])
    z = margin.transpose(y, x).values
    finite = z[np.isfinite(z)]
    if min(z.shape) < 2 or finite.size == 0 or not finite.min() < 1 <= finite.max():
        return False
    # A logarithm keeps a steep drop from pushing the line towards the smooth side.
    z = np.log(np.maximum(z, 1e-3))
    whole = np.isfinite(z).all()
    if not whole:
        z = _fill(z)
    # The outer cells reach beyond their points: hold the value there, so that the line meets the frame.
    z = np.pad(z, 1, mode="edge")
    grids = []
    for name in (x, y):
        edges = _edges(part[name].values, _log(part[name]))
        grids.append(np.concatenate([edges[:1], part[name].values, edges[-1:]]))
    lines = ax.contour(
        *grids, np.ma.masked_invalid(z), levels=[0.0], colors="black",
        linewidths=1.5 if whole else 1.2, linestyles="solid" if whole else "dashed", zorder=3,
    )  # fmt: skip
    if whole:
        lines.set_path_effects([patheffects.withStroke(linewidth=3.0, foreground="white")])
    return not whole


def _fill(z: np.ndarray) -> np.ndarray:
    """``z`` with its gaps interpolated along the grid; those outside the known points stay nan."""
    known = np.isfinite(z)
    try:
        filled = griddata(np.argwhere(known), z[known], tuple(np.indices(z.shape)), method="linear")
    except QhullError:  # too few points, or all on a line
        return z
    return np.where(known, z, filled)


def _profile(ax: Axes, part: xr.Dataset, x: str) -> None:
    """A map of one axis: the drop itself, with the threshold as a line."""
    _scale(ax, "x", part[x])
    ax.plot(part[x].values, part["drop_rel"].values, "-", color="0.3", lw=1.0)
    ax.axhline(part.attrs["drop_threshold"], color="black", lw=1.2, ls="--")
    ax.set_ylim(-0.04, None)


def _points(ax: Axes, part: xr.Dataset, x: str, y: str) -> set[str]:
    """Markers of the regimes; returns those that occur."""
    seen = set()
    dims = [y, x] if y else [x]
    labels, outcome = (part[name].transpose(*dims).values for name in ("label", "outcome"))
    missing = outcome == OUTCOME_FLAGS.index("missing")
    which = {name: (labels == k) & ~missing for k, name in enumerate(LABELS)} | {MISSING: missing}
    for name, where in which.items():
        hits = np.argwhere(where)
        if hits.size == 0:
            continue
        seen.add(name)
        xs = part[x].values[hits[:, -1]]
        ys = part[y].values[hits[:, 0]] if y else np.nan_to_num(part["drop_rel"].values[hits[:, 0]])
        kwargs = {key: value for key, value in _MARKERS[name].items() if key != "label"}
        ax.plot(xs, ys, ls="", zorder=4, clip_on=False, **kwargs)
    return seen


def _marks(data: xr.Dataset, x: str, y: str, panel: str) -> tuple[list[dict], list[str]]:
    """The materials of the study, each on the panel of the nearest level; and those outside the axes."""
    inside, outside = [], []
    for mark in json.loads(data.attrs["marks"]):
        ranges = [_edges(data[n].values, _log(data[n])) for n in (x, y) if n]
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


def nearest_level(value: float, levels: Sequence[float]) -> int:
    """Index of the nearest level; ratios count among positive levels, and zero is a level like any."""
    v = np.asarray(levels, dtype=float)
    positive = np.abs(v[v != 0])
    small = positive.min() if positive.size else 1.0
    return int(np.argmin(np.abs(np.arcsinh(v / small) - np.arcsinh(value / small))))


def _materials(ax: Axes, marks: list[Mapping], x: str, y: str, part: xr.Dataset) -> None:
    drop = part.attrs["drop_threshold"]
    for mark in marks:
        px, py = mark[x], (mark[y] if y else drop)
        ax.plot([px], [py], zorder=6, clip_on=False, **_MATERIAL)
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


def _title(ax: Axes, data: xr.Dataset, panel: str, level: int | None, number: int | None) -> None:
    if number is not None:
        ax.set_title(chr(ord("a") + number), loc="left", fontweight="bold")
    if level is not None:
        value = data[panel].values[level]
        ax.set_title(f"{_symbol(data[panel])} = {value:.3g}{_unit(data[panel])}", fontsize=8.5)


def _symbol(coordinate: xr.DataArray) -> str:
    return coordinate.attrs.get("symbol") or str(coordinate.name)


def _unit(coordinate: xr.DataArray) -> str:
    unit = coordinate.attrs.get("units", "1")
    return "" if unit == "1" else f" {unit}"


def _axis_text(coordinate: xr.DataArray) -> str:
    unit = _unit(coordinate).strip()
    return f"{coordinate.attrs['long_name']}  {_symbol(coordinate)}" + (f" [{unit}]" if unit else "")


def _legend(
    figure: Figure, data: xr.Dataset, seen: set[str], materials: bool, plane: bool, bridged: bool
) -> None:
    handles = [
        Line2D([], [], ls="", **_MARKERS[name])
        for name in (ABRUPT, SMOOTH, UNCUT, NOT_COMPUTED, MISSING)
        if name in seen
    ]
    text = f"boundary: drop of {100 * data.attrs['drop_threshold']:g} %"
    if math.isfinite(data.attrs["surge_threshold"]):
        text += f", surge of {data.attrs['surge_threshold']:g}"
    handles.append(Line2D([], [], color="black", lw=1.5, ls="-" if plane else "--", label=text))
    if bridged:
        handles.append(Line2D([], [], color="black", lw=1.2, ls="--", label="interpolated"))
    if materials:
        handles.append(Line2D([], [], label="material", **_MATERIAL))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=len(handles) if len(handles) < 6 else math.ceil(len(handles) / 2),
        columnspacing=1.6,
        handletextpad=0.5,
    )
