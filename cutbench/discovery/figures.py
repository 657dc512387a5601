"""Pictures of a discovery: measured band, baseline and extended model with residuals; the ranking."""

from __future__ import annotations

import io
import re

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from cutbench.base.errors import ComputationFailed
from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, legend_below, new_figure, style
from cutbench.calibration.figure import panels
from cutbench.calibration.fitting import ComparedCurve
from cutbench.calibration.posterior import Estimated
from cutbench.data.experiment import Experiment
from cutbench.data.measures import MeasuredCut
from cutbench.discovery.search import Discovery

BASE, MORE = "Baseline", "Extended model"


def curves(d: Discovery) -> Figure:
    """A column for each experiment (three side by side at most): curves above, what is left over below."""
    shown = d.fit.compared
    with style():
        figure, axes = panels(len(shown), 14, 1.5)
        for (top, bottom), c in zip(axes, shown, strict=True):
            _experiment(top, bottom, d, c)
        legend_below(figure, figure.axes, 4)
    return figure


def _curve(fitted: Estimated | None, e: Experiment) -> np.ndarray | None:
    if fitted is None or e.id in fitted.at.y:
        return None if fitted is None else fitted.at.y[e.id]
    try:
        return fitted.predicted(e).y
    except ComputationFailed:
        return None


def _experiment(top, bottom, d: Discovery, c: ComparedCurve) -> None:
    e = c.experiment
    scale, unit = e.shown
    x, label = c.x, f"{e.x_name}" + ("" if e.x_unit == "1" else f" ({e.x_unit})")
    if not e.monotone and (times := e.on_grid(c.x.size).time_s) is not None:
        x, label = times, "time (s)"
    sd, mean, base = scale * c.sd, scale * c.mean, scale * c.fitted
    more = _curve(d.final, e) if d.found else None
    if isinstance(e, MeasuredCut):  # points, each in units of its own
        mean, base, more = mean - c.mean, base - c.mean, None if more is None else more - c.mean
    top.fill_between(x, mean - 2 * sd, mean + 2 * sd, color=COLOURS["sky"], alpha=0.5, lw=0,
                     label="Measured mean ± 2 standard deviations")  # fmt: skip
    top.plot(x, mean, ".", color=COLOURS["black"], ms=2.5, label="Measured mean")
    top.plot(x, base, color=COLOURS["vermilion"], ls=(0, (5, 1.5)), label=BASE)
    bottom.fill_between(x, -2 * sd, 2 * sd, color=COLOURS["sky"], alpha=0.5, lw=0)
    bottom.axhline(0, color=GREY, lw=0.6)
    bottom.plot(x, mean - base, color=COLOURS["vermilion"], ls=(0, (5, 1.5)))
    if more is not None:
        top.plot(x, scale * more, color=COLOURS["blue"], ls="-", label=MORE)
        bottom.plot(x, mean - scale * more, color=COLOURS["blue"], ls="-")
    if isinstance(e, MeasuredCut):
        for line in (*top.lines[1:], *bottom.lines[1:]):
            line.set(marker="o", ms=4, ls="")
        bottom.set_xticks(x, [m.name.replace("_", "\n") for m in e.measures])
    top.set_title(f"{e.id}\n({'fitted' if e.role == 'train' else 'predicted'})")
    top.set_ylabel(f"{e.y_name.capitalize()} ({unit})")
    top.tick_params(labelbottom=False)
    bottom.sharex(top)
    bottom.set_ylabel(f"Residual ({unit})")
    bottom.set_xlabel(label[0].upper() + label[1:])


def ranking(d: Discovery) -> Figure | None:
    """What each candidate explains of what is wrong, and its gain on held-out data with its standard
    error."""
    step = d.telling
    if step is None or not step.compared:
        return None
    names, group = [c.name for c in step.compared], [c.name for c in step.group]
    with style():
        figure = new_figure(DOUBLE_MM, 22 + 7 * len(names))
        left, right = figure.subplots(1, 2, sharey=True)
        y = np.arange(len(names))[::-1]
        colours = [COLOURS["blue"] if n in d.names else COLOURS["sky"] if n in group else GREY for n in names]
        left.barh(
            y,
            [100 * min(max(c.explained_variance, 0), 1.1) for c in step.compared],
            color=colours,
            height=0.6,
        )
        left.set_yticks(y, names)
        left.set_xlabel("Explains of what is wrong (%)")
        gains = [100 * max(c.held_out.gain, -1.0) for c in step.compared]
        errors = [min(100 * c.held_out.gain_se, 100.0) for c in step.compared]
        right.barh(y, gains, xerr=errors, color=colours, height=0.6, error_kw={"lw": 0.8, "capsize": 2})
        right.axvline(0, color=COLOURS["black"], lw=0.6)
        right.set_xlabel("Fall of the error on held-out data (%)")
        right.set_xlim(left=min(0, *gains) - 5, right=max(100, right.get_xlim()[1]))
    return figure


def svg(figure: Figure, name: str) -> str:
    """The figure as an element for a page; ``name`` keeps the ids of several figures apart."""
    text = io.StringIO()
    with style(), matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    body = text.getvalue()
    body = body[body.index("<svg") :]
    # Groups need no names, and those of several figures would be the same; what is referred to keeps its own.
    body = re.sub(r'<g id="[^"]*"', "<g", body)
    body = re.sub(r'( id="|url\(#|href="#)', rf"\g<1>{name}-", body)
    head, rest = body.split(">", 1)
    return re.sub(r' (width|height)="[^"]*"', "", head) + ">" + rest
