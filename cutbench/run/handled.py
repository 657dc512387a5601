"""A run as people handle it: in words, as a picture, as tables, as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from cutbench.base.figure_style import save
from cutbench.base.files import check_writable
from cutbench.run.figures.curve import draw_force, plot_curve
from cutbench.run.figures.section import plot_section
from cutbench.run.files import write_run

if TYPE_CHECKING:
    from cutbench.run.result import Result

#: In the order in which a person asks, with format and unit.
MEASURES = {
    "onset": ("onset_mm", ".3g", "mm"),
    "peak": ("peak_N", ".4g", "N"),
    "force falls by": ("drop_rel", ".1%", ""),
    "steady force": ("steady_N", ".4g", "N"),
    "work": ("energy_mJ", ".4g", "mJ"),
    "energy left open": ("closure", ".2%", ""),
}


def told(result: Result) -> list:
    """Head, then pairs of words."""
    case, found = result.case, result.measures
    lines = [("found", result.sentence())]
    if not result.outcome.done:
        lines.append(("ended", str(result.outcome)))
    cut = np.isfinite(found.get("onset_mm", np.nan))
    for words, (name, form, unit) in MEASURES.items():
        # Without a cut there is no force of cutting.
        if (cut or name in ("energy_mJ", "closure")) and np.isfinite(value := found.get(name, np.nan)):
            lines.append((words, f"{value:{form}} {unit}".rstrip()))
    steps = f"{len(result.displacement_mm)} steps, {result.timings.get('total', 0):.3g} s"
    return [f"{case.name}, {case.dim}D, run {result.id}", *lines, ("cost", steps)]


def plot(result: Result, ax: Axes) -> None:
    """Force over travel, with onset and peak."""
    draw_force(ax, result)
    ax.set_xlabel("blade travel (mm)")
    ax.set_title(result.case.name, loc="left")


def table(result: Result) -> dict[str, np.ndarray]:
    """The curve, a row a step; units in the names."""
    return dict(result.curve)


def dataset(result: Result) -> xr.Dataset:
    """The curve over its steps; the blade's travel and the time are coordinates."""
    data = xr.Dataset(attrs={"case": result.case.name, "run": result.id, "said": result.sentence()})
    for name, values in result.curve.items():
        head, _, unit = name.rpartition("_")
        known = unit in ("mm", "N", "s", "mJ")
        data[head if known else name] = ("step", values, {"units": unit if known else "1"})
    return data.set_coords(["displacement", "time"])


def write(result: Result, folder: Path) -> None:
    """What ``cutbench run2d --out`` writes."""
    folder = check_writable(folder)
    write_run(result, folder)
    save(plot_curve(result), folder / "curve.png")
    if any(s.cell_type.startswith("triangle") for s in result.snapshots):
        save(plot_section(result), folder / "section.png")
