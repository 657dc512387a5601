"""What was measured: every repetition, their mean, and how far they scatter."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, SINGLE_MM, legend_below, new_figure, style
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import Experiment
from cutbench.data.measured import MeasuredCut
from cutbench.data.repetition import Averaged


def plot_data(campaign: Campaign, n: int = 80) -> Figure:
    """A panel for each experiment: repetitions (thin), mean (thick), band of ± two standard deviations
    between specimens. With one repetition the band is that of the estimated reading noise. Tests with
    holds or returns have a second panel over time."""
    panels = [(e, kind) for e in campaign.experiments for kind in _panels(e)]
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    with style():
        width = SINGLE_MM if columns == 1 else DOUBLE_MM
        figure = new_figure(width, 18 + 58 * rows)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes in grid.ravel()[len(panels) :]:
            axes.set_visible(False)
        averaged = {e.id: e.on_grid(n) for e in campaign.experiments}
        for axes, (experiment, kind) in zip(grid.ravel(), panels, strict=False):
            _panel(axes, experiment, averaged[experiment.id], kind)
        legend_below(figure, grid.ravel(), 1 if columns == 1 else 3)
        figure.suptitle(campaign.title, x=0.02, ha="left")
    return figure


def _panels(experiment: Experiment) -> list[str]:
    return ["x", "time"] if experiment.timed and not experiment.monotone else ["x"]


def _measures(axes: Axes, e: MeasuredCut) -> None:
    """Numbers without a curve, as words."""
    axes.set_axis_off()
    axes.set_title(f"{e.id}\nmeasures of a cut to {e.depth_mm:g} mm", loc="left", fontsize=8)
    lines = [f"{m.name.replace('_', ' ')}: {m}" for m in e.measures]
    axes.text(0, 0.95, "\n".join(lines), va="top", fontsize=8, linespacing=1.6, transform=axes.transAxes)


def _panel(axes: Axes, experiment: Experiment, averaged: Averaged, over: str) -> None:
    scale, shown = experiment.shown
    if isinstance(experiment, MeasuredCut):
        _measures(axes, experiment)
        return
    several = averaged.repetitions > 1
    for r in experiment.repetitions:
        along = r.x if over == "x" or r.time_s is None else r.time_s
        if several:
            axes.plot(along, scale * r.y, color=GREY, lw=0.6, ls="-", label="repetitions")
        else:
            axes.plot(along, scale * r.y, ".", color=COLOURS["black"], ms=3, label="readings of one specimen")
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
    unit = "" if experiment.x_unit == "1" else f" ({experiment.x_unit})"
    axes.set_xlabel(f"{experiment.x_name}{unit}" if over == "x" else "time (s)")
    name = "nominal stress" if experiment.y_name == "stress" else experiment.y_name
    axes.set_ylabel(f"{name} ({shown})")
    kind = experiment.kind.replace("_", " ")
    parts = [kind] if kind != experiment.id else []
    parts += ["only predicted"] if experiment.role == "test" else []
    axes.set_title("\n".join([experiment.id, ", ".join(parts)]), loc="left", fontsize=8)
