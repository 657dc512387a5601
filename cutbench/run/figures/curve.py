"""Force against blade travel, and which mechanism takes it up."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from textwrap import wrap

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.integrate import cumulative_trapezoid

from cutbench.base.figure_style import (
    COLOURS,
    GREY,
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
from cutbench.run.ledger import work_per_travel
from cutbench.run.measures import forward
from cutbench.run.result import ALONG, SELF_CONTACT, SNAP, TRANSFER, Result

#: Of both panels with the legend beside them: a column and a half.
WIDTH_MM = 140.0
#: Width of a letter, mean, in mm for each pt of type.
_LETTER = 0.18
#: Entries that never reach this share of the largest force are drawn together.
NEGLIGIBLE = 0.01
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
        over, label = abscissa(result)
        apart = beside or over is not result.displacement_mm
        top, low = figure.subplots(1, 2) if beside else figure.subplots(2, 1, sharex=not apart)
        draw_force(top, result)
        marks = _take_legend(top)
        _split(low, result, window_mm)
        low.set_xlabel("blade travel (mm)")
        for axes, values in ((top, over), (low, result.displacement_mm)):
            axes.set_xlim(0, 1.02 * (float(np.max(values, initial=0.0)) or 1.0))
        top.set_xlabel(label if apart else "")
        if not beside:
            figure.align_ylabels([top, low])
        figure.suptitle(result.case.name, x=0.02, ha="left")
        across = (0.36 if beside else 0.75) * size.width_mm if size is not None else 0.0
        letters = 72 if size is None else int(across / (_LETTER * size.text_pt))
        top.set_title(_wrapped(result.sentence(), letters), loc="left", fontsize=7.5)
        low.set_title(_wrapped(low.get_title("left"), letters), loc="left", fontsize=7.5, color=GREY)
        one_type(figure, size)
        # Outside the axes, where it hides nothing; the last in the list of areas is the first from below.
        handles = [*marks, *low.get_legend_handles_labels()[0][::-1]]
        if size is not None:
            legend_in_rows(figure, handles, "outside lower center")
        elif handles:
            figure.legend(handles=handles, loc="outside right center")
    return figure


def _wrapped(text: str, letters: int) -> str:
    """In lines of so many letters, no number without its unit."""
    return "\n".join(wrap(re.sub(r"(?<=\d) (?=%|mm)", "\u00a0", text), letters))


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


def abscissa(result: Result) -> tuple[np.ndarray, str]:
    """Over what the force of a run is drawn: the blade's travel, or the time where it rests or turns."""
    travel = result.displacement_mm
    if forward(travel) < travel.size:
        return result.curve["time_s"], "time (s)"
    return travel, "blade travel (mm)"


