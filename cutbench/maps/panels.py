"""How the panels of a map stand in a figure of each size, and what is written on them."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cutbench.base.figure_style import DOUBLE_MM, Size, new_figure, sized
from cutbench.maps.plot_coordinates import symbol, unit_of


def figure_of(panels: int, size: Size | None) -> tuple[Figure, np.ndarray]:
    """A figure for so many panels of a plane, and their axes (rows, columns)."""
    columns = 2 if panels == 4 else min(3, panels)
    if size is not None and size.height_mm is None:
        columns = 1 if panels < 4 else 2
    rows = math.ceil(panels / columns)
    if size is None:
        figure = new_figure(DOUBLE_MM, (66 if columns > 1 else 84) * rows + 16)
    else:
        figure = sized(size, (62 if columns == 1 else 40) * rows + 34)
    return figure, figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)


def title(ax: Axes, data: xr.Dataset, panel: str, level: int, *, lettered: bool, short: bool) -> None:
    """Letter and level of a panel; ``short``: the level's number alone, whose name ``panel_key`` says."""
    letter = chr(ord("a") + level) if lettered else ""
    value = data[panel].values[level] if panel else math.nan
    if panel and (mechanism := data[panel].attrs.get("mechanism")):
        text = f"{'with' if value else 'without'} {mechanism}"
    elif panel:
        name = "" if short and lettered else f"{symbol(data[panel])} = "
        text = f"{name}{value:.3g}{unit_of(data[panel])}"
    else:
        text = ""
    if letter and short:
        ax.set_title(f"{letter}: {text}", loc="left")
        return
    ax.set_title(letter, loc="left", fontweight="bold")
    ax.set_title(text, fontsize=8.5)


def panel_key(data: xr.Dataset, panel: str, count: int) -> list[Line2D]:
    """What the numbers over short panels are, for the legend."""
    if not panel or count == 1 or data[panel].attrs.get("mechanism"):
        return []
    return [Line2D([], [], ls="", label=f"a, b, …: {symbol(data[panel])}")]


def label(figure: Figure, axes: np.ndarray, panels: int, x: str, y: str, note: str, *, short: bool) -> None:
    """What the axes are: on the outer ones, or once where ``short``; a ``note`` below."""
    columns = axes.shape[1]
    for k, ax in enumerate(axes.flat[:panels]):
        if k // columns == len(axes) - 1 or k + columns >= panels:
            ax.tick_params(labelbottom=True)
            if not short:
                ax.set_xlabel(x)
        if k % columns == 0 and not short:
            ax.set_ylabel(y)
    if short:
        figure.supylabel(y)
        figure.supxlabel(f"{x}\n{note}" if note else x)
    elif note:
        figure.supxlabel(note, fontsize=7.5, color="0.3")
