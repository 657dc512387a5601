"""Pictures of a discovery: measured band, baseline and extended model with residuals; the ranking."""

from __future__ import annotations

import io
import re

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, legend_below, new_figure, style
from cutbench.calibration.figure import panels
from cutbench.data.experiment import Experiment
from cutbench.discovery.heldout import expected
from cutbench.discovery.outcome import Discovery
from cutbench.discovery.point import Point

BASE, MORE = "Baseline", "Extended model"


def curves(d: Discovery) -> Figure:
    """A column for each experiment (three side by side at most): curves above, what is left over below."""
    shown = [e for e in d.campaign.experiments if e.id in _curves(d.first)]
    with style():
        figure, axes = panels(len(shown), 14, 1.5)
        for (top, bottom), e in zip(axes, shown, strict=True):
            _experiment(top, bottom, d, e)
        legend_below(figure, figure.axes, 4)
    return figure


def _curves(p: Point) -> dict[str, np.ndarray]:
    return {**p.tests, **p.y}


def _experiment(top, bottom, d: Discovery, e: Experiment) -> None:
    grid = d.first.inverse.grids[e.id]
    scale, unit = (1.0, "N") if e.y_unit == "N" else (1e3, "kPa")
    x, label = grid.x, f"{e.x_name}" + ("" if e.x_unit == "1" else f" ({e.x_unit})")
    if not e.monotone and grid.time_s is not None:
        x, label = grid.time_s, "time (s)"
    block = d.first.w.tests.get(e.id) or expected(d.first, e)
    sd = scale * block.deviation
    mean = scale * grid.mean
    base, more = scale * _curves(d.first)[e.id], _curves(d.final).get(e.id) if d.found else None
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
    top.set_title(f"{e.id}\n({'fitted' if e.role == 'train' else 'predicted'})")
    top.set_ylabel(f"{e.y_name.capitalize()} ({unit})")
    top.tick_params(labelbottom=False)
    bottom.sharex(top)
    bottom.set_ylabel(f"Residual ({unit})")
    bottom.set_xlabel(label[0].upper() + label[1:])


def ranking(d: Discovery) -> Figure | None:
    """What each candidate explains of what is wrong, and its gain on held-out data with its standard
    error."""
    r = d.telling
    if not r.tried:
        return None
    names = [t.name for t in r.tried]
    with style():
        figure = new_figure(DOUBLE_MM, 22 + 7 * len(names))
        left, right = figure.subplots(1, 2, sharey=True)
        y = np.arange(len(names))[::-1]
        colours = [
            COLOURS["blue"] if n == r.accepted else COLOURS["sky"] if n in r.group else GREY for n in names
        ]
        left.barh(y, [100 * min(max(t.share, 0), 1.1) for t in r.tried], color=colours, height=0.6)
        left.set_yticks(y, names)
        left.set_xlabel("Explains of what is wrong (%)")
        gains = [100 * max(t.heldout.gain, -1.0) for t in r.tried]
        right.barh(y, gains, xerr=[100 * t.heldout.gain_se for t in r.tried], color=colours, height=0.6,
                   error_kw={"lw": 0.8, "capsize": 2})  # fmt: skip
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
