"""The phase diagram: where cutting is smooth and where it is abrupt, from a map.

One panel a level of the third axis; the cells show the relative force drop, the line where it
passes the study's threshold, the markers what was computed, a thin line what the classical estimates
say. Where the boundary was sought, the line is estimated from the runs, and the cells from these or, where
it says something of the study, from the atlas. What is not known
with 95 % is hatched. Strips about the line say how far it may be off. It reads in grey: the colours run
monotonically from light to dark, and the regimes differ by filled and open markers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.interpolate import griddata
from scipy.spatial import QhullError

from cutbench.base.figure_style import (
    DOUBLE_MM,
    Look,
    Size,
    legend_in_rows,
    new_figure,
    one_type,
    save,
    sized,
    style,
)
from cutbench.maps.axes import BOUNDARY
from cutbench.maps.boundary import NORMAL_QUANTILE
from cutbench.maps.closed_form_estimates import margin_on_grid
from cutbench.maps.dataset import ESTIMATE, LABELS, NOT_COMPUTED, OUTCOME_FLAGS, axes_of, places_of
from cutbench.maps.markers import (
    FOLDER,
    RECORD,
    confirmed_handles,
    draw_confirmed,
    draw_materials,
    label_materials,
    marks_of,
    material_handles,
    read_confirmed,
)
from cutbench.maps.plot_coordinates import (
    DROP_COLOURS,
    SMALLEST_IN_LOG,
    axis_text,
    drop_text,
    drops_over,
    edges,
    finer,
    is_log,
    panels_of,
    set_scale,
    slab,
    symbol,
    unit_of,
)
from cutbench.maps.uncertainty import MODEL, NUMERICS, total_change, uncertainty_strips
from cutbench.run.measures import ABRUPT, SMOOTH, UNCUT, UNDECIDED

MISSING = "to come"
_MARKERS: dict[str, Look] = {
    ABRUPT: {"marker": "o", "mfc": "black", "mec": "white", "ms": 4.2, "mew": 0.6, "label": "abrupt"},
    SMOOTH: {"marker": "o", "mfc": "white", "mec": "black", "ms": 3.8, "mew": 0.7, "label": "smooth"},
    UNDECIDED: {"marker": "o", "mfc": "0.6", "mec": "black", "ms": 4.0, "mew": 0.7, "label": "undecided"},
    UNCUT: {"marker": "s", "mfc": "white", "mec": "black", "ms": 3.8, "mew": 0.7, "label": "not cut"},
    NOT_COMPUTED: {"marker": "x", "mec": "0.35", "ms": 4, "mew": 0.9, "label": "not computed"},
    MISSING: {"marker": ".", "mec": "0.55", "mfc": "0.55", "ms": 3.5, "mew": 0.0, "label": MISSING},
}
_DASHES = (0, (4, 1.5, 1, 1.5))


def draw_phase(data: xr.Dataset, confirmed: Sequence[Mapping] = (), size: Size | None = None) -> Figure:
    """The figure of a map as ``cutbench.maps.dataset.build_map`` makes it, complete or not.

    ``confirmed``: points run in three dimensions, as ``read_confirmed`` gives them; grids show them.
    """
    if list(data["label"].dims) != axes_of(data):
        return draw_samples(data, size)
    whole, fixed = _reduce(data)
    x, y, panel = (whole.attrs[f"plot_{name}"] for name in ("x", "y", "panel"))
    data, whole = panels_of(whole, panel)
    panels = data.sizes[panel] if panel else 1
    short = size is not None and panels > 1
    with style(size):
        figure, axes = _panels(panels, size)
        top = _top(whole)
        marks, outside = marks_of(data, x, y, panel)
        seen: set[str] = set()
        solid: set[str] = set()
        image, bridged, classical = None, False, False
        for k, ax in enumerate(axes.flat):
            if k >= panels:
                ax.set_visible(False)
                continue
            part = data.isel({panel: k}) if panel else data
            image, dashed = _draw_measures(ax, part, x, y, top)
            bridged |= dashed
            classical |= bool(y) and _classical(ax, part, x, y)
            seen |= _points(ax, slab(whole, data, panel, k) if panel else part, x, y)
            draw_materials(ax, [m for m in marks if m["panel"] == k], x, y, part, top)
            solid |= draw_confirmed(ax, confirmed, part, x, y, (panel, k, data[panel or x]))
            _title(ax, data, panel, k, lettered=panels > 1, short=short)
        if image is not None:
            bar = figure.colorbar(image, ax=list(axes.flat), pad=0.015, aspect=28, shrink=0.96)
            bar.set_label(drop_text(data).replace(", ", ",\n"))
            bar.ax.axhline(data.attrs["drop_threshold"], color="black", lw=1.4)
            bar.outline.set_linewidth(0.6)
        extra = [*material_handles(marks, top), *confirmed_handles(solid)]
        if short and not data[panel].attrs.get("mechanism"):
            # What the numbers over short panels are.
            extra.append(Line2D([], [], ls="", label=f"a, b, …: {symbol(data[panel])}"))
        _legend(figure, data, seen, bool(y), bridged, classical, extra, size)
        note = "; ".join([*fixed, *([f"outside the map: {', '.join(outside)}"] if outside else [])])
        drawn = axis_text(data[y]) if y else "relative force drop"
        _label(figure, axes, panels, axis_text(data[x]), drawn, note, short=short)
        one_type(figure, size)
        figure.draw_without_rendering()
        for k, ax in enumerate(axes.flat[:panels]):
            part = data.isel({panel: k}) if panel else data
            text_pt = size.text_pt if size else 8.5
            label_materials(ax, [m for m in marks if m["panel"] == k], x, y, part, text_pt)
    return figure


def draw_plane(ax: Axes, data: xr.Dataset) -> None:
    """One plane of a map into ``ax``: drops, boundary, strips, runs; of further axes the first level."""
    if list(data["label"].dims) != axes_of(data):
        x, y = (data.attrs[f"plot_{name}"] for name in ("x", "y"))
        places, drop = places_of(data), data["drop_rel"].values
        ax.scatter(places[x], places[y] if y else drop, c=drop, cmap=DROP_COLOURS)
        ax.set(xlabel=axis_text(data[x]), ylabel=axis_text(data[y]) if y else "relative force drop")
        return
    whole, fixed = _reduce(data)
    x, y, panel = (whole.attrs[f"plot_{name}"] for name in ("x", "y", "panel"))
    one, whole = panels_of(whole, panel)
    part = one.isel({panel: 0}) if panel else one
    if panel:
        fixed.append(f"at {symbol(one[panel])} = {float(one[panel].values[0]):.3g}{unit_of(one[panel])}")
    _draw_measures(ax, part, x, y, _top(whole))
    _points(ax, slab(whole, one, panel, 0) if panel else part, x, y)
    ax.set(xlabel=axis_text(data[x]), ylabel=axis_text(data[y]) if y else "relative force drop")
    ax.set_title("; ".join(fixed), loc="left")


def save_phase(data: xr.Dataset, folder: str | Path, record: Path | None = None) -> list[Path]:
    """Draw the phase diagram of a map into ``phase.png`` and ``phase.svg``; with points that were confirmed
    in three dimensions, as ``record`` has them, confirm/confirm.json in ``folder`` unless it is named.
    Raises BadInput."""
    record = record or Path(folder) / FOLDER / RECORD
    figure = draw_phase(data, read_confirmed(record, data))
    return save(figure, Path(folder) / "phase.png", also=("svg",))


def _reduce(data: xr.Dataset) -> tuple[xr.Dataset, list[str]]:
    """Fix the axes that a plane picture cannot show at their middle value, and say so."""
    drawn = {data.attrs[f"plot_{name}"] for name in ("x", "y", "panel")}
    texts = []
    for dim in list(data["label"].dims):
        if dim not in drawn:
            value = data[dim].values[data.sizes[dim] // 2]
            texts.append(f"at {symbol(data[dim])} = {value:.3g}{unit_of(data[dim])}")
            data = data.isel({dim: data.sizes[dim] // 2})
    return data, texts


def _panels(panels: int, size: Size | None) -> tuple[Figure, np.ndarray]:
    """A figure for so many panels of a plane, and their axes (rows, columns)."""
    columns = 2 if panels == 4 else min(3, panels)
    if size is not None and size.height_mm is None:
        columns = 1 if panels < 4 else 2
    rows = math.ceil(panels / columns)
    if size is None:
        figure = new_figure(DOUBLE_MM, (66 if columns > 1 else 84) * rows + 16)
    else:
        figure = sized(size, (62 if columns == 1 else 40) * rows + 34)
    return figure, figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)


def _title(ax: Axes, data: xr.Dataset, panel: str, level: int, *, lettered: bool, short: bool) -> None:
    """Letter and level of a panel; ``short``: the level's number alone, whose name the legend says."""
    letter = chr(ord("a") + level) if lettered else ""
    value = data[panel].values[level] if panel else math.nan
    if panel and (mechanism := data[panel].attrs.get("mechanism")):
        text = f"{'with' if value else 'without'} {mechanism}"
    elif panel:
        name = "" if short and lettered else f"{symbol(data[panel])} = "
        text = f"{name}{value:.3g}{unit_of(data[panel])}"
    else:
        text = ""
    if letter and short:
        ax.set_title(f"{letter}: {text}", loc="left")
        return
    ax.set_title(letter, loc="left", fontweight="bold")
    ax.set_title(text, fontsize=8.5)


