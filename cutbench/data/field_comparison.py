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

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import skfem

from cutbench.base.errors import require
from cutbench.data.fields import Field
from cutbench.run.result import SLOPE, Snapshot

#: A point next to the plane of symmetry is looked for this part of the spacing beside it.
_OFF = 0.1
#: A field and a snapshot are of one travel if they are no farther apart than this part of the height.
_APART = 0.01


@dataclass(frozen=True, eq=False)
class Comparison:
    """A comparison puts a measured field beside what a run gives on its grid.

    Attributes
    ----------
    measured : Field
        As measured.
    computed : Field
        As computed, on the same grid, in the same configuration.
    """

    measured: Field
    computed: Field

    @property
    def both(self) -> np.ndarray:
        """The points (ny, nx) at which both are known."""
        return np.isfinite(self.measured.u).all(axis=0) & np.isfinite(self.computed.u).all(axis=0)

    @property
    def scale(self) -> np.ndarray:
        """The mean (2,) of ``|u_num|`` in mm over the points that both have."""
        return np.abs(self.computed.u[:, self.both]).mean(axis=1)

    @property
    def relative_error(self) -> np.ndarray:
        """``|u_exp − u_num| / mean |u_num|`` (2, ny, nx); nan where one of them is not known."""
        off = np.abs(self.measured.u - self.computed.u) / self.scale[:, None, None]
        return np.where(self.both, off, np.nan)

    @property
    def strain_error(self) -> np.ndarray:
        """The difference E_exp − E_num (2, 2, ny, nx) of Green–Lagrange strains."""
        return self.measured.strain - self.computed.strain

    def numbers(self) -> dict[str, float]:
        """Say in numbers how far the two are apart."""
        numbers: dict[str, float] = {
            "points": float(self.measured.u[0].size),
            "measured": float(np.isfinite(self.measured.u).all(axis=0).sum()),
            "compared": float(self.both.sum()),
        }
        for i, name in enumerate(("u_x", "u_y")):
            off = (self.measured.u - self.computed.u)[i][self.both]
            error = self.relative_error[i][self.both]
            numbers[f"mean_{name}_mm"], numbers[f"rms_{name}_mm"] = float(self.scale[i]), _rms(off)
            numbers[f"mean_error_{name}"] = float(error.mean())
            for word, percent in (("median", 50), ("p95", 95), ("max", 100)):
                numbers[f"{word}_error_{name}"] = float(np.percentile(error, percent))
        for (i, j), name in (((0, 0), "E_xx"), ((1, 1), "E_yy"), ((0, 1), "E_xy")):
            off = self.strain_error[i, j]
            off = off[np.isfinite(off)]
            numbers[f"rms_{name}"] = _rms(off) if off.size else float("nan")
        return numbers


def _rms(off: np.ndarray) -> float:
    return float(np.sqrt(np.mean(off**2)))


def sample(snapshot: Snapshot, field: Field) -> Field:
    """Sample the displacements of a run on the grid of a measured field.

    A half or quarter model stands for its mirror image too. Of a block the end face is sampled.
    """
    weights, element, flip, (_, u, triangles) = _elements_at(snapshot, field)
    sampled = np.full(flip.shape, np.nan)
    inside = element >= 0
    values = u[triangles[element[inside]]]
    sampled[inside] = np.einsum("pa,pai->pi", weights[inside], values) * flip[inside]
    return Field(
        field.x, field.y, sampled.T.reshape(field.u.shape), snapshot.displacement_mm, field.configuration
    )


