"""What other choices make of a run: a row each, and how far each measure goes from the run as asked."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from cutbench.base.figure_style import DOUBLE_MM, GREY, LINE_COLOURS, style
from cutbench.run.measures import ABRUPT_DROP

#: What is shown: measure -> (words for its value, its factor, words for it over the first's, for none).
SHOWN_MEASURES = {
    "onset_mm": ("onset (mm)", 1.0, "onset over the first's", "not cut"),
    "peak_N": ("peak of the force (N)", 1.0, "peak over the first's", "no peak"),
    "drop_rel": ("fall of the force (%)", 100.0, "fall of the force (%)", "not cut"),
}
MARKERS = ("o", "s", "^", "D", "v")


def plot_choices(found: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Figure:
    """Measures by choice, of each material; its first choice is where bars begin.

    The fall has the threshold of its label. Of one material a row without a value says so, and the range of
    all is shaded; onset and peak of several materials are over those of their first.
    """
    names = list(dict.fromkeys(name for rows in found.values() for name in rows))
    alone = len(found) == 1
    with style():
        figure = Figure(figsize=(DOUBLE_MM / 25.4, (24 + 5.2 * len(names)) / 25.4), layout="constrained")
        axes = figure.subplots(1, len(SHOWN_MEASURES), sharey=True)
        for ax, (key, (value, factor, relative, none)) in zip(axes, SHOWN_MEASURES.items(), strict=True):
            drop = key == "drop_rel"
            ax.set_xlabel(value if alone else relative)
            for k, (material, rows) in enumerate(found.items()):
                first = next(iter(rows.values())).get(key, math.nan)
                scale = factor / (1.0 if alone or drop else first)
                x = scale * np.array([row.get(key, math.nan) for row in rows.values()])
                y = np.array([names.index(name) for name in rows]) + 0.18 * (k - (len(found) - 1) / 2)
                look = {"color": LINE_COLOURS[(k + alone) % len(LINE_COLOURS)]}
                if alone and np.isfinite(x).any():
                    ax.axvspan(np.nanmin(x), np.nanmax(x), color="0.92", lw=0, zorder=0)
                ax.hlines(y, scale * first, x, lw=3.0 if alone else 1.0, alpha=0.55, **look)
                ax.plot(
                    x, y, MARKERS[k % len(MARKERS)], mfc="white" if k % 2 else look["color"], ms=3.6, mew=0.9,
                    ls="", label=material, clip_on=False, **look,
                )  # fmt: skip
                if (alone or not drop) and math.isfinite(first):
                    ax.vlines(scale * first, -0.4, len(names) - 0.4, color=GREY, lw=0.6)
                for place in y[np.isnan(x)] if alone else ():
                    ax.annotate(
                        none, (0.98, place), xycoords=("axes fraction", "data"), ha="right", va="center",
                        color=GREY,
                    )  # fmt: skip
            if drop:
                at = factor * ABRUPT_DROP
                ax.axvline(at, color="black", lw=0.8, ls="--")
                ax.annotate("abrupt →", (at, -0.6), (2, 0), textcoords="offset points", va="center")
                ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
        axes[0].set_yticks(range(len(names)), names)
        axes[0].set_ylim(len(names) - 0.4, -1.1)
        if alone:
            figure.suptitle(next(iter(found)))
        else:
            handles, labels = axes[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure
