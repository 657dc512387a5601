"""One line for all panels: the front's own speed against what the limit point frees.

Over the viscosities of a map the front's speed follows S = 1 + V*/V, with V = η v/δ_c: to the blade's speed
it adds one of its own, which does not know the blade. So V* = (S − 1) V is a number of the material under its
blade, and V = V* the line on which the front's own speed is the blade's, S = 2, whatever else a map varies.
Here V* is held against the energy that the limit point at rest frees, per area cut and over the toughness:
log V* is fitted as a straight line in its logarithm, and what is left is the scatter of the collapse.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import COLOURS, DOUBLE_MM, Look, new_figure, save, style
from cutbench.case.model import groups
from cutbench.maps.dataset import physics_by_place, places_of
from cutbench.maps.plot_coordinates import plain_log, symbol, unit_of
from cutbench.maps.regimes import HELD, KIND, KIND_WORDS, KINDS, SNAP, SNAP_SPEED, STABLE, VISCOSITY

#: Speeds of the front from which its own is read: nearer to 1 it is a difference of nearly equal numbers, and
#: above, the length of the jump limits it.
FRONT_SPEED_RANGE = (1.15, 10.0)
#: So many such runs make a line.
MIN_RUNS = 6


@dataclass(frozen=True)
class Collapse:
    """Runs (n,) of a map: V, S, what is freed at rest over the toughness, kind, level of the panels' axis.

    V* = ``factor`` freed^``power``, to a factor of ``scatter`` (rms), from ``fitted`` runs; nan where there
    are fewer than ``MIN_RUNS``.
    """

    viscosity: np.ndarray
    front_speed: np.ndarray
    freed: np.ndarray
    kind: np.ndarray
    level: np.ndarray
    factor: float
    power: float
    scatter: float
    fitted: int

    def line(self, freed: np.ndarray) -> np.ndarray:
        """V* by what is freed."""
        return self.factor * np.asarray(freed) ** self.power

    def text(self) -> str:
        """The line in one sentence; empty without one."""
        if not self.fitted:
            return ""
        return (
            f"The front's own speed, as a viscous number, is {self.factor:.2g} (freed/G_c)^{self.power:.2g}"
            f" to a factor of {self.scatter:.3g} (rms of {self.fitted} runs)."
        )


def collapse_of(data: xr.Dataset) -> Collapse:
    """The runs of a map with runs at rest. Raises BadInput if it has none, or its model has no viscosity."""
    if KIND not in data:
        raise BadInput("map", data.attrs["title"], "a map of a study with rest = true in [regime]")
    places, physics = places_of(data), physics_by_place(data)
    panel = data.attrs["plot_panel"]
    group = groups()[VISCOSITY]
    rows = []
    done = np.isfinite(data["front_speed"].values) & (data["rest_freed_rel"].values > 0)
    for here in map(tuple, np.argwhere(done)):
        values = {name: float(along[here]) for name, along in places.items()}
        case = physics(values)
        if VISCOSITY in case.model.settable_groups() and (viscosity := group.value(case.p)) > 0:
            measured = (data[name].values[here] for name in ("front_speed", "rest_freed_rel", KIND))
            rows.append((viscosity, *measured, values.get(panel, 0.0)))
    V, S, freed, kind, level = np.array(rows, dtype=float).reshape(-1, 5).T
    ok = (FRONT_SPEED_RANGE[0] < S) & (FRONT_SPEED_RANGE[1] > S)
    factor, power, scatter, fitted = math.nan, math.nan, math.nan, 0
    if ok.sum() >= MIN_RUNS and np.ptp(freed[ok]) > 0:
        fitted = int(ok.sum())
        x, y = np.log(freed[ok]), np.log((S[ok] - 1) * V[ok])
        power, shift = np.polyfit(x, y, 1)
        factor, scatter = math.exp(shift), math.exp(np.sqrt(np.mean((y - shift - power * x) ** 2)))
    names = np.array(KINDS)[kind.astype(int)]
    return Collapse(V, S, freed, names, level, factor, float(power), scatter, fitted)


def draw_collapse(data: xr.Dataset, collapse: Collapse) -> Figure:
    """Kinds over what is freed and viscosity, with the line; and the speed of the front against V/V*."""
    panel = data.attrs["plot_panel"]
    levels = np.unique(collapse.level)
    with style():
        figure = new_figure(DOUBLE_MM, 88)
        left, right = figure.subplots(1, 2)
        ratio = collapse.viscosity / collapse.line(collapse.freed)
        ends = np.array([collapse.freed.min() / 1.3, collapse.freed.max() * 1.3])
        line_look: Look = {"color": "black", "lw": 1.2, "ls": "-"}
        shapes = itertools.cycle(zip("os^Dv<>p", itertools.cycle(("blue", "vermilion", "green", "orange"))))
        handles = [
            Line2D([], [], label=KIND_WORDS[name], **look)
            for name, look in _looks("o", "black").items()
            if (collapse.kind == name).any()
        ]
        for level, (marker, colour) in zip(levels, shapes, strict=False):
            looks = _looks(marker, COLOURS[colour])
            for name, look in looks.items():
                at = (collapse.level == level) & (collapse.kind == name)
                left.plot(collapse.freed[at], collapse.viscosity[at], **look)
                right.plot(ratio[at], collapse.front_speed[at], **look)
            if panel:
                text = f"{symbol(data[panel])} = {level:.3g}{unit_of(data[panel])}"
                handles.append(Line2D([], [], label=text, **looks[SNAP]))
        if collapse.fitted:
            line, band = collapse.line(ends), {"color": "0.88", "zorder": 0}
            left.plot(ends, line, **line_look)
            left.fill_between(ends, line / collapse.scatter, line * collapse.scatter, **band)
            x = np.geomspace(ratio.min() / 1.3, ratio.max() * 1.3, 100)
            right.plot(x, 1 + 1 / x, **line_look)
            right.fill_between(x, 1 + 1 / x / collapse.scatter, 1 + collapse.scatter / x, **band)
            plain_log(right, "x", x[0], x[-1])
            law = f"$V^* = {collapse.factor:.2g}\\,x^{{{collapse.power:.2g}}}$"
            text = f"{law} to a factor of {collapse.scatter:.3g} (rms)"
            handles.append(Line2D([], [], label=text, **line_look))
        right.axhline(SNAP_SPEED, color="0.4", lw=0.8, ls=":")
        plain_log(left, "x", *ends)
        plain_log(left, "y", collapse.viscosity.min() / 1.4, collapse.viscosity.max() * 1.4)
        plain_log(right, "y", collapse.front_speed.min() / 1.2, collapse.front_speed.max() * 1.3)
        left.set_xlabel("energy that the limit point at rest frees / $G_c$")
        left.set_ylabel(r"$V = \eta v/\delta_c$")
        right.set_xlabel("$V/V^*$")
        right.set_ylabel("front speed / blade speed  $S$")
        figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _looks(marker: str, colour: str) -> dict[str, Look]:
    whole: Look = {"ls": "", "marker": marker, "ms": 4.2, "mew": 0.8, "mec": colour}
    return {SNAP: whole | {"mfc": colour}, HELD: whole | {"mfc": "white"}, STABLE: whole | {"marker": "x"}}


def save_collapse(data: xr.Dataset, folder: str | Path) -> tuple[list[Path], str]:
    """Write ``regimes.png`` into ``folder``; its paths and the line in words. Nothing of maps without runs at
    rest that have ended."""
    if KIND not in data or not (collapse := collapse_of(data)).viscosity.size:
        return [], ""
    return save(draw_collapse(data, collapse), Path(folder) / "regimes.png", also=("svg",)), collapse.text()
