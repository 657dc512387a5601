"""Computed curves beside measured ones, and below them what is left over, by regime of the cut."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.figure_style import (
    COLOURS,
    DOUBLE_MM,
    GREY,
    LINE_COLOURS,
    SINGLE_MM,
    Look,
    legend_below,
    new_figure,
    style,
)
from cutbench.data.measures import MeasuredCut

if TYPE_CHECKING:
    from cutbench.calibration.fitting import ComparedCurve, Fit

#: What is computed of a test, on its grid (m,), and how it is drawn.
Line = tuple[np.ndarray, Look]


def plot_fit(fit: Fit) -> Figure:
    """Each experiment with the curve that was fitted or predicted."""
    looks: dict[str, Look] = {
        "train": {"color": COLOURS["vermilion"], "ls": "-",
                  "label": "fitted" if fit.done else "as far as it came"},
        "test": {"color": COLOURS["blue"], "ls": (0, (5, 1.5)), "label": "predicted"},
    }  # fmt: skip
    return plot_compared(fit.compared, lambda c: [(c.fitted, looks[c.experiment.role])], fit.campaign.title)


def plot_compared(
    compared: Sequence[ComparedCurve], computed: Callable[[ComparedCurve], Sequence[Line]], title: str = ""
) -> Figure:
    """A column for each experiment (at most three side by side): measured mean with ± two standard
    deviations and what is ``computed`` above, what is left over below."""
    columns = min(3, len(compared))
    rows = -(-len(compared) // columns)
    with style():
        figure = new_figure(SINGLE_MM if columns == 1 else DOUBLE_MM, 20 + 78 * rows)
        axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[3, 1.3] * rows)
        pairs = zip(axes[::2].ravel(), axes[1::2].ravel(), strict=True)
        for (top, bottom), c in itertools.zip_longest(pairs, compared):
            top.set_visible(c is not None)
            bottom.set_visible(c is not None and c.experiment.curve)
            if bottom.get_visible():
                _curve(top, bottom, c, computed(c))
            elif c is not None:
                _measures(top, c, computed(c))
        legend_below(figure, figure.axes, columns + 1)
        figure.suptitle(title, x=0.02, ha="left")
    return figure


def _head(c: ComparedCurve) -> str:
    e = c.experiment
    kind = "measures of a cut" if isinstance(e, MeasuredCut) else e.kind.replace("_", " ")
    role = "fitted" if e.role == "train" else "predicted"
    return f"{e.id}\n{kind if kind != e.id else ''}, {role}".replace("\n, ", "\n")


def _curve(top: Axes, bottom: Axes, c: ComparedCurve, lines: Sequence[Line]) -> None:
    e = c.experiment
    s, unit = e.shown
    x, along = c.x, e.x_name + ("" if e.x_unit == "1" else f" ({e.x_unit})")
    if not e.monotone and (times := e.on_grid(c.x.size).time_s) is not None:
        x, along = times, "time (s)"
    for axes, middle, label in ((top, s * c.mean, "± 2 sd"), (bottom, 0.0, "")):
        low, high = middle - 2 * s * c.sd, middle + 2 * s * c.sd
        axes.fill_between(x, low, high, label=label, facecolor=COLOURS["sky"], alpha=0.45, lw=0)
    top.plot(x, s * c.mean, ".", color=COLOURS["black"], ms=3, label="measured (mean)")
    bottom.axhline(0, color="black", lw=0.5)
    for values, look in lines:
        top.plot(x, s * values, lw=1.3, **look)
        bottom.plot(x, s * (c.mean - values), lw=0.6, marker=".", ms=3, **look)
    limit = s * max([2 * np.median(c.sd), *(np.abs(c.mean - values).max() for values, _ in lines)])
    for name, mask in c.regimes().items():
        # Neighbours differ in grey print, too.
        shade = {"onset": "#E6E6E6", "transition": "#F5F5F5"}.get(name, "#FFFFFF")
        bottom.axvspan(x[mask][0], x[mask][-1], facecolor=shade, lw=0, zorder=0)
        bottom.text(
            x[mask].mean(), 1.0, name[:6] + ("." if len(name) > 6 else ""), fontsize=6, color=GREY,
            ha="center", va="bottom", transform=bottom.get_xaxis_transform(),
        )  # fmt: skip
    top.set_title(_head(c), loc="left", fontsize=8)
    top.set_ylabel(f"{'nominal stress' if e.y_name == 'stress' else e.y_name} ({unit})")
    top.tick_params(labelbottom=False)
    bottom.sharex(top)
    bottom.set(ylim=(-1.1 * limit, 1.1 * limit), ylabel=f"residual ({unit})", xlabel=along)


def _measures(axes: Axes, c: ComparedCurve, lines: Sequence[Line]) -> None:
    """How far each measure is off, in standard deviations, beside what was measured and what is computed."""
    measures = c.experiment.measures if isinstance(c.experiment, MeasuredCut) else ()
    rows = np.arange(len(measures))[::-1]
    reach = max([3.0, *(np.abs(values - c.mean).max() for values, _ in lines)])
    axes.axvspan(-2, 2, label="± 2 sd", facecolor=COLOURS["sky"], alpha=0.45, lw=0)
    axes.axvline(0, color="black", lw=0.5)
    for values, look in lines:
        axes.plot(values - c.mean, rows, **look | {"ls": "", "marker": "o", "ms": 4})
    axes.set_yticks(rows, [f"{m.name}\n{m}" for m in measures], fontsize=7)
    for row, m, value, off in zip(rows, measures, c.computed, -c.residual, strict=True):
        text, look = f"{value:.3g} {m.unit}".removesuffix(" 1"), {"fontsize": 7, "ha": "center"}
        axes.annotate(text, (off, row), (0, 5), textcoords="offset points", **look)
    axes.set(
        xlim=(-1.2 * reach, 1.2 * reach), ylim=(-0.6, len(rows) - 0.2), xlabel="computed less measured (sd)"
    )
    axes.set_title(_head(c), loc="left", fontsize=8)


def plot(fit: Fit, ax: Axes) -> None:
    """Measured and computed curves, each over its reach and as parts of its largest value."""
    for c, colour in zip(fit.compared, itertools.cycle(LINE_COLOURS), strict=False):
        top, reach = float(np.abs(c.mean).max()), float(c.x[-1] - c.experiment.rest) or 1.0
        x = (c.x - c.experiment.rest) / reach
        low, high = (c.mean - 2 * c.sd) / top, (c.mean + 2 * c.sd) / top
        ax.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
        ax.plot(x, c.mean / top, color=colour, ls="-", label=c.experiment.id)
        ax.plot(x, c.fitted / top, color=colour, ls="--")
    ax.set(xlabel="part of the way", ylabel="part of the largest value")
    ax.set_title(fit.campaign.title, loc="left")
    ax.legend(title="measured; dashes: computed", alignment="left")
