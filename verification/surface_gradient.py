"""Waves of a surface that resists gradients: ½ B ∫ |Δ₀φ|² dA is ¼ B k⁴ a² an area, bent or stretched."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import skfem

from cutbench.forms.geometry import Geometry
from cutbench.forms.gradient import GradientForm
from cutbench.forms.space import Space
from cutbench.models2d.plane_strain import mirrored
from cutbench.models2d.section import named
from cutbench.models3d.block import block
from cutbench.run.build import surface_forms
from verification._common import law
from verification.base import Check, Reference

#: Half the width, the height and the length of a block in mm, half waves over the width, elements beside the
#: plane.
HALF, HEIGHT, LENGTH, WAVES, ELEMENTS = 1.0, 1.0, 0.25, 6, 48
G, SURFACE = 0.0075, 0.07
SIZE = 0.05


def pieces() -> Iterator[tuple[str, Space, Geometry, float]]:
    """A split section, and a split block between two mirrors; the area of the top, mm² (in two dimensions per
    mm of length)."""
    x, y = np.linspace(0, HALF, ELEMENTS + 1), np.linspace(0, HEIGHT, 3)
    flat = Geometry(mirrored(named(skfem.MeshTri.init_tensor(x, y), HALF, HEIGHT)), HEIGHT, 1.0, split=True)
    yield "section", Space.build(flat.mesh, 2), flat, 2 * HALF
    solid = block(skfem.MeshTet.init_tensor(x, y, np.linspace(0, LENGTH, 3)), "full")
    solid = replace(solid, held=(("end", 2),))
    yield "block", Space.build(solid.mesh, 2), solid, 4 * HALF * LENGTH


def compute() -> Iterator[Check]:
    p = SimpleNamespace(G=G, thickness=0.7, surface_length=SURFACE)
    k = WAVES * np.pi / (2 * HALF)
    B = G * SURFACE**3 / 3
    for where, space, geometry, area in pieces():
        faces = {name: space.faces(name, 4) for name in geometry.blade_faces}
        made = surface_forms([law("surface_gradient")], space, geometry, faces, True)
        forms = [form for form in made if isinstance(form, GradientForm)]
        wave = SIZE * np.sin(k * (space.X[0] + HALF))
        for what, axis in (("bent", 1), ("stretched unevenly", 0)):
            u = np.zeros((space.X.shape[1], space.dim))
            u[:, axis] = wave
            found = sum(sum(form.stored(u.ravel(), p, form.start(p)).values()) for form in forms) / area
            expected = B * k**4 * SIZE**2 / 4
            yield Check(f"{where}, {what}: energy of a wave", "nJ/mm^2", 1e6 * expected, 1e6 * found, 0.003)


REFERENCE = Reference(
    "surface_gradient",
    "Waves on the top of a section and of a block whose surface has gelatin's G and ℓ = 0.07 mm.",
    "½ B (k² a sin kx)², B = G ℓ³/3, integrated by hand (Steigmann and Ogden 1999)",
    compute,
    laws=("surface_gradient",),
    seconds=1.0,
)
