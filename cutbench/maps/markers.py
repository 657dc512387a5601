"""What pictures of a map mark: materials, each at its place and filled with the drop of its own run, and
points that were run in three dimensions, as ``confirm.json`` records them."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import Look
from cutbench.base.greek import plain_formula, set_subscripts
from cutbench.maps.dataset import LABELS, axes_of
from cutbench.maps.plot_coordinates import DROP_COLOURS, edges, is_log, nearest_level

_HALO = [patheffects.withStroke(linewidth=2.2, foreground="white")]
_MATERIAL: Look = {"marker": "D", "mfc": "white", "mec": "#D55E00", "ms": 7.0, "mew": 1.5, "ls": ""}


@dataclass(frozen=True)
class OwnRun:
    """What a marked material's own run says: its drop (nan before there is one), label, and in what it
    differs from the map's at its place."""

    drop_rel: float
    label: str
    differs: str

    @property
    def done(self) -> bool:
        return math.isfinite(self.drop_rel)


def own_of(data: xr.Dataset, name: str) -> OwnRun | None:
    """The own run of a marked material; None in a map that has none of it."""
    if "mark" not in data.coords or name not in data["mark"].values:
        return None
    at = data.sel(mark=name)
    differs = plain_formula(str(at["mark_differs"].values))
    return OwnRun(float(at["mark_drop_rel"]), LABELS[int(at["mark_label"])], differs)


def _within(data: xr.Dataset, at: Mapping[str, float], x: str, y: str) -> bool:
    """Whether a place lies on the cells of the drawn axes."""
    ends = {name: edges(data[name].values, is_log(data[name])) for name in (x, y) if name}
    return all(e[0] <= at[name] <= e[-1] for name, e in ends.items())


def marks_of(data: xr.Dataset, x: str, y: str, panel: str) -> tuple[list[dict], list[str]]:
    """The materials of the study, each on the panel of the nearest level; and those outside the axes."""
    inside: list[dict] = []
    outside: list[str] = []
    for mark in json.loads(data.attrs["marks"]):
        if not _within(data, mark, x, y):
            outside.append(mark["name"])
            continue
        level, text = 0, ""
        if panel:
            values = data[panel].values
            level = nearest_level(mark[panel], values)
            if abs(mark[panel] - values[level]) > 0.02 * max(abs(mark[panel]), abs(values[level])):
                text = f" ({mark[panel]:.2g})"
        text = mark["name"] + text
        own = own_of(data, mark["name"])
        drop = own.drop_rel if own and own.done else -1.0
        for other in inside:
            # Where a picture lacks the axis that parts two materials, they share a mark; of two drops it
            # has none, but where drops are what is up they are apart.
            same = other["panel"] == level and all(
                math.isclose(other[n], mark[n], rel_tol=0.02) for n in (x, y) if n
            )
            alike = abs(other["drop"] - drop) < 0.005
            if same and (y or alike):
                other["text"] += f", {text}"
                other["own"] = other["own"] if alike else None
                break
        else:
            inside.append(mark | {"panel": level, "text": text, "own": own, "drop": drop})
    return inside, outside


def _height(mark: Mapping, y: str, part: xr.Dataset) -> float:
    """How high a diamond stands: on the axis ``y``, or by the drop of its own run."""
    own = mark["own"]
    return mark[y] if y else own.drop_rel if own and own.done else part.attrs["drop_threshold"]


def _filled(own: OwnRun | None, top: float) -> Look:
    """A diamond, filled as the cells are where the material's own run is done."""
    return _MATERIAL | {"mfc": DROP_COLOURS(own.drop_rel / top)} if own and own.done else _MATERIAL


def draw_materials(ax: Axes, marks: Sequence[Mapping], x: str, y: str, part: xr.Dataset, top: float) -> None:
    """Diamonds, filled as the cells are, up to the drop ``top``, where the material's own run is done."""
    for mark in marks:
        look = _filled(mark["own"], top)
        ax.plot([mark[x]], [_height(mark, y, part)], zorder=6, clip_on=False, **look)


