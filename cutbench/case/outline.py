"""A blade's measured profile: points in mm along it, from a file or as they are."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.mechanisms import Tool, registry

#: Along the outline, x across and y up.
Points = tuple[tuple[float, float], ...]
#: So many at least: a point's direction is read off five.
FEWEST = 5
_COLUMNS = ["x_mm", "y_mm"]


def read_outline(raw: object, folder: Path | None = None) -> Points:
    """From a CSV file with the columns x_mm and y_mm, in ``folder``, or from pairs. Raises BadInput."""
    if not isinstance(raw, str):
        try:
            return tuple((float(x), float(y)) for x, y in raw)  # type: ignore[attr-defined]
        except (TypeError, ValueError):
            expected = "a CSV file with the columns x_mm and y_mm, such as 'blade.csv'"
            raise BadInput("outline", raw, expected) from None
    path = (folder or Path()) / raw
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput("outline", raw, f"a CSV file that can be read ({error})") from error
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].startswith("#")]
    head, *lines = rows or [[]]
    titled = [name.strip() for name in head] == _COLUMNS
    require(titled, "outline", ",".join(head), "x_mm,y_mm in the first line", file=str(path))
    return tuple(_point(row, path) for row in lines)


def _point(row: list[str], path: Path) -> tuple[float, float]:
    try:
        x, y = map(float, row)
    except ValueError:
        expected = "two numbers in mm on each line, such as 0.012,0.34"
        raise BadInput("outline", ",".join(row), expected, file=str(path)) from None
    return x, y


def with_outline(changes: dict, before: Points, tool: Tool | None) -> tuple[Points, dict]:
    """The outline that ``changes`` ask for, or that there was, and the other changes: the blade is as thick
    as measured unless they say otherwise."""
    if "outline" not in changes:
        return before if tool is not None and tool.measured else (), changes
    outline = read_outline(changes["outline"])
    rest = {name: value for name, value in changes.items() if name != "outline"}
    return outline, {"thickness": f"{width(outline)!r} mm", **rest} if outline else rest


def width(outline: Points) -> float:
    """Of the blade, mm; an outline whose lowest point is an end is one flank of two."""
    x, y = np.array(outline).T
    return float(np.ptp(x)) * (2 if int(y.argmin()) in (0, len(y) - 1) else 1)


def checked_outline(outline: Points, tool: Tool | None) -> Points:
    """``outline`` if ``tool`` takes one and a blade can have it. Raises BadInput."""
    value = f"{len(outline)} points"
    if tool is None or not tool.measured:
        takers = [law.name for law in registry().values() if isinstance(law, Tool) and law.measured]
        require(not outline, "outline", value, f"a mechanism that takes it: {', '.join(takers)}")
        return ()
    example = "a CSV file with the blade's profile in [blade], such as outline = 'blade.csv'"
    require(outline, "outline", "(missing)", example)
    points = np.array(outline)
    require(len(points) >= FEWEST, "outline", value, f"{FEWEST} points or more")
    require(np.isfinite(points).all(), "outline", value, "finite numbers")
    apart = np.hypot(*np.diff(points, axis=0).T) > 0
    require(apart.all(), "outline", value, "points that differ from their neighbours")
    x, y = points.T
    low = int(y.argmin())
    flanks = low not in (0, len(y) - 1) or not x.min() < x[low] < x.max()
    require(flanks, "outline", value, "one flank, on one side of its lowest point, or both")
    return outline
