"""Measured and computed displacement and strain fields side by side, with their difference."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from cutbench.base.figure_style import DOUBLE_MM, FIELD_MAP, new_figure, style
from cutbench.data.field_comparison import Comparison

#: Colours of a field end at these percentiles: single points at the blade would flatten the rest.
_RANGE = (1, 99)
#: Map of signed differences, white at zero, safe for the colour-blind.
_SIGNED = "PuOr"


def plot_dic(comparison: Comparison, title: str = "") -> Figure:
    """A row for each of u_x, u_y (mm, relative error) and E_xx, E_yy, E_xy (difference), drawn where the
    material is after the measured deformation. White: outside, or not measured."""
    measured, computed = comparison.measured, comparison.computed
    strains = (measured.strain, computed.strain)
    rows = [(f"$u_{c}$ (mm)", measured.u[i], computed.u[i], comparison.relative_error[i], "relative error")
            for i, c in enumerate("xy")]  # fmt: skip
    rows += [
        (f"$E_{{{name}}}$", strains[0][i, j], strains[1][i, j], comparison.strain_error[i, j], "difference")
        for (i, j), name in (((0, 0), "xx"), ((1, 1), "yy"), ((0, 1), "xy"))
    ]
    at = measured.deformed
    x, y = (at[i][np.isfinite(at[i])] for i in (0, 1))
    part = float(np.clip(np.ptp(y) / np.ptp(x), 0.3, 1.4))
    with style():
        figure = new_figure(DOUBLE_MM, 14 + 5 * (9 + 42 * part))
        grid = figure.subplots(5, 3)
        for line, (name, left, right, off, what) in zip(grid, rows, strict=True):
            low, high = _limits(np.concatenate([left.ravel(), right.ravel()]))
            for axes, values, head in zip(line, (left, right), ("measured", "computed"), strict=False):
                drawn = _field(axes, at, values, FIELD_MAP, low, high)
                axes.set_title(f"{name}, {head}", loc="left", fontsize=8)
            _bar(figure, drawn, line[1], "both")
            low, high = _limits(off.ravel())
            signed = what == "difference"
            most = max(abs(low), abs(high)) if signed else max(high, 1e-12)
            drawn = _field(line[2], at, off, _SIGNED if signed else "Greys", -most if signed else 0, most)
            _bar(figure, drawn, line[2], "both" if signed else "max")
            line[2].set_title(f"{name.split(' ')[0]}, {what}", loc="left", fontsize=8)
            line[0].set_ylabel("y (mm)")
            for axes in line:
                axes.set(xlim=(x.min(), x.max()), ylim=(y.min(), y.max()), aspect="equal")
        for axes in grid[-1]:
            axes.set_xlabel("x (mm)")
        travel = "" if np.isnan(measured.travel_mm) else f"blade travel {measured.travel_mm:g} mm"
        figure.suptitle(", ".join(filter(None, (title, travel))), x=0.02, ha="left")
    return figure


def _limits(values: np.ndarray) -> tuple[float, float]:
    """The range of colours; one that is not empty."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return 0.0, 1.0
    low, high = np.percentile(known, _RANGE)
    return (float(low), float(high)) if high > low else (float(low), float(low) + 1e-12)


def _field(axes, at: np.ndarray, values: np.ndarray, colours: str, low: float, high: float) -> PolyCollection:
    """Cells between four points (positions ``at`` (2, ny, nx)) that all have a value, in their mean."""
    corners = [(slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None)),
               (slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1))]  # fmt: skip
    cells = np.stack([np.stack([at[0][c], at[1][c]], axis=-1) for c in corners], axis=2)
    mean = np.mean([values[c] for c in corners], axis=0)
    known = np.isfinite(mean) & np.isfinite(cells).all(axis=(2, 3))
    drawn = PolyCollection(
        cells[known], array=mean[known], cmap=colours, clim=(low, high), edgecolors="face", linewidths=0.1,
        rasterized=True,
    )  # fmt: skip
    axes.add_collection(drawn)
    return drawn


def _bar(figure: Figure, drawn: PolyCollection, axes, extend: str) -> None:
    bar = figure.colorbar(drawn, ax=axes, extend=extend, aspect=18, pad=0.02)
    bar.outline.set_linewidth(0.5)
    bar.ax.tick_params(labelsize=7)
