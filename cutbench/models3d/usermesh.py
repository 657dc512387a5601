"""Blocks from a user's file: read, checked, and refused with what is wrong."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import skfem

from cutbench.base.errors import BadInput
from cutbench.base.mesh_files import Refuse, check_facets, named_facets, pieces, read_simplices, refusal
from cutbench.models3d.mesh import tetrahedra

#: Faces that the file must name: the axis that is constant on them, and the parts that have them.
FACES = {
    "cut": (0, ("quarter", "half", "full")),
    "cut_minus": (0, ("full",)),
    "bottom": (1, ("quarter", "half", "full")),
    "top": (1, ("quarter", "half", "full")),
    "middle": (2, ("quarter",)),
}
#: On which side of x = 0 the elements of the cut plane's two faces are.
SIDES = {"cut": 1.0, "cut_minus": -1.0}


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
    mesh = read_simplices(path, 3, refuse)
    part = _part(mesh, values, refuse)
    if symmetry not in ("auto", part):
        expected = f"'auto' or '{part}' with {path}, which holds that"
        raise BadInput(key="symmetry", value=symmetry, expected=expected)
    wanted = [name for name, (_, parts) in FACES.items() if part in parts]
    faces = named_facets(mesh, wanted, refuse, f" for a {part} block")
    mesh = tetrahedra(mesh.p, mesh.t).with_boundaries(faces)
    _check_whole(mesh, part, refuse)
    for name in wanted:
        where, side = values["height"] if name == "top" else 0.0, SIDES.get(name, 0.0)
        check_facets(mesh, name, FACES[name][0], where, refuse, side)
    return mesh, part


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
        right = f"tetrahedra that fill {box:g} mm^3 without overlap"
        raise refuse(f"tetrahedra of {volumes.sum():g} mm^3", right)
    parts, expected = pieces(mesh.edges, mesh.p.shape[1]), 2 if part == "full" else 1
    if parts != expected:
        wanted = "two halves that share no nodes on the cut plane" if expected == 2 else "one connected block"
        raise refuse(f"{parts} parts", f"{wanted} (merge other coincident points)")
    a, b, c = np.moveaxis(mesh.p[:, mesh.facets[:, mesh.boundary_facets()]], 1, 0)
    area = np.linalg.norm(np.cross((b - a).T, (c - a).T), axis=1).sum() / 2
    outer = 2 * (width * height + height * length + length * width)
    outer += 2 * height * length if part == "full" else 0.0  # both sides of the cut plane
    if abs(area - outer) > 1e-6 * outer:
        right = "a conforming mesh: tetrahedra that meet share whole faces (merge coincident points)"
        raise refuse(f"outer faces of {area:g} mm^2 instead of {outer:g} mm^2", right)
