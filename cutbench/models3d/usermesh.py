"""Blocks from a user's file: read, checked, and refused with what is wrong."""

from __future__ import annotations

from collections.abc import Mapping

import meshio
import numpy as np
import skfem
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skfem.io.meshio import from_meshio

from cutbench.base.errors import BadInput
from cutbench.base.mesh_files import Refuse, compact, read_file, refusal
from cutbench.models3d.mesh import tetrahedra

#: Faces that the file must name: the axis that is constant on them, and the parts that have them.
FACES = {
    "cut": (0, ("quarter", "half", "full")),
    "cut_minus": (0, ("full",)),
    "bottom": (1, ("quarter", "half", "full")),
    "top": (1, ("quarter", "half", "full")),
    "middle": (2, ("quarter",)),
}


def read_mesh(path: str, values: Mapping[str, float], symmetry: str) -> tuple[skfem.MeshTet, str]:
    """A part of a block in mm from any file that meshio reads, and which: quarter, half or full.

    ``values`` have width, height, length in mm. The cut plane is x = 0, the blade's edge runs along z, and
    0 ≤ y ≤ height. A quarter fills x ≥ 0, z ≥ 0, a half x ≥ 0, a full block both sides of the cut
    plane, which share no nodes there and match. Faces cut, top and bottom are named, of a quarter also middle
    (z = 0), of a full block also cut_minus (the face of x < 0). Raises BadInput if the file cannot be
    read, holds anything but four-node tetrahedra, is not that part whole and conforming, or a face is not
    where its name says.
    """
    refuse = refusal(path)
    raw = _tetrahedra(read_file(path, refuse), refuse)
    try:
        mesh = from_meshio(raw)
    except Exception as error:  # whatever a file can hold that scikit-fem did not expect
        why = str(error) or type(error).__name__
        raise refuse(why, "a mesh of tetrahedra with named faces") from error
    part = _part(mesh, values, refuse)
    if symmetry not in ("auto", part):
        raise BadInput(
            key="symmetry", value=symmetry, expected=f"'auto' or '{part}' with {path}, which holds that"
        )
    wanted = [name for name, (_, parts) in FACES.items() if part in parts]
    named = mesh.boundaries or {}
    if missing := [name for name in wanted if name not in named]:
        found = ", ".join(sorted(named)) or "none"
        raise refuse(
            f"faces named: {found}",
            f"faces named {', '.join(wanted)} for a {part} block ({', '.join(missing)} missing)",
        )
    # Sorted, and without orientation: the same block gives the same numbers from any file format.
    faces = {name: np.unique(np.asarray(named[name])) for name in wanted}
    mesh = tetrahedra(mesh.p, mesh.t).with_boundaries(faces)
    _check_whole(mesh, part, refuse)
    for name in wanted:
        axis, _ = FACES[name]
        _check_face(mesh, name, axis, values["height"] if name == "top" else 0.0, refuse)
    return mesh, part


def _tetrahedra(raw: meshio.Mesh, refuse: Refuse) -> meshio.Mesh:
    kinds = [block.type for block in raw.cells]
    if "tetra" not in kinds or set(kinds) - {"tetra", "triangle", "line", "vertex"}:
        raise refuse(
            f"cells: {', '.join(dict.fromkeys(kinds)) or 'none'}",
            "four-node tetrahedra and triangles alone (cutbench adds the nodes of quadratic elements)",
        )
    points = np.asarray(raw.points, dtype=float)
    used = np.unique(raw.cells_dict["tetra"])
    if not np.isfinite(points[used]).all():
        raise refuse("a coordinate that is not a number", "finite coordinates in mm")
    try:
        return compact(raw, points[used], used, ("tetra", "triangle"))
    except ValueError as error:
        raise refuse("a face that is on no tetrahedron", "triangles that are faces of tetrahedra") from error