def _label(figure: Figure, axes: np.ndarray, panels: int, x: str, y: str, note: str, *, short: bool) -> None:
    """What the axes are: on the outer ones, or once where ``short``; a ``note`` below."""
    columns = axes.shape[1]
    for k, ax in enumerate(axes.flat[:panels]):
        if k // columns == len(axes) - 1 or k + columns >= panels:
            ax.tick_params(labelbottom=True)
            if not short:
                ax.set_xlabel(x)
        if k % columns == 0 and not short:
            ax.set_ylabel(y)
    if short:
        figure.supylabel(y)
        figure.supxlabel(f"{x}\n{note}" if note else x)
    elif note:
        figure.supxlabel(note, fontsize=7.5, color="0.3")


def _top(data: xr.Dataset) -> float:
    """Upper end of the colour scale: the tenth above the largest drop, at least twice the threshold."""
    drop = np.concatenate([data[n].values.ravel() for n in ("drop_rel", "drop_rel_expected") if n in data])
    largest = float(np.nanmax(drop)) if np.isfinite(drop).any() else 0.0
    return min(1.0, max(math.ceil(10 * largest - 1e-9) / 10, 2 * data.attrs["drop_threshold"]))


def _cells(ax: Axes, part: xr.Dataset, x: str, y: str, top: float) -> ScalarMappable:
    for name, which in ((x, "x"), (y, "y")):
        set_scale(ax, which, part[name])
    drop = part["drop_between" if "drop_between" in part else "drop_rel"].transpose(y, x).values
    ax.set_facecolor("0.93")
    grid = [edges(part[name].values, is_log(part[name])) for name in (x, y)]
    colour, width = ("white", 0.25) if drop.size < 1000 else ("face", 0.1)
    look: Look = {"edgecolors": colour, "linewidth": width, "rasterized": True}
    image = ax.pcolormesh(*grid, np.ma.masked_invalid(drop), cmap=DROP_COLOURS, vmin=0, vmax=top, **look)
    for which, e in zip("xy", grid, strict=True):
        getattr(ax, f"set_{which}lim")(e[0], e[-1])
        getattr(ax, f"{which}axis").set_tick_params(which="minor", size=1.5, width=0.4)
    return image


