"""Sections from a user's file: read, checked, and refused with what is wrong."""

from __future__ import annotations

import meshio
import numpy as np
import skfem
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skfem.io.meshio import from_meshio

from cutbench.base.mesh_files import Refuse, compact, read_file, refusal

#: Boundary lines that the file must name, with the coordinate (0: x, 1: y) that is constant on them.
LINES = {"cut": 0, "bottom": 1, "top": 1}


def read_mesh(path: str, width: float, height: float) -> skfem.MeshTri:
    """The right half of a section in mm from any file that meshio reads, with lines cut, top and bottom.

    The block fills 0 ≤ x ≤ width/2, 0 ≤ y ≤ height; cut is all of x = 0, bottom of y = 0, top of
    y = height. Raises BadInput if the file cannot be read, holds anything but three-node triangles, is
    not conforming or in several parts, lacks a name, or a line is not where its name says.
    """
    refuse = refusal(path)
    raw = _plane_triangles(read_file(path, refuse), refuse)
    try:
        mesh = from_meshio(raw)
    except Exception as error:  # whatever a file can hold that scikit-fem did not expect
        why = str(error) or type(error).__name__
        raise refuse(why, "a plane mesh of triangles with named lines") from error
    named = mesh.boundaries or {}
    if missing := [name for name in LINES if name not in named]:
        found = ", ".join(sorted(named)) or "none"
        wanted = f"lines named {', '.join(LINES)} ({', '.join(missing)} missing)"
        raise refuse(f"lines named: {found}", wanted)
    # Sorted, and without orientation: the same section gives the same numbers from any file format.
    lines = {name: np.unique(np.asarray(named[name])) for name in LINES}
    mesh = skfem.MeshTri(mesh.p, mesh.t).with_boundaries(lines)
    _check_extent(mesh, width, height, refuse)
    for name, axis in LINES.items():
        _check_line(mesh, name, axis, height if name == "top" else 0.0, refuse)
    _check_conforming(mesh, refuse)
    return mesh


def _plane_triangles(raw: meshio.Mesh, refuse: Refuse) -> meshio.Mesh:
    """``raw`` without the points that no triangle uses; refused unless it is a plane mesh of triangles."""
    kinds = [block.type for block in raw.cells]
    if "triangle" not in kinds or set(kinds) - {"triangle", "line", "vertex"}:
        raise refuse(
            f"cells: {', '.join(dict.fromkeys(kinds)) or 'none'}",
            "three-node triangles and lines alone (cutbench adds the nodes of quadratic elements)",
        )
    points = np.asarray(raw.points, dtype=float)
    triangles = raw.cells_dict["triangle"]
    used = np.unique(triangles)
    if not np.isfinite(points[used]).all():
        raise refuse("a coordinate that is not a number", "finite coordinates in mm")
    if points.shape[1] == 3 and (away := np.ptp(points[used, 2])) > 1e-9 * np.ptp(points[used]):
        raise refuse(f"z over a range of {away:g} mm", "a plane mesh: x across the cut, y up, one z")
    try:
        return compact(raw, points[used, :2], used, ("triangle", "line"))
    except ValueError as error:
        raise refuse("a line that is on no triangle", "lines along edges of triangles") from error


def _check_extent(mesh: skfem.MeshTri, width: float, height: float, refuse: Refuse) -> None:
    eps = 1e-6 * height
    (left, low), (right, high) = mesh.p.min(axis=1), mesh.p.max(axis=1)
    if left < -eps:
        raise refuse(f"x from {left:g} mm", "the right half of the block, x >= 0 mm, cut at x = 0 mm")
    if low < -eps or high > height + eps:
        raise refuse(
            f"y from {low:g} mm to {high:g} mm", f"y from 0 mm to the specimen's height, {height:g} mm"
        )
    if abs(right - width / 2) > eps:
        raise refuse(
            f"x up to {right:g} mm",
            f"x up to half of the specimen's width, {width / 2:g} mm (or width = '{2 * right:g} mm')",
        )


def _check_line(mesh: skfem.MeshTri, name: str, axis: int, where: float, refuse: Refuse) -> None:
    """The line must be straight, at its place, and hold every boundary edge that lies there."""
    facets = mesh.boundaries[name]
    eps = 1e-6 * max(mesh.p[1].max(), 1.0)
    place = f"line '{name}' at {'xy'[axis]} = {where:g} mm"
    if facets.size == 0:
        raise refuse(f"line '{name}' has no edges", place)
    off = np.abs(mesh.p[axis][mesh.facets] - where)
    worst = off[:, facets].max()
    if worst > eps:
        raise refuse(f"line '{name}' off by {worst:g} mm", place)
    there = np.flatnonzero((off.max(axis=0) <= eps) & (mesh.f2t[1] == -1))
    if lost := np.setdiff1d(there, facets).size:
        raise refuse(f"line '{name}' without {lost} of {there.size} edges there", f"{place}, complete")


def _check_conforming(mesh: skfem.MeshTri, refuse: Refuse) -> None:
    corners = mesh.p[:, mesh.t]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if (flat := np.abs(a[0] * b[1] - a[1] * b[0]) <= 1e-12 * mesh.p[1].max() ** 2).any():
        raise refuse(f"{flat.sum()} triangles without area", "triangles with an area")
    count = mesh.p.shape[1]
    joined = coo_matrix((np.ones(mesh.facets.shape[1]), mesh.facets), shape=(count, count))
    parts = connected_components(joined, directed=False)[0]
    if parts > 1:
        raise refuse(f"{parts} parts", "one connected section (merge coincident points)")
    if hanging := _nodes_on_edges(mesh):
        raise refuse(
            f"{hanging} nodes on an edge of another triangle",
            "a conforming mesh: triangles that meet share whole edges (merge coincident points)",
        )


def _nodes_on_edges(mesh: skfem.MeshTri) -> int:
    """How many boundary nodes touch a boundary edge that is not theirs: hanging or doubled nodes."""
    edges = mesh.facets[:, mesh.f2t[1] == -1]
    nodes = np.unique(edges)
    start, end = mesh.p[:, edges[0]], mesh.p[:, edges[1]]
    along = end - start
    length2 = (along**2).sum(axis=0)
    found = 0
    for node in nodes:
        away = mesh.p[:, [node]] - start
        part = np.clip((away * along).sum(axis=0) / length2, 0, 1)
        distance2 = ((away - part * along) ** 2).sum(axis=0)
        found += bool(((distance2 < 1e-12 * length2) & (edges != node).all(axis=0)).any())
    return found
