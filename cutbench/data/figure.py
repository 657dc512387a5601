"""What was measured, as pictures, words and tables: repetitions, their mean and scatter, fields."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from cutbench.base.figure_style import (
    COLOURS,
    DOUBLE_MM,
    FIELD_MAP,
    GREY,
    SINGLE_MM,
    legend_below,
    new_figure,
    style,
)
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import Experiment
from cutbench.data.field_comparison import Comparison
from cutbench.data.measures import MeasuredCut
from cutbench.data.repetition import Averaged


def plot_data(campaign: Campaign, n: int = 80) -> Figure:
    """A panel for each experiment: repetitions (thin), mean (thick), band of ± two standard deviations
    between specimens. With one repetition the band is that of the estimated reading noise. Tests with
    holds or returns have a second panel over time."""
    panels = [
        (e, over, averaged)
        for e, averaged in ((e, e.on_grid(n)) for e in campaign.experiments)
        for over in (("x", "time") if e.timed and not e.monotone else ("x",))
    ]
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    with style():
        figure = new_figure(SINGLE_MM if columns == 1 else DOUBLE_MM, 18 + 58 * rows)
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        for axes, (experiment, over, averaged) in zip(grid, panels, strict=False):
            _panel(axes, experiment, averaged, over)
        legend_below(figure, grid, 1 if columns == 1 else 3)
        figure.suptitle(campaign.title, x=0.02, ha="left")
    return figure


def _panel(axes: Axes, experiment: Experiment, averaged: Averaged, over: str) -> None:
    scale, y_unit = experiment.shown
    if isinstance(experiment, MeasuredCut):
        axes.set_axis_off()
        title = f"{experiment.id}\nmeasures of a cut to {experiment.depth_mm:g} mm"
        axes.set_title(title, loc="left", fontsize=8)
        words = "\n".join(f"{m.name.replace('_', ' ')}: {m}" for m in experiment.measures)
        axes.text(0, 0.95, words, va="top", fontsize=8, linespacing=1.6, transform=axes.transAxes)
        return
    several = averaged.repetitions > 1
    line: dict[str, Any] = {"color": GREY, "lw": 0.6, "ls": "-", "label": "repetitions"}
    dots = {"color": COLOURS["black"], "marker": ".", "ls": "", "ms": 3, "label": "readings of one specimen"}
    for r in experiment.repetitions:
        along = r.x if over == "x" or r.time_s is None else r.time_s
        axes.plot(along, scale * r.y, **(line if several else dots))
    along = averaged.x if over == "x" or averaged.time_s is None else averaged.time_s
    spread = averaged.scatter if several else averaged.reading
    if over == "time" or experiment.monotone:
        low, high = (scale * (averaged.mean + sign * 2 * spread) for sign in (-1, 1))
        label = "± 2 sd between specimens" if several else "± 2 sd of the noise, estimated"
        axes.fill_between(along, low, high, facecolor=COLOURS["sky"], alpha=0.45, lw=0, label=label)
    if several:
        axes.plot(along, scale * averaged.mean, color=COLOURS["blue"], ls="-", lw=1.3, label="mean")
    if np.min(averaged.mean) < 0 < np.max(averaged.mean):
        axes.axhline(0, color="black", lw=0.5)
    x_unit = "" if experiment.x_unit == "1" else f" ({experiment.x_unit})"
    axes.set_xlabel(f"{experiment.x_name}{x_unit}" if over == "x" else "time (s)")
    name = "nominal stress" if experiment.y_name == "stress" else experiment.y_name
    axes.set_ylabel(f"{name} ({y_unit})")
    kind = experiment.kind.replace("_", " ") * (experiment.kind.replace("_", " ") != experiment.id)
    role = "only predicted" * (experiment.role == "test")
    below = ", ".join(filter(None, (kind, role)))
    axes.set_title(f"{experiment.id}\n{below}", loc="left", fontsize=8)


# -- fields -------------------------------------------------------------------------------------------
def plot_dic(comparison: Comparison, title: str = "") -> Figure:
    """A row for each of u_x, u_y (mm, relative error) and E_xx, E_yy, E_xy (difference), drawn where the
    material is after the measured deformation. White: outside, or not measured."""
    measured, computed = comparison.measured, comparison.computed
    strains = (measured.strain, computed.strain)
    rows = [(f"$u_{c}$ (mm)", measured.u[i], computed.u[i], comparison.relative_error[i], "relative error")
            for i, c in enumerate("xy")]  # fmt: skip
    rows += [
        (f"$E_{{{name}}}$", strains[0][i, j], strains[1][i, j], comparison.strain_error[i, j], "difference")
        for (i, j), name in (((0, 0), "xx"), ((1, 1), "yy"), ((0, 1), "xy"))
    ]
    at = measured.deformed
    x, y = (at[i][np.isfinite(at[i])] for i in (0, 1))
    part = float(np.clip(np.ptp(y) / np.ptp(x), 0.3, 1.4))
    with style():
        figure = new_figure(DOUBLE_MM, 14 + 5 * (9 + 42 * part))
        grid = figure.subplots(5, 3)
        for line, (name, left, right, off, what) in zip(grid, rows, strict=True):
            low, high = _limits(np.concatenate([left.ravel(), right.ravel()]))
            for axes, values, head in zip(line, (left, right), ("measured", "computed"), strict=False):
                drawn = _field(axes, at, values, FIELD_MAP, low, high)
                axes.set_title(f"{name}, {head}", loc="left", fontsize=8)
            _bar(figure, drawn, line[1], "both")
            low, high = _limits(off.ravel())
            # A map of signed differences is white at zero, and safe for the colour-blind.
            most = max(abs(low), abs(high))
            colours, least, extend = ("PuOr", -most, "both")
            if what != "difference":
                most, colours, least, extend = max(high, 1e-12), "Greys", 0.0, "max"
            drawn = _field(line[2], at, off, colours, least, most)
            _bar(figure, drawn, line[2], extend)
            line[2].set_title(f"{name.split(' ')[0]}, {what}", loc="left", fontsize=8)
            line[0].set_ylabel("y (mm)")
            for axes in line:
                axes.set(xlim=(x.min(), x.max()), ylim=(y.min(), y.max()), aspect="equal")
        for axes in grid[-1]:
            axes.set_xlabel("x (mm)")
        travel = "" if np.isnan(measured.travel_mm) else f"blade travel {measured.travel_mm:g} mm"
        figure.suptitle(", ".join(filter(None, (title, travel))), x=0.02, ha="left")
    return figure


def _limits(values: np.ndarray) -> tuple[float, float]:
    """The range of colours; one that is not empty, and leaves out single points, as those at the blade."""
    measured = values[np.isfinite(values)]
    low, high = map(float, np.percentile(measured, (1, 99))) if measured.size else (0.0, 1.0)
    return low, max(high, low + 1e-12)


def _field(axes, at: np.ndarray, values: np.ndarray, colours: str, low: float, high: float) -> PolyCollection:
    """Cells between four points (positions ``at`` (2, ny, nx)) that all have a value, in their mean."""
    corners = [(slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None)),
               (slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1))]  # fmt: skip
    cells = np.stack([np.stack([at[0][c], at[1][c]], axis=-1) for c in corners], axis=2)
    mean = np.mean([values[c] for c in corners], axis=0)
    known = np.isfinite(mean) & np.isfinite(cells).all(axis=(2, 3))
    drawn = PolyCollection(
        cells[known], array=mean[known], cmap=colours, clim=(low, high), edgecolors="face", linewidths=0.1,
        rasterized=True,
    )  # fmt: skip
    axes.add_collection(drawn)
    return drawn


def _bar(figure: Figure, drawn: PolyCollection, axes, extend: str) -> None:
    bar = figure.colorbar(drawn, ax=axes, extend=extend, aspect=18, pad=0.02)
    bar.outline.set_linewidth(0.5)
    bar.ax.tick_params(labelsize=7)


def summary_lines(campaign: Campaign) -> list:
    """Head, then pairs of words."""
    lines = [campaign.title, ("baseline", campaign.model.described)]
    for e in campaign.experiments:
        count = len(e.repetitions)
        times = f"{count} repetition{'s' * (count > 1)}, {e.readings} readings"
        what = times if e.curve else f"{e.readings} measures"
        lines.append((e.id, f"{e.kind}, {what}, {e.role}"))
    return lines


def plot(campaign: Campaign, ax: Axes) -> None:
    """Every repetition, as parts of its experiment's reach and largest value."""
    for e in (e for e in campaign.experiments if e.curve):
        top, reach = max(float(np.abs(r.y).max()) for r in e.repetitions), e.reach - e.rest or 1.0
        first, *rest = ((r.x - e.rest) / reach for r in e.repetitions)
        (line,) = ax.plot(first, e.repetitions[0].y / top, lw=0.8, label=e.id)
        for x, r in zip(rest, e.repetitions[1:], strict=True):
            ax.plot(x, r.y / top, lw=0.8, color=line.get_color(), ls=line.get_linestyle())
    ax.set(xlabel="part of the way", ylabel="part of the largest value")
    ax.set_title(campaign.title, loc="left")
    ax.legend()


def table(campaign: Campaign) -> dict[str, np.ndarray]:
    """All readings, a row each: x and y in mm, N, MPa, or stretches, as ``x_unit`` and ``y_unit`` say."""
    rows = [(e, str(r.name or k), r) for e in campaign.experiments for k, r in enumerate(e.repetitions, 1)]
    return {
        "experiment": np.concatenate([np.full(len(r.x), e.id) for e, _, r in rows]),
        "repetition": np.concatenate([np.full(len(r.x), name) for _, name, r in rows]),
        "x": np.concatenate([r.x for _, _, r in rows]),
        "y": np.concatenate([r.y for _, _, r in rows]),
        "x_unit": np.concatenate([np.full(len(r.x), e.x_unit) for e, _, r in rows]),
        "y_unit": np.concatenate([np.full(len(r.x), e.y_unit) for e, _, r in rows]),
    }