def _band(ax: Axes, part: xr.Dataset, x: str, y: str) -> None:
    """Hatch where the regime is not known with 95 %."""
    if "margin" not in part:
        return
    doubt = (NORMAL_QUANTILE * part["margin_sd"] - np.abs(part["margin"])).transpose(y, x).values
    if min(doubt.shape) > 1 and (doubt > 0).any():
        look: Look = {"levels": [0, np.inf], "colors": "none", "hatches": ["//////"], "zorder": 2.5}
        grids = part[x].values, part[y].values
        ax.contourf(*finer(grids, [is_log(part[n]) for n in (x, y)], doubt), **look)


def _classical(ax: Axes, part: xr.Dataset, x: str, y: str) -> bool:
    """The boundary of the classical estimates; False where they have none."""
    values = {
        n: (np.geomspace if is_log(part[n]) else np.linspace)(part[n].values[0], part[n].values[-1], 13)
        for n in (y, x)
    }
    fixed = {name: np.atleast_1d(part[name].values) for name in axes_of(part) if name not in values}
    margins = margin_on_grid(part, values | fixed)
    if margins is None:
        return False
    grids = [values[x], values[y]]
    *grids, margins = finer(grids, [is_log(part[n]) for n in (x, y)], margins.reshape(len(grids[1]), -1))
    ax.contour(
        *grids, np.ma.masked_invalid(margins), levels=[0.0], colors="0.25", linewidths=0.9,
        linestyles=[_DASHES], zorder=2.8,
    )  # fmt: skip
    return True


