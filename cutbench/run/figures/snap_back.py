"""The path of equilibria beside what a blade sees that only moves forward, and the tangent's eigenvalue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from cutbench.base.figure_style import COLOURS, GREY, SINGLE_MM, force_from_zero, new_figure, style


def plot_follow(
    run: Mapping[str, np.ndarray],
    path: Mapping[str, np.ndarray],
    jump,
    limit: Sequence[tuple[str, Mapping[str, np.ndarray]]],
    *,
    title: str,
) -> Figure:
    """Force against travel of the run and of the path, above the eigenvalue against the cut's length.

    ``jump`` (a ``follow.Jump`` or None) is drawn as an arrow; the area between it and the path, as far as
    it is above the path's way back, is the energy set free.
    """
    soft = np.isfinite(path["softest"])
    with style():
        figure = new_figure(SINGLE_MM, 118 if soft.any() else 82)
        if soft.any():
            top, low = figure.subplots(2, 1, height_ratios=(2.2, 1))
        else:
            top, low = figure.subplots(), None
        _forces(top, run, path, jump, limit)
        if low is not None:
            _eigenvalue(low, path, jump)
            figure.align_ylabels([top, low])
        figure.suptitle(title, x=0.02, ha="left")
        names = top.get_legend_handles_labels()
        figure.legend(*names, loc="outside lower center", ncols=2, columnspacing=1.2)
    return figure


def _forces(axes, run, path, jump, limit) -> None:
    d, F, let_go = path["displacement_mm"], path["force_N"], path["released"] > 0
    end = 1.15 * float(d.max())
    if jump is not None:
        part = slice(jump.first, jump.last + 1)
        axes.fill(
            np.append(d[part], d[jump.first]), np.append(F[part], F[jump.first]),
            color=COLOURS["sky"], alpha=0.35, lw=0, label=f"set free, {jump.freed_mJ:.2g} mJ",
        )  # fmt: skip
    shown = run["displacement_mm"] <= end
    axes.plot(run["displacement_mm"][shown], run["force_N"][shown], color=COLOURS["black"], ls="-",
              label="as asked")  # fmt: skip
    looks = ((COLOURS["orange"], (0, (5, 1.5))), (COLOURS["green"], (0, (1, 1.2))), (COLOURS["purple"], "-."))
    for (text, curve), (colour, line) in zip(limit, looks, strict=False):
        shown = curve["displacement_mm"] <= end
        over, force = curve["displacement_mm"][shown], curve["force_N"][shown]
        axes.plot(over, force, color=colour, ls=line, lw=1.0, label=text)
    resting = np.where(let_go, np.nan, F)
    axes.plot(d, resting, color=COLOURS["blue"], ls="-", lw=1.4, label="equilibria at rest")
    if let_go.any():
        wide = let_go | np.append(let_go[1:], False)
        axes.plot(
            d, np.where(wide, F, np.nan), color=COLOURS["blue"], ls=":", marker=".", ms=2.5, lw=1.0,
            label="none near: let go",
        )  # fmt: skip
    if jump is not None:
        axes.annotate(
            "", (jump.travel_mm, jump.landing_N), (jump.travel_mm, jump.force_N),
            arrowprops={"arrowstyle": "-|>", "color": COLOURS["vermilion"], "lw": 1.4, "shrinkA": 0},
        )  # fmt: skip
        axes.plot([jump.travel_mm], [jump.force_N], "o", color=COLOURS["vermilion"], label="turning point")
    force_from_zero(axes, "blade travel (mm)")
    axes.set_xlim(right=end)


def _eigenvalue(axes, path, jump) -> None:
    known = np.isfinite(path["softest"])
    axes.axhline(0, color=GREY, lw=0.6)
    length, softest = path["cut_length_mm"][known], path["softest"][known]
    axes.plot(length, softest, color=COLOURS["blue"], ls="-", marker=".", ms=3)
    if jump is not None:
        axes.axvline(float(path["cut_length_mm"][jump.first]), color=COLOURS["vermilion"], ls="--", lw=0.9)
    axes.set_xlabel("length of the cut (mm)")
    axes.set_ylabel(r"eigenvalue ($\lambda/G$)")