def _part(mesh: skfem.MeshTet, values: Mapping[str, float], refuse: Refuse) -> str:
    """Which part of the block the mesh's extent is."""
    half, height, end = values["width"] / 2, values["height"], values["length"] / 2
    low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
    eps = 1e-6 * height

    def spans(axis: int, start: float, stop: float) -> bool:
        return abs(low[axis] - start) < eps and abs(high[axis] - stop) < eps

    if spans(1, 0.0, height):
        for part, x, z in (("quarter", 0.0, 0.0), ("half", 0.0, -end), ("full", -half, -end)):
            if spans(0, x, half) and spans(2, z, end):
                return part
    found = ", ".join(f"{axis} from {a:g} to {b:g} mm" for axis, a, b in zip("xyz", low, high, strict=True))
    raise refuse(
        found,
        f"y from 0 to {height:g} mm and x, z from 0 to {half:g}, {end:g} mm (a quarter), x from 0 and z from"
        f" {-end:g} mm (a half), or x from {-half:g} and z from {-end:g} mm (a full block)",
    )


def _check_whole(mesh: skfem.MeshTet, part: str, refuse: Refuse) -> None:
    """The tetrahedra must fill the part's box, and their outer faces be its faces: no hanging nodes."""
    corners = mesh.p[:, mesh.t]
    sides = np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0)
    volumes = np.abs(np.linalg.det(sides)) / 6
    width, height, length = np.ptp(mesh.p, axis=1)
    box = width * height * length
    if (flat := volumes <= 1e-12 * box).any():
        raise refuse(f"{flat.sum()} tetrahedra without volume", "tetrahedra with a volume")
    if abs(volumes.sum() - box) > 1e-6 * box:
        raise refuse(
            f"tetrahedra of {volumes.sum():g} mm^3", f"tetrahedra that fill {box:g} mm^3 without overlap"
        )
    count = mesh.p.shape[1]
    edges = mesh.edges
    joined = coo_matrix((np.ones(edges.shape[1]), edges), shape=(count, count))
    parts, expected = connected_components(joined, directed=False)[0], 2 if part == "full" else 1
    if parts != expected:
        wanted = "two halves that share no nodes on the cut plane" if expected == 2 else "one connected block"
        raise refuse(f"{parts} parts", f"{wanted} (merge other coincident points)")
    a, b, c = np.moveaxis(mesh.p[:, mesh.facets[:, mesh.boundary_facets()]], 1, 0)
    area = np.linalg.norm(np.cross((b - a).T, (c - a).T), axis=1).sum() / 2
    outer = 2 * (width * height + height * length + length * width)
    outer += 2 * height * length if part == "full" else 0.0  # both sides of the cut plane
    if abs(area - outer) > 1e-6 * outer:
        raise refuse(
            f"outer faces of {area:g} mm^2 instead of {outer:g} mm^2",
            "a conforming mesh: tetrahedra that meet share whole faces (merge coincident points)",
        )


def _check_face(mesh: skfem.MeshTet, name: str, axis: int, where: float, refuse: Refuse) -> None:
    """The face must be flat, at its place, on its side, and hold every boundary triangle that lies there."""
    facets = mesh.boundaries[name]
    eps = 1e-6 * mesh.p[1].max()
    place = f"face '{name}' at {'xyz'[axis]} = {where:g} mm"
    if facets.size == 0:
        raise refuse(f"face '{name}' has no triangles", place)
    off = np.abs(mesh.p[axis][mesh.facets] - where).max(axis=0)
    if (worst := off[facets].max()) > eps:
        raise refuse(f"face '{name}' off by {worst:g} mm", place)
    there = np.flatnonzero((off <= eps) & (mesh.f2t[1] == -1))
    if axis == 0:
        side = mesh.p[0, mesh.t[:, mesh.f2t[0, there]]].mean(axis=0)
        there = there[side < 0 if name == "cut_minus" else side > 0]
        place += " on the elements of " + ("x < 0" if name == "cut_minus" else "x > 0")
    if lost := np.setdiff1d(there, facets).size:
        raise refuse(f"face '{name}' without {lost} of {there.size} triangles there", f"{place}, complete")
    if extra := np.setdiff1d(facets, there).size:
        raise refuse(f"face '{name}' with {extra} triangles too many", place)