def _draw_measures(
    ax: Axes, part: xr.Dataset, x: str, y: str, top: float
) -> tuple[ScalarMappable | None, bool]:
    """The drop as cells, with line, strips and what is unsure; over one axis as a curve, with the threshold
    as a line. Returns the cells' colours, and whether the line bridges gaps."""
    if y:
        image, bridged = _cells(ax, part, x, y, top), draw_line(ax, part, x, y)
        draw_strips(ax, part, x, y)
        _band(ax, part, x, y)
        return image, bridged
    ax.plot(part[x].values, part["drop_rel"].values, "-", color="0.3", lw=1.0)
    ax.axhline(part.attrs["drop_threshold"], color="black", lw=1.2, ls="--")
    drops_over(ax, part[x])
    return None, False


def _points(ax: Axes, part: xr.Dataset, x: str, y: str) -> set[str]:
    """Markers of the regimes; returns those that occur."""
    seen = set()
    others = [dim for dim in part["label"].dims if dim not in (x, y)]
    dims = [*others, *([y, x] if y else [x])]
    labels, outcome, ids = (part[name].transpose(*dims).values for name in ("label", "outcome", "run_id"))
    missing = (outcome == OUTCOME_FLAGS.index("missing")) & (ids != "")
    which = {name: (labels == k) & (ids != "") & ~missing for k, name in enumerate(LABELS)}
    for name, where in (which | {MISSING: missing}).items():
        hits = np.argwhere(where)
        if hits.size == 0:
            continue
        seen.add(name)
        ys = part[y].values[hits[:, -2]] if y else part["drop_rel"].values[hits[:, 0]]
        kwargs = {key: value for key, value in _MARKERS[name].items() if key != "label"}
        if not y and name in (UNCUT, NOT_COMPUTED, MISSING):  # above the axes, where no drop is read
            ys, kwargs["transform"] = np.full(len(hits), 1.03), ax.get_xaxis_transform()
        ax.plot(part[x].values[hits[:, -1]], ys, ls="", zorder=4, clip_on=False, **kwargs)
    return seen


def draw_samples(data: xr.Dataset, size: Size | None = None) -> Figure:
    """Runs that do not lie on a grid: the drop over each axis, the regimes as markers."""
    names = axes_of(data)
    columns = min(3 if size is None or size.height_mm else 2, len(names))
    rows = math.ceil(len(names) / columns)
    with style(size):
        figure = sized(size, 52 * rows + 24) if size else new_figure(DOUBLE_MM, 58 * rows + 16)
        axes = figure.subplots(rows, columns, sharey=True, squeeze=False)
        seen: set[str] = set()
        for k, ax in enumerate(axes.flat):
            if k >= len(names):
                ax.set_visible(False)
                continue
            ax.axhline(data.attrs["drop_threshold"], color="black", lw=1.2, ls="--")
            seen |= _points(ax, data.swap_dims(point=names[k]), names[k], "")
            drops_over(ax, data[names[k]])
            ax.set_xlabel(axis_text(data[names[k]]))
            if k % columns == 0:
                ax.set_ylabel("relative force drop")
        _legend(figure, data, seen, False, False, False, size=size)
        one_type(figure, size)
    return figure


