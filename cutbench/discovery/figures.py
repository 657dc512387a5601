"""Pictures of a discovery: measured band, baseline and extended model with residuals; the ranking."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.errors import ComputationFailed
from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, new_figure, style
from cutbench.calibration.figure import Line, plot_compared
from cutbench.calibration.fitting import ComparedCurve
from cutbench.discovery.candidates import cause_title
from cutbench.discovery.search import Discovery


def plot_curves(d: Discovery) -> Figure:
    """Each experiment with the baseline and, where a cause was found, the extended model."""

    def computed(c: ComparedCurve) -> list[Line]:
        lines: list[Line] = [
            (c.fitted, {"color": COLOURS["vermilion"], "ls": (0, (5, 1.5)), "label": "baseline"})
        ]
        if d.final is not None and d.found:
            id, known = c.experiment.id, d.final.at.y
            with suppress(ComputationFailed):
                values = known[id] if id in known else d.final.predicted(c.experiment).y
                lines.append((values, {"color": COLOURS["blue"], "ls": "-", "label": "extended model"}))
        return lines

    return plot_compared(d.fit.compared, computed)


def plot_ranking(d: Discovery) -> Figure:
    """What each candidate that was fitted explains of what is wrong, and its gain on held-out data with its
    standard error."""
    compared, group = (d.telling.compared, [c.name for c in d.telling.group]) if d.telling else ([], [])
    names = [c.name for c in compared]
    with style():
        figure = new_figure(DOUBLE_MM, 22 + 7 * len(names))
        left, right = figure.subplots(1, 2, sharey=True)
        y = np.arange(len(names))[::-1]
        colours = [COLOURS["blue"] if n in d.names else COLOURS["sky"] if n in group else GREY for n in names]
        explained = [100 * min(max(c.explained_variance, 0), 1.1) for c in compared]
        left.barh(y, explained, color=colours, height=0.6)
        left.set_yticks(y, names)
        left.set_xlabel("Explains of what is wrong (%)")
        gains = [100 * max(c.held_out.gain, -1.0) for c in compared]
        errors = [min(100 * c.held_out.gain_se, 100.0) for c in compared]
        right.barh(y, gains, xerr=errors, color=colours, height=0.6, error_kw={"lw": 0.8, "capsize": 2})
        right.axvline(0, color=COLOURS["black"], lw=0.6)
        right.set_xlabel("Fall of the error on held-out data (%)")
        right.set_xlim(left=min(0, *gains) - 5, right=max(100, right.get_xlim()[1]))
    return figure


def plot(d: Discovery, ax: Axes) -> None:
    """The candidates' scores; what was added is dark."""
    best = d.telling.ranking[:12][::-1] if d.telling else []
    colours = [COLOURS["blue"] if s.name in d.names else GREY for s, _ in best]
    ax.barh([cause_title(s.name) for s, _ in best], [s.z for s, _ in best], color=colours)
    ax.set_xlabel("score (standard deviations)")
    ax.set_title(f"{d.campaign.title}: {d.verdict}", loc="left")
