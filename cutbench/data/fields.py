"""Measured displacement fields: what they are, their files, and the section ``fields`` of a campaign file."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from cutbench.base.errors import BadInput, require
from cutbench.base.sections import Entry, read_section
from cutbench.base.toml import among
from cutbench.data.columns import matching_titles
from cutbench.data.table import read_table

CONFIGURATIONS = ("deformed", "reference")
#: Points of one row or column of the grid may be off by this part of the spacing.
_OFF = 0.1
#: A grid has at least this part of its places filled; scattered points have next to none.
_FILLED = 0.2
_SECTION = (
    Entry("data", str, "a file beside the campaign, such as 'dic.csv'", needed=True),
    Entry(
        "noise", float, "what a displacement is known to, such as '0.01 mm'", needed=True, unit="mm", low=0
    ),
    Entry("configuration", choices=CONFIGURATIONS),
    Entry("columns", dict, "a table, such as columns = { … }"),
    Entry("units", dict, "a table, such as units = { … }"),
    Entry(
        "shift", float, "two lengths, such as ['-15 mm', '0 mm']", default=(0.0, 0.0), unit="mm", count=(2, 2)
    ),
    Entry("y_down", bool, "true or false", default=False),
    Entry("travel", float, default=math.nan, unit="mm"),
    Entry("valid", str, "what holds of points that were measured, as in 'sigma >= 0'"),
)
#: Columns in which correlation programs say whether a point was found, and what they have where it was: VIC
#: and DICe write -1 where not, others 0 or nothing.
VALID = {
    "sigma": (">=", 0.0),
    **dict.fromkeys(("valid", "isvalid", "is valid", "correlation", "correlation coefficient"), (">", 0.0)),
    **dict.fromkeys(("correlation value", "corr", "corrcoef", "zncc", "ncc"), (">", 0.0)),
}
_SIGNS = {">=": np.greater_equal, "<=": np.less_equal, ">": np.greater, "<": np.less, "!=": np.not_equal}
_RULE = re.compile(r"\s*(\S.*?)\s*(>=|<=|!=|>|<)\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*")
#: A point that has not moved at all, exactly, was not measured where the plane through so many around it says
#: that it moved by more than half of what they did, and they by more than this part of the largest: at a
#: clamp displacements go to 0, and do not fall to it.
NEAREST, STILL = 8, 0.05
#: Displacements above this part of the spacing show in positions after deformation.
DISPLACED = 0.02
#: Points of a field that a fit compares, at the most: neighbours say much the same.
POINTS = 150


@dataclass(frozen=True, eq=False)
class Field:
    """A field holds displacements on a grid of points of a specimen, at one blade travel.

    x is across the blade with 0 in its middle plane, y up with 0 at the base.

    Attributes
    ----------
    x : ndarray, shape (nx,), mm
        Columns of the grid.
    y : ndarray, shape (ny,), mm
        Rows of the grid.
    u : ndarray, shape (2, ny, nx), mm
        Displacements across and up; nan where unknown.
    travel_mm : float, mm
        Blade travel; nan where it is not known.
    configuration : str
        What the points are positions in: ``deformed`` (after deformation) or ``reference`` (before).
    notes : tuple of str
        What was left out.
    doubt : str
        What may well be otherwise, and what settles it.

    Raises
    ------
    BadInput
        For another configuration, or arrays that do not fit together.
    """

    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    travel_mm: float = math.nan
    configuration: str = "deformed"
    notes: tuple[str, ...] = ()
    doubt: str = ""

    def __post_init__(self) -> None:
        among("configuration", self.configuration, CONFIGURATIONS)
        shape = (2, self.y.size, self.x.size)
        require(self.u.shape == shape, "u", str(self.u.shape), str(shape))

    @property
    def grid(self) -> np.ndarray:
        """Positions (2, ny, nx) in mm, in the field's configuration."""
        return np.stack(np.meshgrid(self.x, self.y))

    @property
    def deformed(self) -> np.ndarray:
        """Positions (2, ny, nx) after deformation, mm."""
        return self.grid if self.configuration == "deformed" else self.grid + self.u

    @property
    def strain(self) -> np.ndarray:
        """Green–Lagrange strain (2, 2, ny, nx), from central differences on the grid."""
        gradient = np.stack(
            [np.stack([np.gradient(c, self.x, axis=1), np.gradient(c, self.y, axis=0)]) for c in self.u]
        )
        unit = np.eye(2)[:, :, None, None]
        if self.configuration == "reference":
            F = unit + gradient
        else:
            (a, b), (c, d) = unit - gradient
            F = np.stack([np.stack([d, -b]), np.stack([-c, a])]) / (a * d - b * c)
        return (np.einsum("kiyx,kjyx->ijyx", F, F) - unit) / 2


