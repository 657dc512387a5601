"""A fit beside its data: the curves, and below them what is left over, by regime of the cut."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, SINGLE_MM, legend_below, new_figure, style

if TYPE_CHECKING:
    from cutbench.calibration.fitted import ComparedCurve, Fit

#: Shades of the regimes, so that neighbours differ in grey print too.
_SHADES = {"indentation": "#FFFFFF", "onset": "#E6E6E6", "transition": "#F5F5F5", "steady": "#FFFFFF"}


def plot_fit(fit: Fit) -> Figure:
    """A column for each experiment (at most three side by side): measured mean with ± two standard
    deviations and the computed curve above, residual below."""
    count = len(fit.compared)
    columns = min(3, count)
    rows = -(-count // columns)
    with style():
        figure = new_figure(SINGLE_MM if columns == 1 else DOUBLE_MM, 20 + 78 * rows)
        ratios = [3, 1.3] * rows
        axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=ratios)
        for i in range(rows * columns):
            top, bottom = axes[2 * (i // columns)][i % columns], axes[2 * (i // columns) + 1][i % columns]
            if i >= count:
                top.set_visible(False)
                bottom.set_visible(False)
                continue
            _curve(top, fit.compared[i])
            _residual(bottom, fit.compared[i])
            bottom.sharex(top)
        legend_below(figure, axes.ravel(), 3)
        figure.suptitle(fit.campaign.title, x=0.02, ha="left")
    return figure


def _scale(c: ComparedCurve) -> float:
    return 1.0 if c.experiment.y_unit == "N" else 1e3


def _curve(axes: Axes, c: ComparedCurve) -> None:
    s = _scale(c)
    low, high = s * (c.mean - 2 * c.sd), s * (c.mean + 2 * c.sd)
    axes.fill_between(c.x, low, high, facecolor=COLOURS["sky"], alpha=0.45, lw=0, label="± 2 sd")
    axes.plot(c.x, s * c.mean, ".", color=COLOURS["black"], ms=3, label="measured (mean)")
    predicted = c.experiment.role == "test"
    axes.plot(
        c.x,
        s * c.fitted,
        color=COLOURS["vermilion" if not predicted else "blue"],
        ls=(0, (5, 1.5)) if predicted else "-",
        lw=1.3,
        label="predicted" if predicted else "fitted",
    )
    name = "nominal stress" if c.experiment.y_name == "stress" else c.experiment.y_name
    axes.set_ylabel(f"{name} ({'N' if s == 1.0 else 'kPa'})")
    kind = c.experiment.kind.replace("_", " ")
    axes.set_title(c.experiment.id + (f"\n{kind}" if kind != c.experiment.id else ""), loc="left", fontsize=8)
    axes.tick_params(labelbottom=False)


def _residual(axes: Axes, c: ComparedCurve) -> None:
    s = _scale(c)
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
    axes.set_ylabel(f"residual ({'N' if s == 1.0 else 'kPa'})")
    unit = "" if c.experiment.x_unit == "1" else f" ({c.experiment.x_unit})"
    axes.set_xlabel(f"{c.experiment.x_name}{unit}")
