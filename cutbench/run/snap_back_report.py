"""What following a path has found, in words, as a table, as JSON and as a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.figure_style import COLOURS, GREY, SINGLE_MM, Look, force_from_zero, new_figure, style
from cutbench.run.measures import measures
from cutbench.run.result import SNAP
from cutbench.run.snap_back import (
    MESH,
    MIN_JUMP_ELEMENTS,
    OPEN,
    PHYSICAL,
    STABLE,
    Jump,
    SnapBack,
    as_seen_by_advancing_blade,
)

#: Steady force and slope mean nothing here; these are measures of the transition.
TRANSITION = ("drop_rel", "onset_mm", "peak_N", "peak_mm")


def limit_rows(followed: SnapBack) -> list[dict[str, object]]:
    """Onset, peak and drop with less and less viscosity, and of the path, over one stretch of travel."""
    viscous = [SNAP, *(law.name for law in followed.case.model.all if law.regularises)]
    rows = []
    for text, result in (("as asked", followed.run), *followed.limit):
        spent = [result.curve[key][-1] for name in viscous if (key := f"work_{name}_mJ") in result.curve]
        rows.append((text, result.measures, str(result.outcome), float(sum(spent))))
    shape, p = as_seen_by_advancing_blade(followed), followed.case.p
    if shape["displacement_mm"].size > 2:
        found = measures(shape, window_mm=p.thickness, height_mm=p.height)
        rows.append(("path at rest", found, followed.stopped or "done", 0.0))
    return [
        {"what": text, "outcome": outcome, "to_viscosity_mJ": spent}
        | {key: found.get(key, math.nan) for key in TRANSITION}
        for text, found, outcome, spent in rows
    ]


def sentence(followed: SnapBack) -> str:
    """What was found, in words."""
    jump, h = followed.jump, followed.case.sizes.h_mm
    end_mm = float(followed.curve["displacement_mm"][-1])
    drop = followed.run.measures.get("drop_rel", math.nan)
    asked = (
        f"As asked, the force falls by {drop:.0%}." if math.isfinite(drop) else "As asked, nothing is cut."
    )
    if followed.verdict == STABLE:
        return (
            f"No jump: equilibrium at rest goes forward all the way to {end_mm:.2f} mm of travel. {asked}"
            " What falls, falls in a stable way."
        )
    if jump is None:
        return f"Open: the path ended at {end_mm:.2f} mm before it turned ({followed.stopped}). {asked}"
    end = "" if jump.landed else f", where the path ended ({followed.stopped})"
    signs = ""
    if math.isfinite(jump.softest_before) and math.isfinite(jump.softest_after):
        signs = (
            f"; the tangent's lowest eigenvalue goes from {jump.softest_before:.2g} to"
            f" {jump.softest_after:.2g} there"
        )
    what = (
        f"at {jump.travel_mm:.3f} mm equilibrium at rest turns back by {jump.back_mm:.2f} mm{signs}."
        f" The force jumps from {jump.force_N:.3g} to {jump.landing_N:.3g} N ({jump.drop_rel:.0%}){end},"
        f" the cut grows by {jump.advance_mm:.2f} mm ({jump.advance_mm / h:.1f} elements), and"
        f" {jump.freed_mJ:.3g} mJ are set free"
    )
    heads = {
        PHYSICAL: "The jump is physical: ",
        MESH: f"A jump of fewer than {MIN_JUMP_ELEMENTS:g} elements, which may be theirs (try a smaller h): ",
        OPEN: "Open: ",
    }
    parts = ""
    if jump.releases:
        parts = (
            f" No equilibrium was near at {jump.releases} place(s) of this stretch, and the body was let go:"
            f" {jump.released_mm:.2f} mm of the cut's growth, {jump.released_mJ:.2g} mJ."
        )
    return f"{heads[followed.verdict]}{what}.{parts} {asked}"


def describe_followed(followed: SnapBack) -> dict[str, object]:
    """The content of follow.json."""
    jump = followed.jump

    def plain(one: Jump) -> dict[str, object]:
        known = {k: v for k, v in vars(one).items() if k not in ("first", "last")}
        return known | {"drop_rel": one.drop_rel}

    return {
        "schema": 1,
        "verdict": followed.verdict,
        "text": sentence(followed),
        "case": followed.case.to_dict(),
        "jump": None if jump is None else plain(jump),
        "jumps": [plain(one) for one in followed.jumps],
        "limit": limit_rows(followed),
        "path": {
            "points": int(followed.curve["force_N"].size),
            "to_mm": float(followed.curve["displacement_mm"][-1]),
            "cut_length_mm": float(followed.curve["cut_length_mm"][-1]),
            "stopped": followed.stopped,
            "released_points": int((followed.curve["released"] > 0).sum()),
            "without": [m.name for m in followed.case.model.all if m.regularises],
        },
        "seconds": followed.seconds,
    }


def plot_followed(followed: SnapBack) -> Figure:
    """Force against travel of the runs and of the path, above the eigenvalue against the cut's length.

    The largest jump is drawn as an arrow; the area between it and the path, as far as it is above the path's
    way back, is the energy set free.
    """
    soft = np.isfinite(followed.curve["softest"])
    with style():
        figure = new_figure(SINGLE_MM, 118 if soft.any() else 82)
        if soft.any():
            top, low = figure.subplots(2, 1, height_ratios=(2.2, 1))
            _eigenvalue(low, followed.curve, followed.jump)
        else:
            top = figure.subplots()
        _forces(top, followed)
        figure.align_ylabels()
        figure.suptitle(followed.case.name, x=0.02, ha="left")
        names = top.get_legend_handles_labels()
        figure.legend(*names, loc="outside lower center", ncols=2, columnspacing=1.2)
    return figure


def _forces(axes: Axes, followed: SnapBack) -> None:
    path, jump = followed.curve, followed.jump
    d, F, let_go = path["displacement_mm"], path["force_N"], path["released"] > 0
    end = 1.15 * float(d.max())
    if jump is not None:
        part = slice(jump.first, jump.last + 1)
        axes.fill(
            np.append(d[part], d[jump.first]), np.append(F[part], F[jump.first]),
            color=COLOURS["sky"], alpha=0.35, lw=0, label=f"set free, {jump.freed_mJ:.2g} mJ",
        )  # fmt: skip
    looks: tuple[Look, ...] = (
        {"color": COLOURS["black"], "ls": "-"}, {"color": COLOURS["orange"], "ls": (0, (5, 1.5)), "lw": 1.0},
        {"color": COLOURS["green"], "ls": (0, (1, 1.2)), "lw": 1.0},
        {"color": COLOURS["purple"], "ls": "-.", "lw": 1.0},
    )  # fmt: skip
    for (text, run), look in zip((("as asked", followed.run), *followed.limit), looks, strict=False):
        shown = run.displacement_mm <= end
        axes.plot(run.displacement_mm[shown], run.force_N[shown], label=text, **look)
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


def _eigenvalue(axes: Axes, path: Mapping[str, np.ndarray], jump: Jump | None) -> None:
    known = np.isfinite(path["softest"])
    axes.axhline(0, color=GREY, lw=0.6)
    length, softest = path["cut_length_mm"][known], path["softest"][known]
    axes.plot(length, softest, color=COLOURS["blue"], ls="-", marker=".", ms=3)
    if jump is not None:
        axes.axvline(float(path["cut_length_mm"][jump.first]), color=COLOURS["vermilion"], ls="--", lw=0.9)
    axes.set_xlabel("length of the cut (mm)")
    axes.set_ylabel(r"eigenvalue ($\lambda/G$)")
