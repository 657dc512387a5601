"""A blade's measured profile: points in mm along it, from a file or as they are."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
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
            raise BadInput(key="outline", value=str(raw)[:60], expected=expected) from None
    path = (folder or Path()) / raw
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        expected = f"a CSV file that can be read ({error})"
        raise BadInput(key="outline", value=raw, expected=expected) from error
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].startswith("#")]
    if not rows or [name.strip() for name in rows[0]] != _COLUMNS:
        head = ",".join(rows[0]) if rows else ""
        raise BadInput(file=str(path), key="outline", value=head, expected="x_mm,y_mm in the first line")
    points = []
    for row in rows[1:]:
        try:
            x, y = (float(number) for number in row)
        except ValueError:
            expected = "two numbers in mm on each line, such as 0.012,0.34"
            raise BadInput(file=str(path), key="outline", value=",".join(row), expected=expected) from None
        points.append((x, y))
    return tuple(points)


def with_outline(changes: dict, before: Points, tool: Tool | None) -> tuple[Points, dict]:
    """The outline that ``changes`` ask for, or that there was, and the other changes: the blade is as thick
    as measured unless they say otherwise."""
    if "outline" not in changes:
        return before if tool is not None and tool.measured else (), changes
    found = read_outline(changes["outline"])
    rest = {name: value for name, value in changes.items() if name != "outline"}
    return found, {"thickness": f"{width(found)!r} mm", **rest} if found else rest


def width(outline: Points) -> float:
    """Of the blade, mm; an outline whose lowest point is an end is one flank of two."""
    x, y = np.array(outline).T
    return float(np.ptp(x)) * (2 if int(y.argmin()) in (0, len(y) - 1) else 1)


def checked_outline(outline: Points, tool: Tool | None) -> Points:
    """``outline`` if ``tool`` takes one and a blade can have it. Raises BadInput."""
    if tool is None or not tool.measured:
        if outline:
            takers = [law.name for law in registry().values() if isinstance(law, Tool) and law.measured]
            expected = f"a mechanism that takes it: {', '.join(takers)}"
            raise BadInput(key="outline", value=f"{len(outline)} points", expected=expected)
        return ()
    if not outline:
        expected = "a CSV file with the blade's profile in [blade], such as outline = 'blade.csv'"
        raise BadInput(key="outline", value="(missing)", expected=expected)
    points = np.array(outline)
    wrong = ""
    if len(points) < FEWEST:
        wrong = f"{FEWEST} points or more"
    elif not np.isfinite(points).all():
        wrong = "finite numbers"
    elif not (np.hypot(*np.diff(points, axis=0).T) > 0).all():
        wrong = "points that differ from their neighbours"
    else:
        x, y = points.T
        low = int(y.argmin())
        if low in (0, len(y) - 1) and x.min() < x[low] < x.max():
            wrong = "one flank, on one side of its lowest point, or both"
    if wrong:
        raise BadInput(key="outline", value=f"{len(points)} points", expected=wrong)
    return outline
