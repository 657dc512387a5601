"""A fit beside its data: the curves, and below them what is left over, by regime of the cut."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.figure_style import (
    COLOURS,
    DOUBLE_MM,
    GREY,
    SINGLE_MM,
    Look,
    legend_below,
    new_figure,
    style,
)
from cutbench.data.measures import MeasuredCut

if TYPE_CHECKING:
    from cutbench.calibration.fitting import ComparedCurve, Fit

#: Shades of the regimes, so that neighbours differ in grey print too.
_SHADES = {"indentation": "#FFFFFF", "onset": "#E6E6E6", "transition": "#F5F5F5", "steady": "#FFFFFF"}


def plot_fit(fit: Fit) -> Figure:
    """A column for each experiment (at most three side by side): measured mean with ± two standard
    deviations and the computed curve above, residual below."""
    with style():
        figure, axes = panels(len(fit.compared), 20, 1.3)
        for (top, bottom), c in zip(axes, fit.compared, strict=True):
            if isinstance(c.experiment, MeasuredCut):
                _measures(top, c, c.experiment)
                bottom.set_visible(False)
                continue
            _curve(top, c, "fitted" if fit.done else "as far as it came")
            _residual(bottom, c)
            bottom.sharex(top)
        legend_below(figure, figure.axes, 3)
        figure.suptitle(fit.campaign.title, x=0.02, ha="left")
    return figure


def panels(count: int, margin_mm: float, ratio: float) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """A figure with axes for ``count`` curves, three side by side at most, and below each for its residual,
    of which the curve's are 3 / ``ratio`` times as high."""
    columns = min(3, count)
    rows = -(-count // columns)
    figure = new_figure(SINGLE_MM if columns == 1 else DOUBLE_MM, margin_mm + 78 * rows)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[3, ratio] * rows)
    pairs = list(zip(axes[::2].ravel(), axes[1::2].ravel(), strict=True))
    for each in (each for pair in pairs[count:] for each in pair):
        each.set_visible(False)
    return figure, pairs[:count]


def _curve(axes: Axes, c: ComparedCurve, fitted: str) -> None:
    s, unit = c.experiment.shown
    low, high = s * (c.mean - 2 * c.sd), s * (c.mean + 2 * c.sd)
    axes.fill_between(c.x, low, high, facecolor=COLOURS["sky"], alpha=0.45, lw=0, label="± 2 sd")
    axes.plot(c.x, s * c.mean, ".", color=COLOURS["black"], ms=3, label="measured (mean)")
    look: Look = {"color": COLOURS["vermilion"], "ls": "-", "label": fitted}
    if c.experiment.role == "test":
        look = {"color": COLOURS["blue"], "ls": (0, (5, 1.5)), "label": "predicted"}
    axes.plot(c.x, s * c.fitted, lw=1.3, **look)
    name = "nominal stress" if c.experiment.y_name == "stress" else c.experiment.y_name
    axes.set_ylabel(f"{name} ({unit})")
    kind = c.experiment.kind.replace("_", " ")
    axes.set_title(c.experiment.id + (f"\n{kind}" if kind != c.experiment.id else ""), loc="left", fontsize=8)
    axes.tick_params(labelbottom=False)


def _measures(axes: Axes, c: ComparedCurve, e: MeasuredCut) -> None:
    """How far each measure is off, in standard deviations, beside what was measured and what is computed."""
    rows, off = np.arange(len(e.measures))[::-1], -c.residual
    axes.axvspan(-2, 2, facecolor=COLOURS["sky"], alpha=0.45, lw=0, label="± 2 sd")
    axes.axvline(0, color="black", lw=0.5)
    colour = COLOURS["vermilion" if e.role == "train" else "blue"]
    axes.plot(off, rows, "o", color=colour, ms=4, label="fitted" if e.role == "train" else "predicted")
    units = [f" {m.unit}".replace(" 1", "") for m in e.measures]
    axes.set_yticks(rows, [f"{m.name}\n{m}" for m in e.measures], fontsize=7)
    for row, value, unit, x in zip(rows, c.computed, units, off, strict=True):
        axes.annotate(
            f"{value:.3g}{unit}", (x, row), (0, 5), textcoords="offset points", fontsize=7, ha="center"
        )
    reach = 1.2 * max(3.0, float(np.abs(off).max()))
    axes.set(xlim=(-reach, reach), ylim=(-0.6, rows.size - 0.2), xlabel="computed less measured (sd)")
    axes.set_title(f"{e.id}\nmeasures of a cut", loc="left", fontsize=8)


def _residual(axes: Axes, c: ComparedCurve) -> None:
    s, shown = c.experiment.shown
    for name, mask in c.regimes().items():
        axes.axvspan(c.x[mask][0], c.x[mask][-1], facecolor=_SHADES[name], lw=0, zorder=0)
        axes.text(
            c.x[mask].mean(), 1.0, name[:6] + ("." if len(name) > 6 else ""), fontsize=6, color=GREY,
            ha="center", va="bottom", transform=axes.get_xaxis_transform(),
        )  # fmt: skip
    axes.fill_between(c.x, -2 * s * c.sd, 2 * s * c.sd, facecolor=COLOURS["sky"], alpha=0.45, lw=0)
    axes.plot(c.x, s * c.residual, ".-", color=COLOURS["black"], ms=3, lw=0.6)
    axes.axhline(0, color="black", lw=0.5)
    limit = 1.1 * s * max(np.abs(c.residual).max(), 2 * np.median(c.sd))
    axes.set_ylim(-limit, limit)
    axes.set_ylabel(f"residual ({shown})")
    unit = "" if c.experiment.x_unit == "1" else f" ({c.experiment.x_unit})"
    axes.set_xlabel(f"{c.experiment.x_name}{unit}")
