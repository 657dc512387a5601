"""The plane-strain model: half block by symmetry, full split block, or a mesh of the user's."""

from __future__ import annotations

import numpy as np
import skfem

from cutbench.base.errors import BadInput
from cutbench.case.mesh_sizes import near_blade
from cutbench.forms.geometry import Geometry
from cutbench.models2d.section import half_block
from cutbench.models2d.usermesh import read_mesh


def geometry(
    values,
    numerics,
    radius: float = np.inf,
    detail: float = np.inf,
    fine: tuple[float, float] = (0.0, np.inf),
    kept=None,
) -> Geometry:
    """The section of a case: ``values`` have width, height, length in mm. Raises BadInput for a bad mesh.

    ``radius`` of the blade's edge, and finest length at the cut, ``detail``, mm.
    ``fine``: the depths in mm between which a built-in mesh has small elements; ``kept``: places elsewhere.
    """
    length, height = values["length"], values["height"]
    if numerics.symmetry == "quarter":
        expected = "'half', 'full' or 'auto': a quarter is for three dimensions"
        raise BadInput(key="symmetry", value="quarter", expected=expected)
    if numerics.mesh is not None:
        if numerics.symmetry == "full":
            expected = "'half' or 'auto' with a mesh file: it holds the right half"
            raise BadInput(key="symmetry", value="full", expected=expected)
        mesh = read_mesh(numerics.mesh, values["width"], height)
        return Geometry(mesh, height, 2 * length)
    thickness = values["thickness"]
    h, reach = numerics.sizes(thickness).h_mm, numerics.tuning.mesh.reach * thickness / 2
    sizes = {"slender": numerics.slender, **near_blade(numerics, thickness, radius)}
    sizes["largest"] = h * min(1.0, detail / thickness)
    mesh = half_block(values["width"], height, h, reach=reach, fine=fine, kept=kept, **sizes)
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