def read_fields(
    path: str | Path,
    *,
    columns: Mapping[str, str | int] | None = None,
    units: Mapping[str, str] | None = None,
    configuration: str | None = None,
    shift_mm: tuple[float, float] = (0.0, 0.0),
    y_down: bool = False,
    travel_mm: float = math.nan,
    valid: str | None = None,
) -> list[Field]:
    """Read displacement fields from a text file with a row a point. Raises BadInput."""
    path = Path(path)
    asked = _asked(columns)
    more = matching_titles(path, asked, ["travel", *VALID])
    if columns is None and "travel" in more:
        asked["travel"] = more.pop("travel")
    rule = _rule(more, valid)
    if rule is not None:
        asked["valid"] = rule[0]
    units = {role: unit for role, unit in (units or {}).items() if role in asked}
    table = read_table(path, asked, units, tuple(asked))
    data, notes, lost = dict(table.columns), list(table.notes), np.zeros(table.lines.size, dtype=bool)
    if rule is not None:
        with np.errstate(invalid="ignore"):
            lost = ~_SIGNS[rule[1]](data["valid"], rule[2])
        notes += _left_out(path, table.lines[lost], f"{rule[0]} is not {rule[1]} {rule[2]:g}")
    for role in ("x", "y", "travel"):
        if role in data:
            blank = ~np.isfinite(data[role]) & ~lost
            line, expected = table.lines[np.argmax(blank)], f"the {role} of every point; the cell is empty"
            require(not blank.any(), role, "", expected, file=str(path), line=int(line))
    if y_down:
        data |= {"y": -data["y"], "u_y": -data["u_y"]}
    travels = data["travel"] if "travel" in data else np.full(table.lines.size, travel_mm)
    placed = ~lost & np.isfinite(data["x"]) & np.isfinite(data["y"])
    expected = "points that were found; 'none' takes all for found"
    require(placed.any(), "valid", str(valid or rule), expected, file=str(path))
    fields = []
    for travel in map(float, np.unique(travels[placed])):
        here = placed & (np.isnan(travels) if np.isnan(travel) else travels == travel)
        points = np.stack([data["x"][here] + shift_mm[0], data["y"][here] + shift_mm[1]])
        u = np.stack([data["u_x"][here], data["u_y"][here]])
        still = _still(points, u)
        u[:, still] = np.nan
        own = [*notes, *_left_out(path, table.lines[here][still], "both displacements are exactly 0")]
        x, y, field = _gridded(path, points, u, table.lines[here])
        fields.append(Field(x, y, field, travel, configuration or CONFIGURATIONS[0], tuple(own)))
    if configuration is None and (note := _stays(path, fields)):
        fields = [replace(field, doubt=note) for field in fields]
    return fields


def _stays(path: Path, fields: Sequence[Field]) -> str:
    """A note on points that stay where they are although they move; positions before deformation do."""
    for a, b in pairwise(fields):
        one, other = ({(x, y) for x, y in f.grid[:, np.isfinite(f.u[0])].T} for f in (a, b))
        moved = max(float(np.nanmax(np.abs(f.u))) for f in (a, b))
        if len(one & other) > 0.9 * min(len(one), len(other)) and moved > DISPLACED * np.diff(a.x).min():
            return (
                f"{path.name}: the points at {a.travel_mm:g} and {b.travel_mm:g} mm are the same, as"
                " positions before deformation are: configuration = 'reference' (--reference) reads them so,"
                " 'deformed' (--deformed) says that they are not"
            )
    return ""


def _asked(columns: Mapping[str, str | int] | None) -> dict[str, str | int]:
    """Columns by what they are: those that somebody names, or else the names themselves."""
    asked = {{"u": "u_x", "v": "u_y"}.get(role, role): name for role, name in (columns or {}).items()}
    for role in ("x", "y", "u_x", "u_y"):
        named = columns is None or role in asked
        require(named, f"columns.{role}", "(missing)", f"the column of {role}")
        asked.setdefault(role, role)
    return asked


def _rule(titles: Mapping[str, str], valid: str | None) -> tuple[str | int, str, float] | None:
    """Title, sign and number of what holds where a point was measured; None for all."""
    if valid is None:
        return next(((title, *VALID[name]) for name, title in titles.items() if name in VALID), None)
    if valid.strip() == "none":
        return None
    match = _RULE.fullmatch(valid)
    if match is None:
        expected = "a column, a sign and a number, such as 'sigma >= 0', or 'none' for all points"
        raise BadInput("valid", valid, expected)
    return int(match[1]) if match[1].isdigit() else match[1], match[2], float(match[3])