def sampled_slopes(snapshot: Snapshot, field: Field, names: Sequence[str]) -> np.ndarray:
    """What ``sample`` gives, differentiated by parameters: (2, ny, nx, k), nan outside the body.

    At a fixed place x the material changes with the parameter too: du = (I − ∂u/∂x) du|_X.
    """
    weights, element, flip, (points, u, triangles) = _elements_at(snapshot, field)
    inside = element >= 0
    N, mine = weights[inside], triangles[element[inside]]
    keep = np.broadcast_to(np.eye(2), (len(mine), 2, 2))
    if field.configuration == "deformed":
        keep = keep - gradient((points + u)[mine], N, u[mine])
    sampled = np.full((*flip.shape, len(names)), np.nan)
    for k, name in enumerate(names):
        moved = np.einsum("pa,pai->pi", N, snapshot.point_data[SLOPE + name][mine, :2])
        sampled[inside, :, k] = np.einsum("pij,pj->pi", keep, moved) * flip[inside]
    return np.moveaxis(sampled, 0, 1).reshape(*field.u.shape, len(names))


def _elements_at(snapshot: Snapshot, field: Field):
    """Of each place of the grid: weights of its element's nodes, the element (−1 outside), the sign (p, 2) by
    which it was mirrored; and the surface that was looked at."""
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
    return weights, element, flip, (points, u, triangles)


def at_travel(snapshots: Sequence[Snapshot], travel_mm: float) -> Snapshot | None:
    """Interpolate displacements at one blade travel between the nearest snapshots before and after."""
    near = [s for s in snapshots if not _apart(s, travel_mm)]
    if not near:
        return None
    travel = attrgetter("displacement_mm")
    before = max((s for s in near if s.displacement_mm <= travel_mm), key=travel, default=None)
    after = min((s for s in near if s.displacement_mm >= travel_mm), key=travel, default=None)
    if before is None or after is None or before is after:
        return before or after
    way = after.displacement_mm - before.displacement_mm
    part = (travel_mm - before.displacement_mm) / way if way > 0 else 1.0
    moved = [name for name in after.point_data if name == "displacement" or name.startswith(SLOPE)]
    mixed = {name: (1 - part) * before.point_data[name] + part * after.point_data[name] for name in moved}
    return Snapshot(travel_mm, after.points, after.cells, after.cell_type, mixed)


def _apart(snapshot: Snapshot, travel_mm: float) -> bool:
    return bool(abs(snapshot.displacement_mm - travel_mm) > _APART * np.ptp(snapshot.points[:, 1]))


def compare(field: Field, snapshot: Snapshot) -> Comparison:
    """Put a measured field beside what a run gives at the same blade travel. Raises BadInput."""
    expected = f"the travel of the run's fields, {snapshot.displacement_mm:g} mm"
    require(not _apart(snapshot, field.travel_mm), "travel", f"{field.travel_mm:g} mm", expected)
    comparison = Comparison(field, sample(snapshot, field))
    body = snapshot.current if field.configuration == "deformed" else snapshot.points
    low, high = body.min(axis=0), body.max(axis=0)
    grid = f"x {field.x[0]:.4g} to {field.x[-1]:.4g} mm, y {field.y[0]:.4g} to {field.y[-1]:.4g} mm"
    expected = (
        f"points in the body, x up to {high[0]:.4g} mm from the blade's plane and y from"
        f" {low[1]:.4g} to {high[1]:.4g} mm; shift them, or check the unit"
    )
    require(comparison.both.any(), "x, y", grid, expected)
    return comparison


#: Points looked up at once, against the bounding boxes of all elements.
_CHUNK = 400
#: Natural coordinates may leave the element by this much: points on an edge belong to one of the two.
_SLACK = 1e-6
#: By the number of nodes, which scikit-fem counts as meshio does.
_ELEMENTS = {3: skfem.ElementTriP1(), 6: skfem.ElementTriP2()}


