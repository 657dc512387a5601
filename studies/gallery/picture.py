"""Pictures of the gallery."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, new_figure, save, style
from cutbench.run.result import Result
from studies.gallery.experiments import (
    COULOMB,
    ENTERING,
    EXPERIMENTS,
    PROPORTIONAL,
    SATURATING,
    WIRES,
    WIRES_MM,
)
from studies.gallery.runs import measured_onset, onset, steady

ORDER = tuple(COLOURS[name] for name in ("black", "blue", "vermilion", "green", "orange", "purple"))


def wires(axes: Axes, found: Mapping[object, Result]) -> None:
    """F/(b G_c) over the diameter, without friction and with several."""
    lines = ("no friction", "black", "μ = 0"), ("saturates", "blue", "μ = 0.3, saturates at G")
    for name, colour, text in lines:
        values = [steady(found[name, d]) for d in WIRES_MM]
        axes.plot(WIRES_MM, values, "o-", ms=4, color=COLOURS[colour], label=text)
    for mu, marker in zip(PROPORTIONAL, "vs^", strict=True):
        axes.plot([0.5], [steady(found[mu])], marker, color=COLOURS["vermilion"], ms=4, label=f"μ = {mu:g}")
    axes.set(xlabel="diameter of the wire, d (mm)", ylabel=r"$F/(b\,G_\mathrm{c})$")
    axes.set(xlim=(0, None), ylim=(0, None))
    axes.legend(frameon=False, fontsize=6, loc="lower right", ncols=2)


def entering(axes: Axes, found: Mapping[object, Result], material: str) -> None:
    """Onset over friction, proportional to the pressure and saturating; what is not cut is at the top."""
    top = max(run.case.p.depth for run in found.values() if run.case.name.startswith(material))
    for law, points, colour, marker in (
        ("coulomb", COULOMB[material], "vermilion", "o"),
        ("saturating", (0.0, *SATURATING[material]), "blue", "s"),
    ):
        of = {0.0: "coulomb"}
        values = [onset(found[material, of.get(mu, law), mu]) for mu in points]
        cut = [(mu, y) for mu, y in zip(points, values, strict=True) if not math.isnan(y)]
        text = "proportional to the pressure" if law == "coulomb" else "saturates at the pressure G"
        axes.plot(*np.array(cut).T, marker=marker, ms=4, color=COLOURS[colour], label=text)
        held = [mu for mu, y in zip(points, values, strict=True) if math.isnan(y)]
        axes.plot(held, [top] * len(held), "^", mfc="white", color=COLOURS[colour], ms=5)
    if material != "meat":  # of which a plateau is published
        value, error = measured_onset(material)
        axes.axhspan(value - error, value + error, color=COLOURS["orange"], alpha=0.3, lw=0, label="measured")
    axes.set(title=material, xlabel="friction coefficient μ", ylim=(0, top * 1.08))


def sharpness(result: Result) -> float:
    """r E/G_c, with the modulus of all that is stiff at first."""
    p = result.case.p
    E = 2 * (1 + p.nu) * p.G * (1 + getattr(p, "g_Y", 0.0))
    return float(getattr(p, "edge_radius", p.thickness / 2) * E / p.G_c)


def all_of_them(axes: Axes, found: Mapping[str, Mapping[object, Result]]) -> None:
    """F/(b G_c) over r E/G_c of what ends in steady cutting, an experiment a symbol."""
    for k, (title, results) in enumerate(found.items()):
        points = [(sharpness(r), steady(r)) for r in results.values()]
        axes.loglog(*np.array(points).T, "osD^v<>p"[k], ms=4, color=ORDER[k % len(ORDER)], label=title)
    axes.axhline(1, color=GREY, lw=0.8, zorder=0)
    axes.set(xlabel=r"$r\,E/G_\mathrm{c}$", ylabel=r"$F/(b\,G_\mathrm{c})$ in steady cutting", ylim=(0.8, 6))
    plain(axes)


def onsets(axes: Axes, found: Mapping[str, Mapping[object, Result]]) -> None:
    """Onset E/G_c over r E/G_c of blades that enter a whole block."""
    for k, (title, results) in enumerate(found.items()):
        cut = [r for r in results.values() if not math.isnan(onset(r))]
        points = [(sharpness(r), onset(r) * sharpness(r) / r.case.p.edge_radius) for r in cut]
        axes.loglog(*np.array(points).T, "^v"[k], ms=4, color=ORDER[4 + k], label=title)
    axes.set(xlabel=r"$r\,E/G_\mathrm{c}$", ylabel=r"onset $\times\,E/G_\mathrm{c}$", ylim=(4, 90))
    plain(axes)


def plain(axes: Axes) -> None:
    """A legend above the points, and numbers that can be read."""
    axes.legend(frameon=False, fontsize=6, loc="upper left")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def pictures(results: Mapping[str, Result], out: Path) -> None:
    """friction.png, wires.png and experiments.png."""
    by = {e.title: {name: results[run.case.id] for name, run in e.runs.items()} for e in EXPERIMENTS}
    entered = {name: results[run.case.id] for name, run in ENTERING.items()}
    with style():
        figure = new_figure(DOUBLE_MM, 65)
        panels = figure.subplots(1, 3)
        for panel, material in zip(panels, COULOMB, strict=True):
            entering(panel, entered, material)
        panels[0].set_ylabel("travel at which the cut begins (mm)")
        panels[1].legend(frameon=False, fontsize=6)
        save(figure, out / "friction.png")
        figure = new_figure(DOUBLE_MM / 2, 65)
        wires(figure.subplots(), {name: results[run.case.id] for name, run in WIRES.items()})
        save(figure, out / "wires.png")
        figure = new_figure(DOUBLE_MM, 80)
        left, right = figure.subplots(1, 2)
        whole = [e.title for e in EXPERIMENTS if not all(run.case.p.precut for run in e.runs.values())]
        all_of_them(left, {title: of for title, of in by.items() if title not in whole})
        onsets(right, {title: by[title] for title in whole})
        save(figure, out / "experiments.png")
