"""Cook's membrane: what other elements lose near incompressibility, and that the mixed one does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import skfem

from cutbench.solver.newton import NewtonSettings, newton
from cutbench.solver.problem import Problem
from verification._common import DeadLoad, bulk_forms, nu_of, space_of, step_at_rest
from verification.base import Check, Reference

G = 80.1938  # MPa
KAPPA = 400942.0
TRACTION = 6.25
#: Newton's method as it is in books: the limits that suit a cut are in the way of steps of millimetres.
FREELY = NewtonSettings(tolerance=1e-9, reach=np.inf, trust=np.inf, slack=np.inf)


@dataclass(frozen=True)
class Membrane:
    """What a membrane came to: the corner's displacement, effort, work of the load, stored energy by law."""

    tip_mm: float
    iterations: int
    work_mJ: float
    stored_mJ: dict[str, float]


def mesh(n: int, graded: bool = False) -> skfem.MeshTri:
    """n × n quadrilaterals cut in two on the trapezoid (0,0), (48,44), (48,60), (0,44) mm.

    ``graded``: finer towards the ends of the clamped edge, where the stress is singular.
    """
    line = np.linspace(0, 1, n + 1)
    across, up = (line**3, 3 * line**2 - 2 * line**3) if graded else (line, line)
    unit = skfem.MeshTri.init_tensor(across, up)
    s, t = unit.p
    shaped = skfem.MeshTri(np.stack([48 * s, 44 * s + t * (44 + (16 - 44) * s)]), unit.t)
    return shaped.with_boundaries({"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 48 - 1e-9})


def membrane(
    n: int, element: str, nu: float, *, solver: str = "auto", loads: int = 4, graded: bool = False
) -> Membrane:
    """The membrane clamped on the left under a dead shear traction of 6.25 MPa on the right, 1 mm thick."""
    space = space_of(mesh(n, graded), element)
    forms, ndof = bulk_forms(space, element, 60.0, 4)
    right = space.faces("right", 4)
    force = np.zeros((2, *right.nodes.shape))
    force[1] = TRACTION * np.einsum("qaf,qf->af", right.N, right.w)
    load = DeadLoad(right.nodes, force)
    left = space.nodes_on("left")
    fixed = np.concatenate([2 * left, 2 * left + 1])
    problem = Problem([*forms, load], ndof, fixed, SimpleNamespace(G=G, nu=nu), solver=solver)
    total = np.zeros(ndof)
    np.add.at(total, load.dofs, force.reshape(load.dofs.shape))
    u, most, work, before = np.zeros(ndof), 0, 0.0, 0.0
    stored = {law.name: 0.0 for form in forms for law in form.laws}
    for part in np.arange(1, loads + 1) / loads:
        step, load.loaded = step_at_rest(u), part
        u, _, iterations = newton(problem, u, problem.start(), step, FREELY)
        most = max(most, iterations)
        work += (before + part) / 2 * total @ (u - step.u_old)
        before = part
        for form in forms:
            for name, energy in form.work(u, problem.p, {}, {}, step).items():
                stored[name] += energy
    corner = np.flatnonzero(np.hypot(space.X[0] - 48, space.X[1] - 60) < 1e-9)
    return Membrane(float(u[2 * corner[0] + 1]), most, float(work), stored)


def compute() -> Iterator[Check]:
    same = "an independent implementation, same mesh"
    for element, tip in (("P1", 5.508), ("P2", 6.981), ("P2P1", 7.009)):
        got = membrane(32, element, 0.49).tip_mm
        yield Check(f"tip u_y, ν = 0.49, n = 32, {element}", "mm", tip, got, 1e-4, same)
    got = membrane(32, "P2P1", nu_of(KAPPA / G)).tip_mm
    literature = "literature, 6.89 to 6.90 mm: its upper end"
    yield Check("tip u_y, κ = 400,942 MPa, n = 32, P2P1", "mm", 6.90, got, 1e-3, literature)


REFERENCE = Reference(
    "cook",
    "Cook's membrane in plane strain, G = 80.1938 MPa, dead shear traction of 6.25 MPa.",
    "benchmark of Cook (1974), finite strain as in Simo and Armero (1992)",
    compute,
    laws=("neo_hookean", "volumetric"),
    seconds=6.0,
)
