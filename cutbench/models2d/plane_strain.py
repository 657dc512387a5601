"""The plane-strain model: half block by symmetry, full split block, or a mesh of the user's."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import skfem

from cutbench.errors import BadInput
from cutbench.models2d.section import half_block
from cutbench.solve.geometry import Geometry

#: Names that a user's mesh must give to its boundary lines.
NEEDED = ("cut", "top", "bottom")


def geometry(values, numerics) -> Geometry:
    """The section of a case: ``values`` have width, height, length in mm. Raises BadInput for a bad mesh."""
    length, height = values["length"], values["height"]
    if numerics.symmetry == "quarter":
        raise BadInput(
            key="symmetry", value="quarter", expected="'half', 'full' or 'auto': a quarter is for three dimensions"
        )
    if numerics.mesh is not None:
        mesh = read_mesh(numerics.mesh, height)
        return Geometry(mesh, height, 2 * length)
    mesh = half_block(values["width"], height, numerics.h_mm, corner=numerics.h_mm / 4)
    if numerics.symmetry == "full":
        return Geometry(mirrored(mesh), height, length, split=True)
    return Geometry(mesh, height, 2 * length)


def mirrored(half: skfem.MeshTri) -> skfem.MeshTri:
    """Both halves, not joined on the cut plane: faces "cut" (right) and "cut_minus" (left)."""
    n = half.p.shape[1]
    p = np.hstack([half.p, half.p * np.array([[-1.0], [1.0]])])
    mesh = skfem.MeshTri(p, np.hstack([half.t, half.t + n]))
    centre = mesh.p[:, mesh.facets].mean(axis=1)
    side = mesh.p[0, mesh.t[:, mesh.f2t[0]]].mean(axis=0)
    outer = mesh.f2t[1] == -1
    height = half.p[1].max()
    eps = 1e-9 * height
    on_cut = outer & (np.abs(centre[0]) < eps)
    return mesh.with_boundaries(
        {
            "cut": np.flatnonzero(on_cut & (side > 0)),
            "cut_minus": np.flatnonzero(on_cut & (side < 0)),
            "top": np.flatnonzero(outer & (np.abs(centre[1] - height) < eps)),
            "bottom": np.flatnonzero(outer & (np.abs(centre[1]) < eps)),
        }
    )


def read_mesh(path: str, height: float) -> skfem.MeshTri:
    """A right half section in mm from any file that meshio reads, with named lines cut, top and bottom.

    Raises BadInput if it cannot be read, has no triangles, lacks a name, or its lines are not where
    the names say: cut at x = 0, bottom at y = 0, top at y = height, everything else at x > 0.
    """
    def refuse(value, expected):
        return BadInput(file=str(path), key="mesh", value=value, expected=expected)

    try:
        raw = meshio.read(Path(path))
    except SystemExit as error:  # meshio leaves by sys.exit on formats that it does not know
        raise refuse(Path(path).suffix, "a mesh format that meshio reads, such as .msh or .vtu") from error
    except Exception as error:
        raise refuse(str(error) or type(error).__name__, "a mesh file that meshio can read") from error
    if "triangle" not in raw.cells_dict:
        kinds = ", ".join(raw.cells_dict) or "nothing"
        raise refuse(kinds, "three-node triangles (quadratic displacements are added by cutbench)")
    try:
        mesh = skfem.io.from_meshio(raw)
    except Exception as error:
        raise refuse(str(error), "a plane mesh of triangles with named lines") from error
    if mesh.dim() != 2:
        raise refuse(f"{mesh.dim()} dimensions", "a plane mesh (x, y)")
    names = set(mesh.boundaries or {})
    if missing := [name for name in NEEDED if name not in names]:
        found = ", ".join(sorted(names)) or "none"
        raise refuse(f"lines named: {found}", f"lines named {', '.join(NEEDED)} ({', '.join(missing)} missing)")
    if mesh.p[0].min() < -1e-6:
        raise refuse(f"x down to {mesh.p[0].min():g} mm", "the right half of the block, x >= 0")
    for name, axis, where in (("cut", 0, 0.0), ("bottom", 1, 0.0), ("top", 1, height)):
        at = mesh.p[axis, mesh.facets[:, mesh.boundaries[name]]]
        worst = np.abs(at - where).max(initial=0.0)
        if at.size == 0 or worst > 1e-6 * max(height, 1.0):
            letter = "xy"[axis]
            raise refuse(f"line '{name}' off by {worst:g} mm", f"line '{name}' at {letter} = {where:g} mm")
    return mesh