def label_materials(
    ax: Axes, marks: Sequence[Mapping], x: str, y: str, part: xr.Dataset, text_pt: float
) -> None:
    """Names beside the diamonds, in a figure that is laid out: on no other name, on no line and inside the
    axes, if they can, and away from the rows of markers."""
    taken: list[Bbox] = []
    points = cast("Figure", ax.get_figure(root=True)).dpi / 72
    drawn = [c for c in ax.collections if isinstance(c, ContourSet) and not c.filled]
    lines = [path.transformed(c.get_transform()) for c in drawn for path in c.get_paths()]
    for mark in marks:
        at = mark[x], _height(mark, y, part)
        place = ax.transData.transform(at)
        rows = ax.transData.transform([(at[0], v) for v in part[y].values])[:, 1] if y else np.array([])
        tried: list[tuple[tuple, int, Text, Bbox]] = []
        names = mark["text"], mark["text"].replace("_", "_\n")
        for name, right, up in itertools.product(names, (1, -1, 0), (1, -1)):
            text = ax.annotate(
                name, at, xytext=(5 * right, (4 if right else 7) * up), textcoords="offset points",
                ha=("center", "left", "right")[right], va="bottom" if up > 0 else "top",
                fontsize=text_pt, fontweight="bold", zorder=7, path_effects=_HALO,
            )  # fmt: skip
            text.set_in_layout(False)  # panels stay where they are
            box = text.get_window_extent()
            outside = max(0.0, box.x1 - ax.bbox.x1) + max(0.0, ax.bbox.x0 - box.x0)
            covered = sum(map(box.overlaps, taken)) + sum(line.intersects_bbox(box, False) for line in lines)
            clear = abs(rows - (place[1] + up * 9 * points)).min(initial=9 * points)
            tried.append(((covered, round(outside), "\n" in name, -clear), len(tried), text, box))
        _, _, best, box = min(tried, key=lambda each: each[:2])
        for other in (each[2] for each in tried if each[2] is not best):
            other.remove()
        taken.append(box)


def material_handles(marks: Sequence[Mapping], top: float) -> list[Line2D]:
    """What the legend says of them: what they are, and each whose own run is another than the map's."""
    if not marks:
        return []
    runs = any(mark["own"] for mark in marks)
    handles = [Line2D([], [], label="material, own run" if runs else "material", **_MATERIAL)]
    for mark in marks:
        if (own := mark["own"]) and own.differs:
            said = f": {own.label}" if own.done else ""
            label = f"{mark['name']} ({set_subscripts(own.differs)}){said}"
            handles.append(Line2D([], [], label=label, **_filled(own, top)))
    return handles


#: Name of the record, and of the folder beside a map in which it is looked for.
RECORD, FOLDER = "confirm.json", "confirm"

_CONFIRMED: Look = {"ls": "", "ms": 9.0, "mew": 1.3, "mfc": "none", "zorder": 5, "clip_on": False}
#: What a point in three dimensions says of its label.
CONFIRMED, ANOTHER, NUMERICS, UNFINISHED = "confirmed", "another", "numerics", "unfinished"
_VERDICTS: dict[str, Look] = {
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
    if (verdict := str(point["verdict"])) not in _VERDICTS:
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
        if not _within(part, at, x, y) or (name and nearest_level(at[name], levels.values) != level):
            continue
        look = {key: value for key, value in _VERDICTS[point["verdict"]].items() if key != "label"}
        place = at[y] if y else point["drop_rel"]
        ax.plot([at[x]], [place], **_CONFIRMED, **look, path_effects=_HALO)
        seen.add(point["verdict"])
    return seen


def confirmed_handles(seen: set[str]) -> list[Line2D]:
    """For the legend."""
    look = {key: value for key, value in _CONFIRMED.items() if key not in ("zorder", "clip_on", "ms")}
    return [Line2D([], [], ms=7.5, **look, **_VERDICTS[kind]) for kind in _VERDICTS if kind in seen]