def draw_force(axes: Axes, result: Result) -> None:
    """Force (N) over travel (mm), or time (s), into ``axes``, with onset, peak and how it ended.

    Alone, a run has the numbers of onset and peak in the legend. In axes that have runs already it gets a
    look of its own; then the legend has the name of each, and what the symbols mean once.
    """
    travel, force = result.displacement_mm, result.force_N
    drawn = [line for line in axes.lines if line.get_gid() == FORCE]
    own: Look = {"color": LINE_COLOURS[len(drawn) % len(LINE_COLOURS)], "ls": LINES[len(drawn) % len(LINES)]}
    names = [str(line.get_label()).removeprefix("_") for line in drawn]
    name = result.name if result.name not in names else f"{result.name}, run {result.id}"
    # The underscore keeps it out of the legend, as long as the run is alone.
    across, label = abscissa(result)
    axes.plot(across, force, gid=FORCE, label=name if drawn else f"_{name}", **own)
    if not drawn and ALONG in result.curve:
        axes.plot(across, result.curve[ALONG], color=own["color"], ls=":", gid=ALONG, label="along the edge")
    axes.set_xlabel(label)
    axes.set_ylabel("force (N)")
    onset, peak = (result.measures.get(key, np.nan) for key in ("onset_mm", "peak_mm"))
    marks: list[tuple[float, float, str, Look, str]] = []
    down = forward(travel)

    def place(travelled: float) -> float:
        return float(np.interp(travelled, travel[:down], across[:down]))

    if np.isfinite(onset):
        at = float(np.interp(onset, travel[:down], force[:down]))
        look: Look = {"marker": "o", "mfc": "white", "mec": own["color"] if drawn else COLOURS["blue"]}
        marks.append((place(onset), at, "onset of cutting", look, f", {onset:.2f} mm"))
    if np.isfinite(peak):
        at = result.measures.get("peak_N", float(np.interp(peak, travel, force)))
        look = {"marker": "v", "color": own["color"] if drawn else COLOURS["vermilion"]}
        marks.append((place(peak), at, "peak", look, f", {at:.3g} N at {peak:.2f} mm"))
    if not result.outcome.done:
        look = {"color": COLOURS["vermilion"], "marker": "X", "ms": 5.5, "mec": "white", "mew": 0.5}
        text = f" at {result.outcome.reached_mm:.2f} mm"
        marks.append((across[-1], force[-1], result.outcome.kind, look, text))
    for x, y, kind, look, numbers in marks:
        axes.plot([x], [y], ls="", gid=kind, label=f"{kind}{'' if drawn else numbers}", **look)
    _force_legend(axes)


def _take_legend(axes: Axes) -> list[Artist]:
    """What the legend of ``axes`` names, for one outside them."""
    if (legend := axes.get_legend()) is None:
        return []
    legend.remove()
    axes.set_ylim(axes.get_ylim()[0], 1.06 * axes.dataLim.y1)
    return [*axes.get_legend_handles_labels()[0]]


def _force_legend(axes: Axes) -> None:
    """The legend of forces, above all that is drawn."""
    lines = [line for line in axes.lines if line.get_gid() == FORCE]
    marks = [line for line in axes.lines if line.get_gid() not in (None, FORCE)]
    handles: list[Artist] = [*marks]
    if len(lines) > 1:
        for line in lines:
            line.set_label(str(line.get_label()).removeprefix("_"))
        for mark in marks:
            if mark.get_label() != mark.get_gid():  # of the first, which was alone
                mark.set(color=lines[0].get_color(), mec=lines[0].get_color(), label=mark.get_gid())
        look: Look = {"ls": "", "mec": GREY}
        kinds = {line.get_gid(): (line.get_marker(), line.get_markerfacecolor()) for line in marks}
        handles = [*lines]
        for kind, (marker, face) in kinds.items():
            fill = face if face == "white" else GREY
            handles.append(Line2D([], [], marker=marker, mfc=fill, label=kind, **look))
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in lines])
    low, high = 1.12 * float(np.min(values, initial=0.0)), 1.06 * float(np.max(values, initial=1e-9))
    axes.set_ylim(low, high)
    if not handles:
        return
    legend = axes.legend(handles=handles, loc="upper left", ncols=1 if len(handles) < 4 else 2)
    if (figure := axes.get_figure(root=True)) is not None:
        figure.draw_without_rendering()
        part = legend.get_window_extent().height / axes.get_window_extent().height
        axes.set_ylim(low, low + (high - low) / max(0.3, 0.98 - part))


