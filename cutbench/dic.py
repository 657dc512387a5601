"""Displacement fields from digital image correlation, beside those of a run.

A field is a grid of points on the specimen's end face, the section that the blade is seen to enter:
x across the blade with 0 in its middle plane, y up with 0 at the base. The points are positions after
(``deformed``) or before deformation (``reference``). The computed field is sampled on the same grid in
the same configuration, inside the (curved) elements; what lies outside the body, or was not measured,
is nan. The relative error of a component is |u_exp − u_num| / mean |u_num| over the points that both
have. Strains are Green–Lagrange, E = (FᵀF − I)/2, from central differences on the grid for both fields
alike: F = I + ∂u/∂X, or (I − ∂u/∂x)⁻¹ in the deformed configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutbench.errors import BadInput
from cutbench.reading import one_of
from cutbench.readings import read_table
from cutbench.result import Snapshot
from cutbench.triangles import located, surface

CONFIGURATIONS = ("deformed", "reference")
#: Points of one row or column of the grid may be off by this part of the spacing.
_OFF = 0.1
#: A field and a snapshot are of one travel if they are no farther apart, mm.
_APART = 0.2
#: A grid has at least this part of its places filled; scattered points have next to none.
_FILLED = 0.2


@dataclass(frozen=True, eq=False)
class Field:
    """Displacements ``u`` (2, ny, nx) in mm on the grid ``x`` (nx,), ``y`` (ny,) in mm; nan where unknown."""

    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    travel_mm: float | None = None
    configuration: str = "deformed"

    def __post_init__(self) -> None:
        if self.configuration not in CONFIGURATIONS:
            raise BadInput(
                key="configuration",
                value=self.configuration,
                expected=one_of(self.configuration, CONFIGURATIONS),
            )
        if self.u.shape != (2, self.y.size, self.x.size):
            raise BadInput(key="u", value=str(self.u.shape), expected=f"(2, {self.y.size}, {self.x.size})")

    @property
    def grid(self) -> np.ndarray:
        """Positions (2, ny, nx) in mm."""
        return np.stack(np.meshgrid(self.x, self.y))

    @property
    def deformed(self) -> np.ndarray:
        """Positions (2, ny, nx) after deformation, mm."""
        return self.grid if self.configuration == "deformed" else self.grid + self.u

    @property
    def strain(self) -> np.ndarray:
        """Green–Lagrange strain (2, 2, ny, nx)."""
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


@dataclass(frozen=True, eq=False)
class Comparison:
    """A measured field and what a run gives on its grid."""

    measured: Field
    computed: Field

    @property
    def both(self) -> np.ndarray:
        """Where both are known (ny, nx)."""
        return np.isfinite(self.measured.u).all(axis=0) & np.isfinite(self.computed.u).all(axis=0)

    @property
    def scale(self) -> np.ndarray:
        """mean |u_num| (2,) in mm over the points that both have."""
        return np.abs(self.computed.u[:, self.both]).mean(axis=1)

    @property
    def relative_error(self) -> np.ndarray:
        """|u_exp − u_num| / mean |u_num| (2, ny, nx); nan where one of them is not known."""
        off = np.abs(self.measured.u - self.computed.u) / self.scale[:, None, None]
        return np.where(self.both, off, np.nan)

    @property
    def strain_error(self) -> np.ndarray:
        """E_exp − E_num (2, 2, ny, nx)."""
        return self.measured.strain - self.computed.strain

    def numbers(self) -> dict[str, float]:
        """Points compared, scale, root mean square of the difference and relative errors by component."""
        found: dict[str, float] = {
            "points": float(self.measured.u[0].size),
            "measured": float(np.isfinite(self.measured.u).all(axis=0).sum()),
            "compared": float(self.both.sum()),
        }
        for i, name in enumerate(("u_x", "u_y")):
            off = (self.measured.u - self.computed.u)[i][self.both]
            error = self.relative_error[i][self.both]
            found[f"mean_{name}_mm"] = float(self.scale[i])
            found[f"rms_{name}_mm"] = float(np.sqrt(np.mean(off**2)))
            found[f"mean_error_{name}"] = float(error.mean())
            found[f"median_error_{name}"] = float(np.median(error))
            found[f"p95_error_{name}"] = float(np.percentile(error, 95))
            found[f"max_error_{name}"] = float(error.max())
        for (i, j), name in (((0, 0), "E_xx"), ((1, 1), "E_yy"), ((0, 1), "E_xy")):
            off = self.strain_error[i, j]
            off = off[np.isfinite(off)]
            found[f"rms_{name}"] = float(np.sqrt(np.mean(off**2))) if off.size else float("nan")
        return found


def read_fields(
    path: str | Path,
    *,
    columns: Mapping[str, str | int] | None = None,
    units: Mapping[str, str] | None = None,
    configuration: str = "deformed",
    shift_mm: tuple[float, float] = (0.0, 0.0),
    y_down: bool = False,
    travel_mm: float | None = None,
) -> list[Field]:
    """The fields in a text file, in the order of blade travel: a row a point.

    ``columns`` (default: x, y, u_x, u_y and, if the file has it, travel) and ``units`` as in a campaign.
    ``y_down``: y and u_y count downwards, as in pictures. ``shift_mm`` is then added to x and y.
    ``travel_mm`` is the travel of a file without such a column. Raises BadInput for a file that cannot be
    read, points that are on no grid, or given twice.
    """
    path = Path(path)
    if columns is None:
        columns = {name: name for name in ("x", "y", "u_x", "u_y")}
        try:
            table = read_table(path, {**columns, "travel": "travel"}, units, blanks=("u_x", "u_y"))
        except BadInput as error:
            if error.key != "columns.travel":
                raise
            units = {k: v for k, v in (units or {}).items() if k != "travel"}
            table = read_table(path, columns, units, blanks=("u_x", "u_y"))
    else:
        for role in ("x", "y", "u_x", "u_y"):
            if role not in columns:
                raise BadInput(key=f"columns.{role}", value="(missing)", expected=f"the column of {role}")
        table = read_table(path, columns, units, blanks=("u_x", "u_y"))
    data = dict(table.columns)
    if y_down:
        data |= {"y": -data["y"], "u_y": -data["u_y"]}
    travels = data.get("travel")
    if travels is None:
        travels = np.full(table.lines.size, np.nan if travel_mm is None else travel_mm)
    fields = []
    for travel in np.unique(travels):
        here = np.isnan(travels) if np.isnan(travel) else travels == travel
        points = np.stack([data["x"][here] + shift_mm[0], data["y"][here] + shift_mm[1]])
        u = np.stack([data["u_x"][here], data["u_y"][here]])
        x, y, field = _gridded(path, points, u, table.lines[here])
        fields.append(Field(x, y, field, None if np.isnan(travel) else float(travel), configuration))
    return fields


def _gridded(path: Path, points: np.ndarray, u: np.ndarray, lines: np.ndarray):
    """The grid's axes and the displacements on it (2, ny, nx)."""
    (x, across), (y, up) = (_axis(values) for values in points)
    for name, axis in (("x", x), ("y", y)):
        if axis.size < 3 or lines.size < _FILLED * x.size * y.size:
            raise BadInput(
                file=str(path), key=name, value=f"{axis.size} different values in {lines.size} points",
                expected="points on a grid of rows and columns, 3 or more of each",
            )  # fmt: skip
    field = np.full((2, y.size, x.size), np.nan)
    seen: dict[tuple[int, int], int] = {}
    for k, (i, j) in enumerate(zip(up, across, strict=True)):
        if (i, j) in seen:
            raise BadInput(
                file=str(path), line=int(lines[k]), key="x, y",
                value=f"({points[0, k]:g}, {points[1, k]:g}) mm",
                expected=f"each point once; line {lines[seen[i, j]]} has it already. Fields at several"
                " blade travels need a column 'travel'",
            )  # fmt: skip
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