def _legend(
    figure: Figure,
    data: xr.Dataset,
    seen: set[str],
    plane: bool,
    bridged: bool,
    classical: bool,
    extra: Sequence[Line2D] = (),
    size: Size | None = None,
) -> None:
    handles: list[Artist] = [Line2D([], [], ls="", **look) for name, look in _MARKERS.items() if name in seen]
    text = f"boundary: drop of {100 * data.attrs['drop_threshold']:g} % within a blade thickness"
    if math.isfinite(data.attrs["surge_threshold"]):
        text += f", surge of {data.attrs['surge_threshold']:g}"
    handles.append(Line2D([], [], color="black", lw=1.5, ls="-" if plane else "--", label=text))
    if bridged:
        handles.append(Line2D([], [], color="black", lw=1.2, ls="--", label="interpolated"))
    if data.attrs.get("mode") == BOUNDARY and "margin" in data:
        look: Look = {"facecolor": "none", "edgecolor": "0.2", "hatch": "//////", "lw": 0.4}
        handles.append(Patch(label="unsure (95 %)", **look))
    handles += strip_handles(data)
    if classical:
        handles.append(Line2D([], [], color="0.25", lw=0.9, ls=_DASHES, label="classical estimate"))
    handles += extra
    if size is not None and size.height_mm is not None:  # a slide has little height for one column
        for handle in handles:
            if "$" not in (text := str(handle.get_label())):
                handle.set_label(fill(text.replace(" %", "\N{NO-BREAK SPACE}%"), 20))  # letters a line
    legend_in_rows(figure, handles, "outside upper center", data.attrs[ESTIMATE])


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
    ticks, logs = [part[n].values for n in (x, y)], [is_log(part[n]) for n in (x, y)]
    ends = [edges(t, log)[[0, -1]] for t, log in zip(ticks, logs, strict=True)]
    grids = [np.concatenate([e[:1], t, e[1:]]) for e, t in zip(ends, ticks, strict=True)]
    *grids, z = finer(grids, logs, z)
    return grids, z, whole


def draw_line(ax: Axes, part: xr.Dataset, x: str, y: str) -> bool:
    """The line on which the measures pass the threshold; dashed, and True, where it bridges gaps."""
    field = _field(part, x, y)
    if field is None or not np.nanmin(field[1]) < 0 <= np.nanmax(field[1]):
        return False
    grids, z, whole = field
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
    field = _field(part, x, y)
    if field is None:
        return
    grids, z, _ = field
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
    strips, widest_first = uncertainty_strips(data), []
    for cause, (_, text) in _STRIPS.items():
        if cause in strips:
            low, high = total_change(strip for name, strip in strips.items() if cause in (name, MODEL))
            widest_first.append({"cause": cause, "text": text, "low": low, "high": high})
    return widest_first


def strip_handles(data: xr.Dataset) -> list[Patch]:
    """What the legend says of the strips that there are."""
    handles, grey = [], 0.45
    for strip in shown_strips(data):  # each lies on the one before
        grey += (1 - grey) * _STRIPS[strip["cause"]][0]
        handles.append(Patch(facecolor=str(round(grey, 3)), edgecolor="0.4", lw=0.5, label=strip["text"]))
    return handles


def _fill(z: np.ndarray) -> np.ndarray:
    """``z`` with its gaps interpolated along the grid; those outside the known points stay nan."""
    finite = np.isfinite(z)
    try:
        filled = griddata(np.argwhere(finite), z[finite], tuple(np.indices(z.shape)), method="linear")
    except QhullError:  # too few points, or all on a line
        return z
    return np.where(finite, z, filled)
