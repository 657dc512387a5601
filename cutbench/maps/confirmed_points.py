"""Points of a map that were run in three dimensions, as ``confirm.json`` records them, in pictures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import Look
from cutbench.maps.dataset import axes_of
from cutbench.maps.plot_coordinates import edges, is_log, nearest_level

#: Name of the record, and of the folder beside a map in which it is looked for.
RECORD, FOLDER = "confirm.json", "confirm"

_HALO = [patheffects.withStroke(linewidth=2.6, foreground="white")]
_LOOK: Look = {"ls": "", "ms": 9.0, "mew": 1.3, "mfc": "none", "zorder": 5, "clip_on": False}
#: What a point in three dimensions says of its label.
CONFIRMED, ANOTHER, NUMERICS, UNFINISHED = "confirmed", "another", "numerics", "unfinished"
_KINDS: dict[str, Look] = {
    CONFIRMED: {"marker": "s", "mec": "black", "label": "3D: confirmed"},
    ANOTHER: {"marker": "X", "mec": "#D55E00", "label": "3D: another"},
    NUMERICS: {"marker": "D", "mec": "0.35", "label": "3D: its numerics cannot tell"},
    UNFINISHED: {"marker": "s", "mec": "0.55", "label": "3D: not to its end"},
}


def read_confirmed(path: Path, data: xr.Dataset) -> list[dict]:
    """The points that ``path`` records for the map ``data``: none without the file, or of another map.

    Raises BadInput for a file that is no such record.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        points: list[dict] = [
            {
                "at": {str(name): float(value) for name, value in point["at"].items()},
                "verdict": _verdict(point),
                "drop_rel": float(point["two"]["drop_rel"] or 0.0),
            }
            for point in record["points"]
        ]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        wanted = "a record that 'cutbench confirm' has written"
        raise BadInput("points", str(error), wanted, file=str(path)) from error
    return [point for point in points if set(point["at"]) == set(axes_of(data))]


def _verdict(point: Mapping) -> str:
    if (verdict := str(point["verdict"])) not in _KINDS:
        raise ValueError(f"verdict '{verdict}'")
    return verdict


def draw_confirmed(
    ax: Axes,
    points: Iterable[Mapping],
    part: xr.Dataset,
    x: str,
    y: str,
    panel: tuple[str, int, xr.DataArray],
) -> set[str]:
    """Mark the ``points`` that lie on this panel: its axis ("" if none), level, and the levels of all.

    Returns the kinds that occur. On a map of one axis, points stand at their force drop in plane strain.
    """
    seen: set[str] = set()
    name, level, levels = panel
    for point in points:
        at = point["at"]
        ranges = {n: edges(part[n].values, is_log(part[n])) for n in (x, y) if n}
        inside = all(e[0] <= at[n] <= e[-1] for n, e in ranges.items())
        if not inside or (name and nearest_level(at[name], levels.values) != level):
            continue
        look = {key: value for key, value in _KINDS[point["verdict"]].items() if key != "label"}
        place = at[y] if y else point["drop_rel"]
        ax.plot([at[x]], [place], **_LOOK, **look, path_effects=_HALO)
        seen.add(point["verdict"])
    return seen


def handles_of(seen: set[str]) -> list[Line2D]:
    """For the legend."""
    look = {key: value for key, value in _LOOK.items() if key not in ("zorder", "clip_on", "ms")}
    return [Line2D([], [], ms=7.5, **look, **_KINDS[kind]) for kind in _KINDS if kind in seen]