def _still(points: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Which points (n,) have displacements of exactly 0 amid others that moved."""
    still = (u == 0).all(axis=0)
    moved = np.isfinite(u).all(axis=0) & ~still
    if not still.any() or not moved.any():
        return still & False
    _, near = cKDTree(points[:, moved].T).query(
        points[:, still].T, k=[*range(1, min(NEAREST, moved.sum()) + 1)]
    )
    offset = points[:, moved][:, near] - points[:, still][:, :, None]
    planes = np.linalg.pinv(np.stack([np.ones(near.shape), *offset], axis=-1))[:, 0]
    around = np.linalg.norm(u[:, moved], axis=0)
    mean = around[near].mean(axis=1)
    here = np.linalg.norm((planes * u[:, moved][:, near]).sum(axis=-1), axis=0)
    still[still] = (here > mean / 2) & (mean > STILL * around.max())
    return still


def _left_out(path: Path, lines: np.ndarray, why: str) -> list[str]:
    """A note on the points in ``lines`` that were not measured."""
    if not lines.size:
        return []
    return [f"{path.name}: {lines.size} points are left out, from line {lines[0]} on, where {why}"]


def _gridded(path: Path, points: np.ndarray, u: np.ndarray, lines: np.ndarray):
    """The grid's axes and the displacements on it (2, ny, nx)."""
    (x, across), (y, up) = (_axis(values) for values in points)
    for name, axis in (("x", x), ("y", y)):
        filled = axis.size >= 3 and lines.size >= _FILLED * x.size * y.size
        values = f"{axis.size} different values in {lines.size} points"
        wanted = "points on a grid of rows and columns, 3 or more of each"
        require(filled, name, values, wanted, file=str(path))
    field = np.full((2, y.size, x.size), np.nan)
    seen: dict[tuple[int, int], int] = {}
    for k, (i, j) in enumerate(zip(up, across, strict=True)):
        if (i, j) in seen:
            place, before = f"({points[0, k]:g}, {points[1, k]:g}) mm", lines[seen[i, j]]
            wanted = f"each point once; line {before} has it already. Fields at several travels need a column"
            raise BadInput("x, y", place, f"{wanted} 'travel'", file=str(path), line=int(lines[k]))
        seen[i, j] = k
        field[:, i, j] = u[:, k]
    return x, y, field


def _axis(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values in ascending order and the place of each value among them.

    Values closer than a tenth of the usual spacing are one.
    """
    order = np.sort(values)
    gaps = np.diff(order)
    wide = gaps[gaps > 1e-9 * max(np.ptp(values), 1e-300)]
    if wide.size == 0:
        return order[:1], np.zeros(values.size, dtype=int)
    spacing = np.median(wide[wide > _OFF * wide.max()])
    starts = np.append(0, np.flatnonzero(gaps > _OFF * spacing) + 1)
    axis = np.array([group.mean() for group in np.split(order, starts[1:])])
    return axis, np.argmin(np.abs(values[:, None] - axis), axis=1)


def read_fields_of(table: object, folder: Path) -> tuple[tuple[Field, ...], float]:
    """The fields that ``table``, the section ``fields`` of an experiment, describes, and their noise in mm.

    Raises BadInput; where the fault is in the data file, the error names that file and its line.
    """
    wanted = "a table, such as fields = { data = 'dic.csv', noise = '0.01 mm' }"
    part = read_section(Entry("fields", dict, wanted).read(table), _SECTION, "fields.")
    file = folder / part["data"]
    require(file.is_file(), "fields.data", part["data"], f"a file that exists in {folder}, such as 'dic.csv'")
    fields = read_fields(
        file, columns=part["columns"], units=part["units"], configuration=part["configuration"],
        shift_mm=part["shift"], y_down=part["y_down"], travel_mm=part["travel"], valid=part["valid"],
    )  # fmt: skip
    for field in fields:
        value = "(missing)" if math.isnan(field.travel_mm) else f"{field.travel_mm:g} mm"
        expected = "blade travels above 0: a column 'travel [mm]', or travel"
        require(field.travel_mm > 0, "fields.travel", value, expected)
    return tuple(thinned(field) for field in fields), part["noise"]


def laid_out(fields: Sequence[Field]) -> np.ndarray:
    """Displacements (f,) of several fields, one after the other."""
    return np.concatenate([field.u.ravel() for field in fields])


def thinned(field: Field, points: int = POINTS) -> Field:
    """Every n-th row and column, so that no more than ``points`` are left."""
    every = 1
    while -(-field.x.size // every) * -(-field.y.size // every) > points:
        every += 1
    x, y, u = field.x[::every], field.y[::every], field.u[:, ::every, ::every]
    return replace(field, x=x, y=y, u=np.ascontiguousarray(u))
