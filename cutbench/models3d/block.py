"""The block in three dimensions: a quarter or half of it by symmetry, or the full split block."""

from __future__ import annotations

import numpy as np
import skfem

from cutbench.errors import BadInput
from cutbench.models3d.mesh import mirrored, quarter
from cutbench.solve.geometry import Geometry

#: Mirror images that each part of the block stands for.
PARTS = {"quarter": 4.0, "half": 2.0, "full": 1.0}

#: Elements are smaller by this factor where the blade first touches.
FINER = 4


def geometry(values, numerics) -> Geometry:
    """The block of a case: ``values`` have width, height, length in mm. Raises BadInput for a mesh file."""
    if numerics.mesh is not None:
        raise BadInput(
            key="mesh", value=numerics.mesh, expected="no mesh file: the mesh of a block is made by cutbench"
        )
    part = "quarter" if numerics.symmetry == "auto" else numerics.symmetry
    h = numerics.h_mm
    # Finer under the blade by as much as the plane-strain section, so that the two can be compared.
    mesh = quarter(values["width"], values["height"], values["length"], h, corner=h / FINER)
    return block(mesh, part)


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
    outer = mesh.boundary_facets()
    x, y, z = mesh.p[:, mesh.facets[:, outer]]
    half, height, end = mesh.p.max(axis=1)
    eps = 1e-9 * height
    inside = mesh.p[0, mesh.t[:, mesh.f2t[0, outer]]].mean(axis=0)

    def at(coordinate, value):
        return np.all(np.abs(coordinate - value) < eps, axis=0)

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
