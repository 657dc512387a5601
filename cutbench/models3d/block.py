"""The block in three dimensions: a quarter or half of it by symmetry, or the full split block."""

from __future__ import annotations

import numpy as np
import skfem

from cutbench.base.errors import BadInput
from cutbench.case.mesh_sizes import near_blade
from cutbench.forms.geometry import Geometry
from cutbench.models3d.mesh import length_along, mirrored, outside, quarter
from cutbench.models3d.usermesh import read_mesh

#: Mirror images that each part of the block stands for.
PARTS = {"quarter": 4.0, "half": 2.0, "full": 1.0}


def _ends_alike(values, even: bool) -> bool:
    return even and not (values.get("incline", 0.0) or values.get("slice_push", 0.0))


def part_of(values, numerics, even: bool = True) -> str:
    """Which part of a block with a built-in mesh is meshed: quarter, half or full.

    ``even``: its material is alike towards both ends of the blade."""
    smallest = "quarter" if _ends_alike(values, even) else "half"
    smallest = "full" if values.get("tilt", 0.0) else smallest
    return smallest if numerics.symmetry == "auto" else numerics.symmetry


def geometry(values, numerics, radius: float = np.inf, even: bool = True) -> Geometry:
    """The block of a case: ``values`` have its sizes and the blade's, mm. Raises BadInput for a bad mesh.

    ``radius``: of the blade's edge, mm. ``even``: as ``part_of`` has it.
    """
    tilted = bool(values.get("tilt", 0.0))
    if numerics.mesh is not None:
        mesh, part = read_mesh(numerics.mesh, values, numerics.symmetry)
        if tilted and part != "full":
            expected = f"a full block with a tilted blade, not a {part}"
            raise BadInput(key="mesh", value=numerics.mesh, expected=expected)
        if part == "quarter" and not _ends_alike(values, even):
            expected = "half a block, or a full one, where blade or material is not alike towards both ends"
            raise BadInput(key="mesh", value=numerics.mesh, expected=expected)
        if part == "full":
            _check_pairs(mesh, numerics.mesh)
        held = (("middle", 2),) if part == "quarter" else ()
        return Geometry(mesh, values["height"], PARTS[part], held, split=part == "full")
    thickness, tuning = values["thickness"], numerics.tuning.mesh
    h = numerics.sizes(thickness).h_mm
    h_z = length_along(values["length"], h, numerics.along, tuning.longest)
    sizes = {"slender": numerics.slender, "reach": tuning.block_reach * thickness}
    sizes |= near_blade(numerics, thickness, radius)
    mesh = quarter(values["width"], values["height"], values["length"], h, h_z=h_z, **sizes)
    return block(mesh, part_of(values, numerics, even))


def _check_pairs(mesh: skfem.MeshTet, path: str) -> None:
    """Both sides of the cut plane must have the same triangles."""
    eps = 1e-7 * float(np.ptp(mesh.p))
    plus, minus = (
        np.sort(
            np.round(mesh.p[1:, mesh.facets[:, mesh.boundaries[name]]].mean(axis=1) / eps).T.view("f8,f8"),
            axis=0,
        )
        for name in ("cut", "cut_minus")
    )
    if plus.shape != minus.shape or not np.array_equal(plus, minus):
        found = f"{plus.size} triangles on one side of the cut plane, {minus.size} on the other"
        raise BadInput(file=str(path), key="mesh", value=found, expected="the same triangles on both sides")


def block(mesh: skfem.MeshTet, part: str = "quarter") -> Geometry:
    """The ``part`` of a block whose quarter x ≥ 0, z ≥ 0 is ``mesh``: quarter, half (x ≥ 0) or full.

    Faces: "cut" (x = 0), "top", "bottom", "side", "end", and "middle" (z = 0) where that is a symmetry
    plane; of the full block, which is split along the cut plane, also "cut_minus", its other side.
    """
    if part not in PARTS:
        raise ValueError(f"part '{part}' is none of {', '.join(PARTS)}")
    if part != "quarter":
        mesh = mirrored(mesh, 2, joined=True)
    if part == "full":
        mesh = mirrored(mesh, 0, joined=False)
    held = (("middle", 2),) if part == "quarter" else ()
    return Geometry(named(mesh), float(mesh.p[1].max()), PARTS[part], held, split=part == "full")


def named(mesh: skfem.MeshTet) -> skfem.MeshTet:
    """Name the faces of a block by their position; both sides of a split are told apart by their elements."""
    half, height, end = mesh.p.max(axis=1)
    outer, (x, y, z), at = outside(mesh, 1e-9 * height)
    inside = mesh.p[0, mesh.t[:, mesh.f2t[0, outer]]].mean(axis=0)
    cut = at(x, 0.0)
    faces = {
        "cut": cut & (inside > 0),
        "cut_minus": cut & (inside < 0),
        "top": at(y, height),
        "bottom": at(y, 0.0),
        "side": at(np.abs(x), half),
        "end": at(np.abs(z), end),
        "middle": at(z, 0.0),
    }
    return mesh.with_boundaries({name: outer[chosen] for name, chosen in faces.items() if chosen.any()})
