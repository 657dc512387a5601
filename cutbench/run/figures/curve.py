"""Force against blade travel, and which mechanism takes it up."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.integrate import cumulative_trapezoid

from cutbench.base.figure_style import (
    COLOURS,
    GREY,
    HATCHES,
    LINE_COLOURS,
    LINES,
    Look,
    Size,
    force_from_zero,
    legend_in_rows,
    new_figure,
    one_type,
    sized,
    style,
)
from cutbench.mechanisms import registry
from cutbench.run.measures import forward
from cutbench.run.result import SNAP, TRANSFER, Result

#: Of both panels with the legend beside them: a column and a half.
WIDTH_MM = 140.0
#: Width of a letter, mean, in mm for each pt of type.
_LETTER = 0.18
#: Entries that never reach this share of the largest force are drawn together.
NEGLIGIBLE = 0.005
#: Labels of entries that are not in the registry.
NO_MECHANISM = {SNAP: "unresolved jumps", TRANSFER: "new meshes"}


def plot_curve(result: Result, size: Size | None = None) -> Figure:
    """Force on the blade (N) over its travel (mm), above the same force split by mechanism.

    The split is the slope of each mechanism's work over half the blade's thickness of travel, because a
    single step's share is noisy. What takes up work is stacked above zero; what gives it back (released
    elastic energy) is stacked below; both together are the force. Of a ``size`` the legend is below, and
    where that is as high as a slide the panels stand side by side.
    """
    window_mm = getattr(result.case.p, "thickness", 0.7) / 2
    beside = size is not None and size.height_mm is not None
    with style(size):
        figure = new_figure(WIDTH_MM, 100) if size is None else sized(size, 115)
        top, low = figure.subplots(1, 2) if beside else figure.subplots(2, 1, sharex=True)
        draw_force(top, result)
        _split(low, result, window_mm)
        low.set_xlabel("blade travel (mm)")
        for axes in (top, low):
            axes.set_xlim(0, 1.02 * (float(np.max(result.displacement_mm, initial=0.0)) or 1.0))
        if beside:
            top.set_xlabel("blade travel (mm)")
        else:
            figure.align_ylabels([top, low])
        figure.suptitle(result.case.name, x=0.02, ha="left")
        across = (0.45 if beside else 0.8) * size.width_mm if size is not None else 0.0
        letters = 72 if size is None else int(across / (_LETTER * size.text_pt))
        top.set_title("\n".join(wrap(result.sentence(), letters)), loc="left", fontsize=7.5)
        low.set_title("\n".join(wrap(low.get_title("left"), letters)), loc="left", fontsize=7.5, color=GREY)
        one_type(figure, size)
        handles, names = low.get_legend_handles_labels()
        if size is not None:
            legend_in_rows(figure, [*handles[::-1]], "outside lower center")
        elif handles:
            # Outside the axes, where it hides no areas; the last in the list is the first from below.
            figure.legend(handles[::-1], names[::-1], loc="outside right center")
    return figure


#: What marks the line of a run's force in axes.
FORCE = "force"


def plot_curves(results: Mapping[str, Result], size: Size | None = None) -> Figure:
    """Forces (N) over travel (mm) of several runs in one picture, each under the name that it is given."""
    with style(size):
        figure = new_figure(WIDTH_MM, 80) if size is None else sized(size, 75)
        axes = figure.subplots()
        for name, result in results.items():
            axes.plot(result.displacement_mm, result.force_N, label="\n".join(wrap(name, 24)))
        force_from_zero(axes, "blade travel (mm)")
        if size is None:
            figure.legend(loc="outside right center")
        else:
            legend_in_rows(figure, axes.get_legend_handles_labels()[0], "outside lower center")
    return figure


def smooth_force(
    travel_mm: np.ndarray, work_mJ: np.ndarray, window_mm: float, at_mm: np.ndarray
) -> np.ndarray:
    """Mean force (N) over a window of travel centred at ``at_mm``: the work's difference by the window.

    Exact for any step size, since work adds up over steps; the window is cut off at the curve's ends.
    """
    left = np.clip(at_mm - window_mm / 2, travel_mm[0], travel_mm[-1])
    right = np.clip(at_mm + window_mm / 2, travel_mm[0], travel_mm[-1])
    gain = np.interp(right, travel_mm, work_mJ) - np.interp(left, travel_mm, work_mJ)
    return gain / np.maximum(right - left, np.finfo(float).tiny)


def draw_force(axes: Axes, result: Result) -> None:
    """Force (N) over travel (mm) into ``axes``, with onset, peak and how it ended. In axes that have runs
    already it gets a look of its own, and legend and limits hold for all of them."""
    travel, force = result.displacement_mm, result.force_N
    drawn = [line for line in axes.lines if line.get_gid() == FORCE]
    own: Look = {"color": LINE_COLOURS[len(drawn) % len(LINE_COLOURS)], "ls": LINES[len(drawn) % len(LINES)]}
    axes.plot(travel, force, gid=FORCE, label=result.case.name if drawn else None, **own)
    axes.set_ylabel("force (N)")
    low, high = float(np.min(force, initial=0.0)), float(np.max(force, initial=1e-9))
    before = axes.get_ylim() if drawn else (0.0, 0.0)
    axes.set_ylim(min(1.12 * low, before[0]), max(1.12 * high, before[1]))
    onset, peak = (result.measures.get(key, np.nan) for key in ("onset_mm", "peak_mm"))
    if np.isfinite(onset):
        down = forward(travel)
        at = float(np.interp(onset, travel[:down], force[:down]))
        text = f"onset of cutting, {onset:.2f} mm"
        axes.plot([onset], [at], "o", mfc="white", mec=COLOURS["blue"], label=text)
    if np.isfinite(peak):
        at = result.measures.get("peak_N", float(np.interp(peak, travel, force)))
        text = f"peak, {at:.3g} N at {peak:.2f} mm"
        axes.plot([peak], [at], "v", color=COLOURS["vermilion"], label=text)
    if not result.outcome.done:
        text = f"{result.outcome.kind} at {result.outcome.reached_mm:.2f} mm"
        look: Look = {"color": COLOURS["vermilion"], "ms": 5.5, "mec": "white", "mew": 0.5}
        axes.plot(travel[-1:], force[-1:], "X", label=text, **look)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")


def _split(axes, result: Result, window_mm: float) -> None:
    axes.set_ylabel("force by mechanism (N)")
    axes.axhline(0, color="black", lw=0.5, zorder=4)
    count = forward(result.displacement_mm)
    travel = result.displacement_mm[:count]
    if len(travel) < 2:
        return
    at = np.linspace(travel[0], travel[-1], 800)
    shares = _shares(result, window_mm, at)
    up, down = np.zeros(at.size), np.zeros(at.size)
    for label, look, share in shares:
        gain, loss = np.maximum(share, 0), np.minimum(share, 0)
        axes.fill_between(at, up, up + gain, label=label, **look)
        axes.fill_between(at, down, down + loss, **look)
        up, down = up + gain, down + loss
    work = cumulative_trapezoid(result.force_N[:count], travel, initial=0)
    total = smooth_force(travel, work, window_mm, at)
    axes.plot(at, total, color="black", ls="-", lw=1.0, label="force on the blade", zorder=5)
    axes.margins(y=0.05)
    until = "; until the blade rests" if count < result.displacement_mm.size else "; below zero: released"
    axes.set_title(f"mean over {window_mm:.2g} mm of travel{until}", loc="left", fontsize=7.5, color=GREY)


def _shares(result: Result, window_mm: float, at: np.ndarray) -> list[tuple[str, dict, np.ndarray]]:
    """Label, look and smoothed force (N), in the ledger's order, small ones drawn together at the end."""
    down = forward(result.displacement_mm)
    travel = result.displacement_mm[:down]
    largest = float(np.max(np.abs(result.force_N)))
    shares = []
    others, rest = [], np.zeros(at.size)
    for i, name in enumerate(result.ledger):
        work = result.curve.get(f"work_{name}_mJ")
        if work is None:
            work = cumulative_trapezoid(result.curve[f"force_{name}_N"][:down], travel, initial=0)
        share = smooth_force(travel, np.asarray(work, dtype=float)[:down], window_mm, at)
        if not np.any(share):
            continue
        if np.max(np.abs(share)) < NEGLIGIBLE * largest:
            others.append(_label(name))
            rest += share
        else:
            # By place in the ledger, so that a mechanism looks the same in all pictures of a model.
            shares.append((_label(name), _look("#9A9A9A" if name == SNAP else None, i), share))
    if others:
        label = others[0] if len(others) == 1 else f"{len(others)} others, each < {100 * NEGLIGIBLE:g} %"
        shares.append((label, _look("#D9D9D9", 0), rest))
    return shares


def _look(colour: str | None, place: int) -> dict:
    colours = [c for name, c in COLOURS.items() if name != "black"]
    return {
        "facecolor": colour or colours[place % len(colours)],
        "hatch": HATCHES[place % len(HATCHES)],
        "edgecolor": "white",
        "lw": 0.0,
    }


def _label(name: str) -> str:
    if name in NO_MECHANISM:
        return NO_MECHANISM[name]
    mechanism = registry().get(name)
    return mechanism.title if mechanism else name.replace("_", " ")