def _split(axes, result: Result, window_mm: float) -> None:
    axes.set_ylabel("force by mechanism (N)")
    axes.axhline(0, color="black", lw=0.5, zorder=4)
    count = forward(result.displacement_mm)
    travel = result.displacement_mm[:count]
    if len(travel) < 2:
        return
    at = np.linspace(travel[0], travel[-1], 800)
    shares, small = ledger_shares(result, window_mm, at)
    drawn = [(title_of(name), _look(name), share) for name, share in shares.items()]
    if small:
        label = title_of(*small) if len(small) == 1 else f"{len(small)} others, each < {100 * NEGLIGIBLE:g} %"
        drawn.append((label, _look(""), np.sum([*small.values()], axis=0)))
    up, down = np.zeros(at.size), np.zeros(at.size)
    for label, look, share in drawn:
        gain, loss = np.maximum(share, 0), np.minimum(share, 0)
        axes.fill_between(at, up, up + gain, label=label, **look)
        axes.fill_between(at, down, down + loss, **look)
        up, down = up + gain, down + loss
    work = cumulative_trapezoid(work_per_travel(result.case, result.curve)[:count], travel, initial=0)
    total = smooth_force(travel, work, window_mm, at)
    what = "work of the blade per travel" if ALONG in result.curve else "force on the blade"
    axes.plot(at, total, color="black", ls="-", lw=1.0, label=what, zorder=5)
    axes.margins(y=0.05)
    until = "; until the blade rests" if count < result.displacement_mm.size else "; below zero: released"
    axes.set_title(f"mean over {window_mm:.2g} mm of travel{until}", loc="left", fontsize=7.5, color=GREY)


def ledger_shares(
    result: Result, window_mm: float, at: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Smoothed force (N) of each entry of the ledger at travels ``at``, in its order; those that are small
    throughout apart."""
    travel, shares = result.displacement_mm[: forward(result.displacement_mm)], {}
    for name in result.ledger:
        work = result.curve.get(f"work_{name}_mJ")
        if work is None:
            # An entry's force is that of the step which ends there: work adds up over steps.
            steps = result.curve[f"force_{name}_N"][1 : travel.size]
            work = np.concatenate([[0.0], np.cumsum(np.diff(travel) * steps)])
        share = smooth_force(travel, np.asarray(work, dtype=float)[: travel.size], window_mm, at)
        if np.any(share):
            shares[name] = share
    least = NEGLIGIBLE * float(np.max(np.abs(result.force_N)))
    small = {name: share for name, share in shares.items() if np.max(np.abs(share)) < least}
    return {name: share for name, share in shares.items() if name not in small}, small


#: Colour and pattern (plotly's) of entries that no mechanism stands for; "": what is left.
LOOKS = {SNAP: ("grey", "/"), TRANSFER: ("grey", "."), SELF_CONTACT: ("grey", "x"), "": ("light", "")}
#: Of mechanisms by role: laws of one role replace each other, and look the same.
ROLES = {
    "isochoric": ("blue", ""),
    "volumetric": ("vermilion", "/"),
    "viscoelastic": ("vermilion", "x"),
    "softening": ("blue", "x"),
    "cohesive": ("green", "."),
    "rate": ("green", "x"),
    "viscous": ("orange", "\\"),
    "contact": ("sky", "x"),
    "adhesion": ("purple", "-"),
    "friction": ("yellow", "/"),
    "gradient": ("blue", "+"),
    "bond": ("orange", "."),
}


def look_of(name: str) -> tuple[str, str]:
    """Colour and pattern (plotly's) of an entry of the ledger, the same in all pictures; ``""``: what is
    left. Laws without a role of the table, a user's too, have one of each by a digest of the name."""
    colours, patterns = ("orange", "purple", "sky", "green", "vermilion"), "|+-x/"
    digest, law = zlib.crc32(name.encode()), registry().get(name)
    own = colours[digest % len(colours)], patterns[digest // len(colours) % len(patterns)]
    colour, pattern = LOOKS.get(name) or ROLES.get((law.role if law else None) or "", own)
    return (COLOURS | {"grey": "#9A9A9A", "light": "#D9D9D9"})[colour], pattern


def _look(name: str) -> Look:
    colour, pattern = look_of(name)
    return {"facecolor": colour, "hatch": pattern * 4, "edgecolor": "white", "lw": 0.0}


def title_of(name: str) -> str:
    """How pictures and pages call an entry of the ledger."""
    if name in NO_MECHANISM:
        return NO_MECHANISM[name]
    mechanism = registry().get(name)
    return mechanism.title if mechanism else name.replace("_", " ")
