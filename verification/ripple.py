"""A ripple pressed into soft ground: what surface tension and a film on the top take of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import skfem

from cutbench.forms.geometry import Geometry
from cutbench.forms.space import Space
from cutbench.run.build import surface_forms
from cutbench.solver.problem import Problem
from verification._common import DeadLoad, bulk_forms, law, parameters, solve, step_at_rest
from verification.base import Check, Reference

#: Half of a wave, mm; G in MPa, Poisson's ratio; wave number times the amplitude on bare ground.
HALF, G, NU, SMALL = 1.0, 0.01, 0.3, 1e-3
K = np.pi / HALF
#: Stiffness of the surface against the ripple over that of the ground.
STIFF = 4.0
#: Elements along half of the wave, by dimension.
ELEMENTS = {2: 24, 3: 12}


def compute() -> Iterator[Check]:
    # Under a pressure p cos kx a half-space gives way by p/(G k/(1 − ν)), a surface by p/(γ k² + B k⁴).
    ground = G * K / (1 - NU)
    for dim in (2, 3):
        space, geometry = slab(dim)
        bare = amplitude(space, geometry, ground)
        yield Check(f"{dim}D, bare: amplitude", "um", 1e3 * SMALL / K, 1e3 * bare, 0.002)
        for name, values in (
            ("surface_tension", {"gamma_s": STIFF * ground / K**2}),
            ("bending_skin", {"skin_bending": STIFF * ground / K**4}),
            ("film", {"film_bending": STIFF * ground / K**4}),
        ):
            found = amplitude(space, geometry, ground, name, **values)
            yield Check(f"{dim}D, {law(name).title}: part of it", "1", 1 / (1 + STIFF), found / bare, 0.004)


def slab(dim: int) -> tuple[Space, Geometry]:
    """From a crest, at the cut plane, to a trough, three such lengths deep; in space between two planes."""
    x = np.linspace(0, HALF, ELEMENTS[dim] + 1)
    y = 3 * HALF * (1 - np.linspace(1, 0, ELEMENTS[dim] + 1) ** 2)
    held = (("far", 0), ("middle", 2), ("end", 2))[: 1 if dim == 2 else 3]
    faces = {
        "cut": lambda X: X[0] < 1e-9,
        "far": lambda X: X[0] > HALF - 1e-9,
        "bottom": lambda X: X[1] < 1e-9,
        "top": lambda X: X[1] > 3 * HALF - 1e-9,
    }
    if dim == 2:
        mesh = skfem.MeshTri.init_tensor(x, y)
    else:
        mesh = skfem.MeshTet.init_tensor(x, y, np.linspace(0, 2 * x[1], 3))
        faces |= {"middle": lambda X: X[2] < 1e-9, "end": lambda X: X[2] > 2 * x[1] - 1e-9}
    geometry = Geometry(mesh.with_boundaries(faces), 3 * HALF, 1.0, held)
    return Space.build(geometry.mesh, 2), geometry


def amplitude(space: Space, geometry: Geometry, ground: float, name: str = "", **values: float) -> float:
    """Of the ripple, mm, with the surface law ``name``."""
    dim, X = space.dim, space.X
    p = parameters("gelatin", G=G, nu=NU, **values)
    faces = {face: space.faces(face, 4) for face in geometry.blade_faces}
    forms, ndof = bulk_forms(space, "P2", geometry.height)
    forms += surface_forms([law(name)] if name else [], space, geometry, faces, opens=True)
    top = faces["top"]
    push = ground * SMALL / K * np.cos(K * top.X[0]) * top.w
    force = np.zeros((dim, *top.nodes.shape))
    force[1] = np.einsum("qaf,qf->af", top.N, push)
    forms.append(DeadLoad(top.nodes, force))
    clamped = space.nodes_on("bottom")[:, None] * dim + np.arange(dim)
    held = [space.nodes_on(face) * dim + i for face, i in (*geometry.held, ("cut", 0))]
    problem = Problem(forms, ndof, np.unique(np.concatenate([clamped.ravel(), *held])), p)
    start = np.zeros(ndof)
    u = solve(problem, start, problem.start(), step_at_rest(start), tolerance=1e-10)[0].reshape(-1, dim)
    on_top = space.nodes_on("top")
    crest, trough = (u[on_top[np.abs(X[0, on_top] - x) < 1e-9], 1].mean() for x in (0.0, HALF))
    return (crest - trough) / 2


REFERENCE = Reference(
    "ripple",
    "A small ripple in soft ground: a surface of its own leaves 1/(1 + (1 − ν)(γ k + B k³)/G) of it.",
    "linear elasticity of a half-space (Johnson, Contact Mechanics, 1985, §13.2) and of its surface",
    compute,
    laws=("surface_tension", "bending_skin", "film"),
    seconds=6.0,
)
