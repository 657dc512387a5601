"""Pictures of the page: specimen and blade in SVG, force curves for plotly and for files."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutbench.base.figure_style import (
    COLOURS,
    LINE_COLOURS,
    LINES,
    SINGLE_MM,
    Look,
    force_from_zero,
    new_figure,
    style,
)
from cutbench.base.files import csv_text
from cutbench.case.case import Case
from cutbench.emulator.atlas import Estimate
from cutbench.run.blade_geometry import blade_outline

#: Of the drawing of the specimen, in pixels.
_WIDTH, _HEIGHT, _MARGIN = 420, 250, 46
#: Line styles of plotly, beside those of figures.
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")


@dataclass(frozen=True)
class Curve:
    """A force curve under its name, with the ends of a band or without (each an array of the same length)."""

    name: str
    mm: np.ndarray
    N: np.ndarray
    band: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def of_estimate(cls, found: Estimate) -> Curve:
        name = f"{found.case.name}, estimate with 90 % band"
        return cls(name, found.x_mm, found.force_N, (found.low_N, found.high_N))


def specimen_svg(case: Case) -> str:
    """Specimen and blade to scale, the blade where it first touches, with their sizes and the travel."""
    p = case.p
    above = max(0.45 * p.height, 2.5 * p.thickness)
    scale = min((_WIDTH - 2 * _MARGIN) / p.width, (_HEIGHT - 40) / (p.height + above))
    middle, floor = _WIDTH / 2, _HEIGHT - 26

    def place(points: np.ndarray) -> str:
        return " ".join(f"{middle + scale * x:.1f},{floor - scale * y:.1f}" for x, y in points)

    blade = place(blade_outline(case, 0.0, p.height + above))
    left, right = middle - scale * p.width / 2, middle + scale * p.width / 2
    top, end = floor - scale * p.height, floor - scale * (p.height - p.depth)
    half = scale * p.thickness / 2
    said = f"Specimen {p.width:g} mm wide, {p.height:g} mm high; blade {p.thickness:g} mm thick"
    precut = f'<path d="M{middle},{top}V{top + scale * p.precut}" class="cut"/>' if p.precut > 0 else ""
    return f"""<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{said}" class="specimen">
<path d="M{left:.1f},{top:.1f}H{right:.1f}V{floor:.1f}H{left:.1f}z" class="block"/>{precut}
<path d="M{left - 8:.1f},{floor:.1f}H{right + 8:.1f}" class="table"/>
<path d="M{middle:.1f},{top:.1f}V{end:.1f}m-5,-8l5,8l5,-8" class="way"/>
<polygon points="{blade}" class="blade"/>
<text x="{middle:.1f}" y="{_HEIGHT - 8}" text-anchor="middle">{p.width:g} mm</text>
<text x="{right + 6:.1f}" y="{(top + floor) / 2:.1f}">{p.height:g} mm</text>
<text x="{middle + 9:.1f}" y="{max(end - 4, top + 16):.1f}">{p.depth:g} mm deep</text>
<text x="{middle + half + 10:.1f}" y="20">{p.thickness:g} mm</text>
</svg>"""


def force_figure(curves: Sequence[Curve]) -> dict:
    """Curves in one plot, as plotly takes it; the page's style sheet gives text and grid their colours."""
    data: list[dict] = []
    for number, curve in enumerate(curves):
        colour, dash = LINE_COLOURS[1:][number % 6], _DASHES[number % len(_DASHES)]
        look = {"mode": "lines", "x": curve.mm.tolist(), "hoverlabel": {"namelength": -1}}
        if curve.band is not None:
            edge = look | {"line": {"width": 0}, "showlegend": False, "hoverinfo": "skip"}
            low, high = ({"y": end.tolist()} for end in curve.band)
            data += [edge | low, edge | high | {"fill": "tonexty", "fillcolor": f"{colour}40"}]
        line = {"color": colour, "dash": dash, "width": 2.5}
        data.append(look | {"y": curve.N.tolist(), "name": curve.name, "line": line})
    axis = {"rangemode": "tozero", "zeroline": False, "ticks": "outside", "automargin": True}
    layout = {
        "xaxis": axis | {"title": {"text": "blade travel (mm)"}},
        "yaxis": axis | {"title": {"text": "force (N)"}},
        "margin": {"l": 10, "r": 10, "t": 10, "b": 10},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "showlegend": True,
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "uirevision": "kept",
    }
    return {"data": data, "layout": layout, "config": {"displayModeBar": False}}


def curves_png(curves: Sequence[Curve]) -> bytes:
    """The same as a PNG for print."""
    with style():
        figure = new_figure(SINGLE_MM * 1.5, 80)
        axes = figure.subplots()
        for number, curve in enumerate(curves):
            look: Look = {"color": LINE_COLOURS[1:][number % 6], "ls": LINES[number % len(LINES)]}
            if curve.band is not None:
                axes.fill_between(curve.mm, *curve.band, color=COLOURS["sky"], alpha=0.4, lw=0)
            axes.plot(curve.mm, curve.N, label=curve.name, **look)
        force_from_zero(axes, "blade travel (mm)")
        figure.legend(loc="outside lower center", ncols=1)
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=300)
    return file.getvalue()


def curves_csv(curves: Sequence[Curve]) -> str:
    """The same as a table, a row each point; the ends of a band are empty where there is none."""
    rows = [
        (curve.name, *("" if np.isnan(v) else f"{v:.6g}" for v in row))
        for curve in curves
        for row in np.broadcast(curve.mm, curve.N, *(curve.band or (np.nan, np.nan)))
    ]
    return csv_text(("curve", "displacement_mm", "force_N", "low_N", "high_N"), rows)
