"""A block cut open along its cut plane, as surfaces: one side of it, the front of the cut, and the blade.

What is meshed may be a quarter of the block or half of it; what is shown is the whole side x ≥ 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from cutbench.case.case import Case
from cutbench.run.blade_geometry import blade_mesh
from cutbench.run.result import Snapshot

#: The front is where half of the cohesion is lost.
FRONT_DAMAGE = 0.5
#: The cut plane of a block that is no section drawn out is read in so many planes.
_PLANES = 41
#: The blade is shown along this part of itself, from the far end, and so far above the block, in parts of its
#: height: one looks at its section, and past it at the cut face.
BLADE_SHOWN, BLADE_ABOVE = 0.5, 0.2
#: An edge is drawn where a surface turns by more, in degrees.
_EDGE_DEG = 40.0


@dataclass(frozen=True)
class Columns:
    """The cut plane read along lines down from the top, k lines of n points each: where they were before
    loading, ``z`` (k,) and ``y`` (k, n), rising, the ``damage`` (k, n), and where they are, ``current`` (k,
    n, 3), all in mm."""

    z: np.ndarray
    y: np.ndarray
    damage: np.ndarray
    current: np.ndarray

    @property
    def height_mm(self) -> np.ndarray:
        """Height of the front (k,) in the uncut block: the top, where nothing is cut."""
        found = self.y[:, -1].copy()
        for k, (y, damage) in enumerate(zip(self.y, self.damage, strict=True)):
            whole = np.flatnonzero(damage < FRONT_DAMAGE)
            if whole.size == 0:
                found[k] = y[0]
            elif (last := whole[-1]) + 1 < y.size:
                part = (FRONT_DAMAGE - damage[last]) / (damage[last + 1] - damage[last])
                found[k] = y[last] + part * (y[last + 1] - y[last])
        return found

    @property
    def depth_mm(self) -> np.ndarray:
        """Depth of the cut (k,) in the uncut block."""
        return self.y[:, -1] - self.height_mm

    def front(self) -> np.ndarray:
        """Places of the front (k, 3) in the deformed block, mm."""
        rows = zip(self.height_mm, self.y, self.current, strict=True)
        return np.array([[np.interp(at, y, x[:, i]) for i in range(3)] for at, y, x in rows])

    def damage_at(self, z: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Damage (m,) at places that were at ``z`` and ``y`` (m,), mm, before loading."""
        on_lines = np.array([np.interp(y, own, d) for own, d in zip(self.y, self.damage, strict=True)])
        if self.z.size == 1:
            return on_lines[0]
        below = np.clip(np.searchsorted(self.z, z) - 1, 0, self.z.size - 2)
        part = np.clip((z - self.z[below]) / (self.z[below + 1] - self.z[below]), 0, 1)
        at = np.arange(z.size)
        return (1 - part) * on_lines[below, at] + part * on_lines[below + 1, at]


def columns_of(s: Snapshot) -> Columns:
    """The cut plane of ``s`` as far as it is meshed."""
    cut = s.faces["cut"]
    X, values = cut["X"], np.column_stack([cut["damage"], cut["x"]])
    z, counts = np.unique(np.round(X[:, 2], 9), return_counts=True)
    if np.all(counts == counts[0]) and z.size < counts[0]:  # a section drawn out, in its planes
        order = np.lexsort((X[:, 1], np.round(X[:, 2], 9))).reshape(z.size, -1)
        y, found = X[order, 1], values[order]
    else:
        z = np.linspace(X[:, 2].min(), X[:, 2].max(), _PLANES)
        level = np.unique(np.round(X[:, 1], 6))
        y = np.broadcast_to(level, (z.size, level.size))
        at = np.column_stack([np.repeat(z, level.size), y.ravel()])
        found = LinearNDInterpolator(X[:, [2, 1]], values, rescale=True)(at)
        beyond = np.isnan(found).any(axis=1)
        found[beyond] = NearestNDInterpolator(X[:, [2, 1]], values)(at[beyond])
        found = found.reshape(*y.shape, 4)
    return Columns(z, y, found[..., 0], found[..., 1:])


def whole_columns(s: Snapshot) -> Columns:
    """The whole cut plane of ``s``, of a quarter of a block both halves of it."""
    half = columns_of(s)
    if not _is_quarter(s):
        return half
    # A line in the middle is there once.
    other = slice(int(half.z[0] < 1e-9 * half.z[-1]), None)
    z, y, damage, current = (
        np.concatenate([sign * a[other][::-1], a])
        for sign, a in (
            (-1.0, half.z), (1.0, half.y), (1.0, half.damage), (np.array([1.0, 1.0, -1.0]), half.current),
        )
    )  # fmt: skip
    return Columns(z, y, damage, current)


@dataclass(frozen=True)
class CutOpen:
    """The side x ≥ 0 of a whole block as it is deformed, seen from its cut plane; n nodes, mm and kPa.

    ``reference`` and ``points`` (n, 3) are where the nodes of the surface were and are, ``stress_kPa`` (n,)
    von Mises stress, ``cut`` and ``skin`` (m, 3) triangles of the cut plane and of the rest, ``damage`` (n,)
    that on the cut plane, nan elsewhere, ``edges`` (e, 2) those of the block. ``front`` (k, 3) is where half
    of the cohesion is lost, along the blade, empty where nothing is cut. ``blade_points`` (b, 3), ``blade``
    (t, 3) and ``blade_edges`` (f, 2) are the surface and edges of the far part of the blade that is drawn;
    none without a blade."""

    reference: np.ndarray
    points: np.ndarray
    stress_kPa: np.ndarray
    cut: np.ndarray
    skin: np.ndarray
    damage: np.ndarray
    front: np.ndarray
    edges: np.ndarray
    blade_points: np.ndarray
    blade: np.ndarray
    blade_edges: np.ndarray


def cut_open(s: Snapshot, case: Case) -> CutOpen:
    """``s`` of a solid as the side x ≥ 0 of the whole block."""
    eps = 1e-9 * np.ptp(s.points[:, 0])
    own = s.cells[s.points[s.cells[:, :4], 0].mean(axis=1) > 0]
    faces = skin_of(own)
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    reference, points = s.points[used], s.current[used]
    stress = 1e3 * s.point_data["von_mises"][used]
    if _is_quarter(s):
        flip = np.array([1.0, 1.0, -1.0])
        middle = np.abs(reference[:, 2]) < eps
        faces = faces[~middle[faces].all(axis=1)]
        twin = np.where(middle, np.arange(middle.size), middle.size - 1 + np.cumsum(~middle))
        faces = np.concatenate([faces, twin[faces]])
        reference = np.concatenate([reference, flip * reference[~middle]])
        points = np.concatenate([points, flip * points[~middle]])
        stress = np.concatenate([stress, stress[~middle]])
    faces = _outwards(faces, reference)
    plane = np.all(np.abs(reference[faces, 0]) < eps, axis=1)
    cut, skin = faces[plane], faces[~plane]
    columns, damage = whole_columns(s), np.full(len(points), np.nan)
    nodes = np.unique(cut)
    damage[nodes] = columns.damage_at(reference[nodes, 2], reference[nodes, 1])
    front = columns.front() if columns.depth_mm.any() else np.empty((0, 3))
    edges = edges_of(reference, faces)
    blade_points, blade = _blade(case, s.displacement_mm)
    outline = edges_of(blade_points, blade)
    return CutOpen(
        reference, points, stress, cut, skin, damage, front, edges, blade_points, blade, outline
    )  # fmt: skip


def _is_quarter(s: Snapshot) -> bool:
    return bool(s.points[:, 2].min() > -1e-9 * np.ptp(s.points[:, 2]))


def _outwards(faces: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """``faces`` of a convex block, each in the order that has its normal point outwards."""
    a, b, c = (reference[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - reference.mean(axis=0)) < 0
    return np.where(inwards[:, None], faces[:, ::-1], faces)


def _blade(case: Case, travel_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (b, 3) in mm and triangles (t, 3) of the far part of the blade."""
    if case.model.tool is None:
        return np.empty((0, 3)), np.empty((0, 3), dtype=int)
    mesh = blade_mesh(case, travel_mm, (1 + BLADE_ABOVE) * case.p.height + travel_mm)
    far, near = np.split(mesh.points + mesh.point_data["displacement_mm"], 2)
    apart = np.linalg.norm(np.roll(far, -1, axis=0) - far, axis=1) > 1e-9 * case.p.height
    far, near = far[apart], far[apart] + BLADE_SHOWN * (near - far)[apart]
    n, loop = len(far), np.arange(len(far))
    points = np.concatenate([far, near, [far.mean(axis=0), near.mean(axis=0)]])
    on = np.roll(loop, -1)
    sides = [np.column_stack(t) for t in ((loop, on, on + n), (loop, on + n, loop + n))]
    ends = [
        np.column_stack(t) for t in ((on, loop, loop * 0 + 2 * n), (loop + n, on + n, loop * 0 + 2 * n + 1))
    ]
    return points, np.concatenate([*sides, *ends])


def edges_of(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Edges (e, 2) of a closed surface along which it turns by more than ``_EDGE_DEG``."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    sides = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(sides.T)
    sides, owner = sides[order], owner[order]
    pairs = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
    turn = np.einsum("ij,ij->i", normals[owner[pairs]], normals[owner[pairs + 1]])
    return sides[pairs[turn < np.cos(np.radians(_EDGE_DEG))]]


def skin_of(cells: np.ndarray) -> np.ndarray:
    """Corner triangles (n, 3) that belong to one tetrahedron only."""
    corners = cells[:, :4]
    faces = np.concatenate([corners[:, c] for c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[count == 1]]
