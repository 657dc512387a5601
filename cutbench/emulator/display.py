"""An estimate in words, as a picture, as a table, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cutbench.base.figure_style import COLOURS, SINGLE_MM, force_from_zero, new_figure, save, style
from cutbench.base.files import check_writable, csv_text, write_json, write_text
from cutbench.emulator.atlas import MEASURES, Estimate


def summary_lines(found: Estimate) -> list:
    """Its verdict, and a line a measure."""
    head, *lines = found.lines()
    return [f"{found.case.name}: {head[1]}", *lines]


def plot(found: Estimate, ax: Axes) -> None:
    """Force over travel with its band, and where the cut begins."""
    ax.fill_between(found.x_mm, found.low_N, found.high_N, color=COLOURS["sky"], alpha=0.5, lw=0,
                    label="90 % of runs")  # fmt: skip
    ax.plot(found.x_mm, found.force_N, color=COLOURS["blue"], label="estimate")
    onset = found.onset_mm
    if np.isfinite(onset.value):
        at = float(np.interp(onset.value, found.x_mm, found.force_N))
        ax.errorbar([onset.value], [at], xerr=[[onset.value - onset.low], [onset.high - onset.value]],
                    fmt="o", mfc="white", color=COLOURS["vermilion"], label="onset of cutting")  # fmt: skip
    ax.set_title(f"{found.case.name}, estimated", loc="left")
    force_from_zero(ax, "blade travel (mm)")


def table(found: Estimate) -> dict[str, np.ndarray]:
    """The curve with its band, and the work by mechanism."""
    curve = {
        "displacement_mm": found.x_mm,
        "force_N": found.force_N,
        "low_N": found.low_N,
        "high_N": found.high_N,
    }
    return curve | {f"work_{name}": share for name, share in found.work.items()}


def to_dict(found: Estimate) -> dict[str, object]:
    """Plain data, for JSON."""
    return {
        "case": found.case.to_dict(), "verdict": found.verdict, "chances": dict(found.chances),
        **{name: vars(getattr(found, name)) for name in MEASURES},
        "nearest": [{"lengths": far, "groups": dict(groups)} for far, groups in found.nearest],
        "work": {name: share[-1] for name, share in found.work.items()},
    }  # fmt: skip


def write(found: Estimate, folder: Path) -> None:
    """``estimate.json``, ``estimate.csv`` and ``estimate.png``."""
    folder = check_writable(folder)
    write_json(to_dict(found), folder / "estimate.json")
    columns = table(found)
    rows = [[f"{value:.6g}" for value in row] for row in zip(*columns.values(), strict=True)]
    write_text(csv_text(list(columns), rows), folder / "estimate.csv")
    with style():
        figure = new_figure(SINGLE_MM, 75)
        plot(found, axes := figure.subplots())
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    save(figure, folder / "estimate.png")
