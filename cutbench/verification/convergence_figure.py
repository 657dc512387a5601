"""How far each change of the numerics moves each measure, one panel a material."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from cutbench.base.figure_style import DOUBLE_MM, GREY, LINE_COLOURS, style

if TYPE_CHECKING:
    from cutbench.verification.convergence import ConvergenceRow

#: Beyond this, at the most, a mark sits at the edge as an arrow, %.
EDGE = 30.0
_TITLES = {
    "onset_mm": ("onset", "o"),
    "peak_N": ("peak", "s"),
    "drop_rel": ("drop", "^"),
    "steady_N": ("steady force", "D"),
    "slope_N_per_mm": ("slope", "v"),
}


def plot_convergence(rows: Sequence[ConvergenceRow], tolerance: float = 3.0) -> Figure:
    """Relative changes in per cent, refinements above other choices; the band is the tolerance."""
    materials = list(dict.fromkeys(row.material for row in rows))
    changed = [row for row in rows if row.change]
    largest = max(
        (100 * abs(v) for row in changed for v in row.moved.values() if not math.isnan(v)), default=0
    )
    edge = min(EDGE, max(2 * tolerance, 1.1 * largest))
    names = list(dict.fromkeys(r.change for r in sorted(changed, key=lambda r: not r.refinement)))
    with style():
        figure = Figure(figsize=(DOUBLE_MM / 25.4, (24 + 5.2 * len(names)) / 25.4), layout="constrained")
        axes = figure.subplots(1, len(materials), sharey=True, squeeze=False)[0]
        colours = LINE_COLOURS
        for ax, material in zip(axes, materials, strict=True):
            ax.axvspan(-tolerance, tolerance, color="0.88", lw=0, zorder=0)
            ax.axvline(0, color=GREY, lw=0.6)
            for k, (key, (title, marker)) in enumerate(_TITLES.items()):
                points = [
                    (100 * row.moved[key], names.index(row.change) + 0.13 * (k - 2))
                    for row in changed
                    if row.material == material and not math.isnan(row.moved[key])
                ]
                inside = [p for p in points if abs(p[0]) <= edge]
                ax.plot(
                    [p[0] for p in inside], [p[1] for p in inside], marker, color=colours[k],
                    mfc="white" if k % 2 else colours[k], ms=3.6, mew=0.9, ls="", label=title,
                )  # fmt: skip
                for side, marker_out in ((1, ">"), (-1, "<")):
                    beyond = [p[1] for p in points if side * p[0] > edge]
                    ax.plot([side * edge] * len(beyond), beyond, marker_out, color=colours[k], ms=4, ls="")
            ax.set_title(material)
            ax.set_xlim(-1.08 * edge, 1.08 * edge)
            ax.set_xlabel("change of the measure (%)")
        axes[0].set_yticks(range(len(names)), names)
        axes[0].set_ylim(len(names) - 0.5, -0.5)
        refinements = len({row.change for row in changed if row.refinement})
        for ax in axes:
            if 0 < refinements < len(names):
                ax.axhline(refinements - 0.5, color="black", lw=0.6)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure
