"""Where points lie in a mesh of straight or curved triangles, and with which weights of its nodes."""

from __future__ import annotations

import numpy as np
import skfem

from cutbench.run.result import Snapshot

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
    found = []
    for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        local = [a, b, c]
        if snapshot.cells.shape[1] == 10:
            local += [middles[a, b], middles[b, c], middles[a, c]]
        faces = snapshot.cells[:, local]
        found.append(faces[on_end[faces].all(axis=1)])
    return points[:, :2], u[:, :2], np.concatenate(found)


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
