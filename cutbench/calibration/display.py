"""A fit in words, as a picture, as a table, as files."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cutbench.base.figure_style import COLOURS
from cutbench.base.files import check_writable
from cutbench.calibration.fitting import Fit
from cutbench.calibration.report import write_fit


def summary_lines(fit: Fit) -> list:
    """Head, then pairs of words."""
    lines = [("model", fit.case.model.described), ("status", fit.message or fit.status)]
    for e in fit.estimates:
        low, high = (e.parameter.quantity.show(float(f"{v:.3g}")) for v in (e.low, e.high))
        spread = "reached" if np.isnan(e.sd) else f"({low} to {high})"
        lines.append((e.label, f"{e.parameter.quantity.show(float(f'{e.value:.4g}'))} {spread}"))
    for c in fit.compared:
        part = c.rmse / float(np.abs(c.mean).max())
        did = "fitted" if c.experiment.role == "train" else "predicted"
        lines.append((c.experiment.id, f"{did}, {100 * part:.1f} % of the maximum (root mean square)"))
    how = "" if np.isnan(fit.reduced_chi2) else f", reduced χ² {fit.reduced_chi2:.3g}"
    return [f"{fit.campaign.title}{how}", *lines]


def plot(fit: Fit, ax: Axes) -> None:
    """Measured and computed curves, each over its reach and as parts of its largest value."""
    colours = itertools.cycle(colour for name, colour in COLOURS.items() if name != "yellow")
    for c, colour in zip(fit.compared, colours, strict=False):
        top, reach = float(np.abs(c.mean).max()), float(c.x[-1] - c.experiment.rest) or 1.0
        x = (c.x - c.experiment.rest) / reach
        low, high = (c.mean - 2 * c.sd) / top, (c.mean + 2 * c.sd) / top
        ax.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
        ax.plot(x, c.mean / top, color=colour, ls="-", label=c.experiment.id)
        ax.plot(x, c.fitted / top, color=colour, ls="--")
    ax.set(xlabel="part of the way", ylabel="part of the largest value")
    ax.set_title(fit.campaign.title, loc="left")
    ax.legend(title="measured; dashes: computed", alignment="left")


def table(fit: Fit) -> dict[str, list]:
    """The parameters, a row each, in the units that a person writes."""
    rows = [(e, e.parameter.quantity) for e in fit.estimates]
    return {
        "parameter": [e.label for e, _ in rows],
        "value": [e.value / q.factor for e, q in rows],
        "low": [e.low / q.factor for e, q in rows],
        "high": [e.high / q.factor for e, q in rows],
        "unit": [q.unit for _, q in rows],
        "at_bound": [e.at_bound for e, _ in rows],
    }


def write(fit: Fit, folder: Path) -> None:
    """What ``cutbench fit --out`` writes."""
    write_fit(fit, check_writable(folder))
