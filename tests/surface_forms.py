"""What tests of forms of the surface share: a block with its top and its cut plane, whole or split, and its
forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import skfem

from cutbench.forms.geometry import Geometry
from cutbench.forms.space import Space
from cutbench.mechanisms import registry
from cutbench.models2d.plane_strain import mirrored as both_sides
from cutbench.models2d.section import named
from cutbench.models3d.block import block
from cutbench.run.build import surface_forms

P = SimpleNamespace(
    G=0.02, thickness=0.7, gamma_s=0.03, skin_bending=2e-3, film_bending=3e-3, surface_length=0.5
)
SIZE, HEIGHT, LENGTH = 1.0, 2.0, 0.6


def piece(dim: int, order: int, part: str = "half", nx: int = 4) -> tuple[Space, Geometry]:
    """x from 0, or from −1 in the whole one, to 1 and y from 0 to 2 (z from 0 to 0.6), of unequal
    elements."""
    x, y = SIZE * np.linspace(0, 1, nx + 1) ** 1.5, np.linspace(0, HEIGHT, nx + 1)
    if dim == 2:
        mesh = named(skfem.MeshTri.init_tensor(x, y), SIZE, HEIGHT)
        geometry = Geometry(both_sides(mesh) if part == "full" else mesh, HEIGHT, 1.0, split=part == "full")
    else:
        geometry = block(skfem.MeshTet.init_tensor(x, y, np.linspace(0, LENGTH, nx // 2 + 2)), part)
    return Space.build(geometry.mesh, order), geometry


def forms(space: Space, geometry: Geometry, *names: str, opens: bool = True) -> list:
    faces = {name: space.faces(name, 4) for name in geometry.blade_faces}
    return list(surface_forms([registry()[name] for name in names], space, geometry, faces, opens))


def moved(space: Space, to) -> np.ndarray:
    """Displacements (ndof,) that take each place X (dim, n) to ``to(X)``."""
    return (np.asarray(to(space.X)) - space.X).T.ravel()


def begun(form, space: Space, damage: float) -> dict:
    """A state of ``form`` where all of the cut plane has the ``damage``."""
    n = space.faces("cut", 4).w.size
    state = form.start(P)
    return form.begun(form.begun(state, np.full(n, damage)), np.full(n, damage))


def energy(found: list, space: Space, u: np.ndarray, damage: float = 0.0) -> float:
    return sum(sum(form.stored(u, P, begun(form, space, damage)).values()) for form in found)
