"""Sections from a user's file: read, checked, and refused with what is wrong."""

from __future__ import annotations

import numpy as np
import skfem

from cutbench.base.mesh_files import Refuse, check_facets, named_facets, pieces, read_simplices, refusal

#: Boundary lines that the file must name, with the coordinate (0: x, 1: y) that is constant on them.
LINES = {"cut": 0, "bottom": 1, "top": 1}


def read_mesh(path: str, width: float, height: float) -> skfem.MeshTri:
    """The right half of a section in mm from any file that meshio reads, with lines cut, top and bottom.

    The block fills 0 ≤ x ≤ width/2, 0 ≤ y ≤ height; cut is all of x = 0, bottom of y = 0, top of
    y = height. Raises BadInput if the file cannot be read, holds anything but three-node triangles, is
    not conforming or in several parts, lacks a name, or a line is not where its name says.
    """
    refuse = refusal(path)
    mesh = read_simplices(path, 2, refuse)
    mesh = skfem.MeshTri(mesh.p, mesh.t).with_boundaries(named_facets(mesh, LINES, refuse))
    _check_extent(mesh, width, height, refuse)
    for name, axis in LINES.items():
        check_facets(mesh, name, axis, height if name == "top" else 0.0, refuse)
    _check_conforming(mesh, refuse)
    return mesh


def _check_extent(mesh: skfem.MeshTri, width: float, height: float, refuse: Refuse) -> None:
    eps = 1e-6 * height
    (left, low), (right, high) = mesh.p.min(axis=1), mesh.p.max(axis=1)
    if left < -eps:
        raise refuse(f"x from {left:g} mm", "the right half of the block, x >= 0 mm, cut at x = 0 mm")
    if low < -eps or high > height + eps:
        expected = f"y from 0 mm to the specimen's height, {height:g} mm"
        raise refuse(f"y from {low:g} mm to {high:g} mm", expected)
    if abs(right - width / 2) > eps:
        expected = f"x up to half of the specimen's width, {width / 2:g} mm (or width = '{2 * right:g} mm')"
        raise refuse(f"x up to {right:g} mm", expected)


def _check_conforming(mesh: skfem.MeshTri, refuse: Refuse) -> None:
    corners = mesh.p[:, mesh.t]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if (flat := np.abs(a[0] * b[1] - a[1] * b[0]) <= 1e-12 * mesh.p[1].max() ** 2).any():
        raise refuse(f"{flat.sum()} triangles without area", "triangles with an area")
    if (parts := pieces(mesh.facets, mesh.p.shape[1])) > 1:
        raise refuse(f"{parts} parts", "one connected section (merge coincident points)")
    if hanging := _nodes_on_edges(mesh):
        expected = "a conforming mesh: triangles that meet share whole edges (merge coincident points)"
        raise refuse(f"{hanging} nodes on an edge of another triangle", expected)


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