def sample(snapshot: Snapshot, field: Field) -> Field:
    """The run's displacements on the grid of ``field``, in its configuration; nan outside the body.

    A half or quarter model stands for its mirror image too. Of a block the end face is sampled.
    """
    points, u, triangles = surface(snapshot)
    mirrored = points[:, 0].min() > -1e-9 * np.ptp(points[:, 0])
    at = field.grid.reshape(2, -1).T
    nudge = _OFF * float(np.diff(field.x).min())
    side = np.where(at[:, 0] < 0, -1.0, 1.0) if mirrored else np.ones(len(at))
    flip = np.stack([side, np.ones(len(at))], axis=1)
    nodes = points + u if field.configuration == "deformed" else points
    weights, element = located(nodes, triangles, at * flip)
    if mirrored:
        # A plane that has opened by far less than the grid resolves is no gap in a picture.
        missed = np.flatnonzero((element < 0) & (np.abs(at[:, 0]) < nudge))
        beside = at[missed] * flip[missed] + np.array([nudge, 0.0])
        weights[missed], element[missed] = located(nodes, triangles, beside)
    found = np.full(at.shape, np.nan)
    inside = element >= 0
    values = u[triangles[element[inside]]]
    found[inside] = np.einsum("pa,pai->pi", weights[inside], values) * flip[inside]
    return Field(
        field.x, field.y, found.T.reshape(field.u.shape), snapshot.displacement_mm, field.configuration
    )