def surface(snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (n, 2) and displacements (n, 2) in mm and triangles (m, 3 or 6) of what is seen along the
    blade: the section in 2D, the end face at the largest z in 3D. Nodes that no triangle has stay."""
    points, u = snapshot.points, snapshot.point_data["displacement"]
    if snapshot.cell_type.startswith("triangle"):
        return points[:, :2], u[:, :2], snapshot.cells
    top = points[:, 2].max()
    on_end = points[:, 2] > top - 1e-9 * np.ptp(points[:, 2])
    # meshio's order: corners 0-3, then the middles of 01, 12, 02, 03, 13, 23.
    middles = {(0, 1): 4, (1, 2): 5, (0, 2): 6, (0, 3): 7, (1, 3): 8, (2, 3): 9}
    outer = []
    for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        local = [a, b, c]
        if snapshot.cells.shape[1] == 10:
            local += [middles[a, b], middles[b, c], middles[a, c]]
        faces = snapshot.cells[:, local]
        outer.append(faces[on_end[faces].all(axis=1)])
    return points[:, :2], u[:, :2], np.concatenate(outer)


def shape(r: np.ndarray, s: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (p, nodes) and their derivatives by r and s (2, p, nodes), 3 or 6 nodes."""
    pairs = [_ELEMENTS[nodes].lbasis(np.stack([r, s]), i) for i in range(nodes)]
    return np.stack([value for value, _ in pairs], axis=-1), np.stack([slope for _, slope in pairs], axis=-1)


def gradient(nodes: np.ndarray, N: np.ndarray, values: np.ndarray) -> np.ndarray:
    """∂v_i/∂x_j (p, 2, 2) of ``values`` v, where the shape functions of an element are ``N`` (p, 3 or 6).

    ``nodes``, ``values`` (p, 3 or 6, 2) at the nodes of each point's element.
    """
    r, s = (N @ _ELEMENTS[N.shape[1]].doflocs).T
    dN = shape(r, s, N.shape[1])[1]
    by_place, by_value = (np.einsum("kpa,pai->pik", dN, v) for v in (nodes, values))
    return by_value @ np.linalg.inv(by_place)


def located(nodes: np.ndarray, triangles: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (p, 3 or 6) of the nodes and the element (p,) of each point (p, 2); −1 outside.

    ``nodes`` (n, 2), ``triangles`` (m, 3 or 6). A curved element is inverted by Newton's method.
    """
    corners = nodes[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    # The edge of a curved element may pass its nodes a little.
    margin = 0.1 * (high - low)
    low, high = low - margin, high + margin
    weights = np.zeros((len(points), triangles.shape[1]))
    element = np.full(len(points), -1)
    for begin in range(0, len(points), _CHUNK):
        part = points[begin : begin + _CHUNK]
        near = np.all((part[:, None] >= low) & (part[:, None] <= high), axis=2)
        which, where = np.nonzero(near)
        N, inside = _inverted(corners[where], part[which])
        which, where, N = which[inside], where[inside], N[inside]
        # The first element that has a point keeps it.
        which, first = np.unique(which, return_index=True)
        weights[begin + which], element[begin + which] = N[first], where[first]
    return weights, element


def _inverted(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (k, 3 or 6) at ``points`` (k, 2) of one element each, and whether they are inside."""
    count = corners.shape[1]
    r = np.full(len(points), 1 / 3)
    s = r.copy()
    size = np.ptp(corners, axis=1).max(axis=1)
    for _ in range(12):
        N, dN = shape(r, s, count)
        off = points - np.einsum("pa,pai->pi", N, corners)
        J = np.einsum("kpa,pai->pik", dN, corners)
        det = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        det = np.where(np.abs(det) > 1e-30, det, np.nan)
        dr = (J[:, 1, 1] * off[:, 0] - J[:, 0, 1] * off[:, 1]) / det
        ds = (J[:, 0, 0] * off[:, 1] - J[:, 1, 0] * off[:, 0]) / det
        r, s = r + np.clip(dr, -0.5, 0.5), s + np.clip(ds, -0.5, 0.5)
    N, _ = shape(r, s, count)
    off = np.abs(points - np.einsum("pa,pai->pi", N, corners)).max(axis=1)
    with np.errstate(invalid="ignore"):
        inside = (r >= -_SLACK) & (s >= -_SLACK) & (r + s <= 1 + _SLACK) & (off < 1e-9 * size)
    return np.nan_to_num(N), inside