def at_travel(snapshots: Sequence[Snapshot], travel_mm: float) -> Snapshot | None:
    """Displacements at one blade travel, interpolated between the nearest snapshots before and after.

    The nearest alone where there is only one side; None if none is within 0.2 mm.
    """
    near = [s for s in snapshots if abs(s.displacement_mm - travel_mm) <= _APART]
    if not near:
        return None
    before = max((s for s in near if s.displacement_mm <= travel_mm), key=_travel, default=None)
    after = min((s for s in near if s.displacement_mm >= travel_mm), key=_travel, default=None)
    if before is None or after is None or before is after:
        return before or after
    way = after.displacement_mm - before.displacement_mm
    part = (travel_mm - before.displacement_mm) / way if way > 0 else 1.0
    u = [s.point_data["displacement"] for s in (before, after)]
    mixed = {"displacement": (1 - part) * u[0] + part * u[1]}
    return Snapshot(travel_mm, after.points, after.cells, after.cell_type, mixed)


def _travel(snapshot: Snapshot) -> float:
    return snapshot.displacement_mm


def compare(field: Field, snapshot: Snapshot) -> Comparison:
    """``field`` beside what the run gives. Raises BadInput if no point lies in the body or travels differ."""
    if field.travel_mm is not None and abs(field.travel_mm - snapshot.displacement_mm) > _APART:
        raise BadInput(
            key="travel", value=f"{field.travel_mm:g} mm",
            expected=f"the travel of the run's fields, {snapshot.displacement_mm:g} mm",
        )  # fmt: skip
    found = Comparison(field, sample(snapshot, field))
    if not found.both.any():
        body = snapshot.current if field.configuration == "deformed" else snapshot.points
        low, high = body.min(axis=0), body.max(axis=0)
        raise BadInput(
            key="x, y",
            value=f"x {field.x[0]:.4g} to {field.x[-1]:.4g} mm, y {field.y[0]:.4g} to {field.y[-1]:.4g} mm",
            expected=f"points in the body, x up to {high[0]:.4g} mm from the blade's plane and y from"
            f" {low[1]:.4g} to {high[1]:.4g} mm; shift them, or check the unit",
        )  # fmt: skip
    return found
