"""Debonding of two inclusions: the interface forms against DOLFINx, on the same mesh, point by point.

The plate, its mesh (inclusions.npz: gmsh 4.15, size 0.02 mm, straight sides), its law and its fixed-point
scheme are those of the tour "Cohesive zone modeling restricted to an interface" of Bleyer's comet-fenicsx.
The tour's law differs from the product's in three things, which are undone around the product's law:
sliding is weighted in δ only, not in T; closing is damaged as opening is; damage is interpolated linearly
between the ends of each facet.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from importlib import resources
from types import SimpleNamespace

import numpy as np
import skfem

from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.forms.geometry import paired
from cutbench.forms.space import Space
from cutbench.mechanisms.base import Bulk, Cut
from cutbench.solver.problem import Problem
from verification._common import law, solve, step_at_rest
from verification.base import Check, Reference

G_C, SIGMA_C, BETA = 0.5, 50.0, 2.0
#: Young's modulus in MPa and Poisson's ratio of matrix and inclusions.
MATRIX, INCLUSIONS = (3.09e3, 0.25), (10e3, 0.4)
STEP_MM, STEPS = 1e-3, 40
#: Change of damage (root mean square over the interface's length, as in the tour) that ends a step.
STANDSTILL = 1e-4
#: Facet quadrature: exact for linear damage times linear jump times linear test function.
DEGREE = 4
FORCE = {5: 9.520, 10: 17.966, 16: 24.382, 17: 16.244, 23: 9.830, 40: 13.961}


class LinearElastic(Bulk):
    """σ = λ tr ε + 2 μ ε at small strain, each body with its own constants; not for finite rotations."""

    name = "linear_elastic"

    def __init__(self, young: float, nu: float):
        self._mu, self._lame = young / (2 * (1 + nu)), young * nu / ((1 + nu) * (1 - 2 * nu))

    def stress(self, F, p, state, at):
        one = np.eye(3)[:, :, None]
        strain = (F + F.transpose(1, 0, 2)) / 2 - one
        return 2 * self._mu * strain + self._lame * np.trace(strain) * one, {}


class TourLaw(Cut):
    """The tour's law around the product's."""

    name, role = "tour_law", "cohesive"

    def __init__(self, inner: Cut, along: np.ndarray):
        """``along`` (nq,): where the quadrature points lie on a facet, 0 to 1, both ends among them."""
        self._inner, self._along = inner, along

    def start(self, n, p):
        return self._inner.start(n, p)

    def traction(self, jump, p, state, at):
        side = np.where(jump[0].real < 0, -1.0, 1.0)
        T, state = self._inner.traction(np.stack([side * jump[0], jump[1], jump[2]]), p, state, at)
        # Opening at T's weight, sliding without β², and damage from the ends of the facet.
        kept = 1 - state["damage"]
        ends = kept.reshape(self._along.size, -1)
        linear = (1 - self._along)[:, None] * ends[0] + self._along[:, None] * ends[-1]
        return np.stack([side * T[0], T[1] / p.beta**2, T[2] / p.beta**2]) * (linear.ravel() / kept), state


def plate() -> tuple[skfem.MeshTri, np.ndarray]:
    """The mesh with both sides of each interface apart, and which triangles are inclusions (ne,)."""
    with (resources.files(__package__) / "inclusions.npz").open("rb") as file, np.load(file) as stored:
        points, triangles, part = stored["points_mm"], stored["triangles"].astype(int), stored["part"]
    inside = part > 1
    t = np.empty_like(triangles)
    p: list[np.ndarray] = []
    for body in (~inside, inside):
        used, number = np.unique(triangles[body], return_inverse=True)
        t[body] = number.reshape(-1, 3) + sum(map(len, p))
        p.append(points[used])
    mesh = skfem.MeshTri(np.ascontiguousarray(np.vstack(p).T), np.ascontiguousarray(t.T))
    outer = np.flatnonzero(mesh.f2t[1] == -1)
    x, y = mesh.p[:, mesh.facets[:, outer]]
    circles = ((0.4, 0.0), (0.6, 0.5))
    on_circle = np.any([np.abs(np.hypot(x - a, y - b) - 0.25).max(axis=0) < 1e-9 for a, b in circles], axis=0)
    of_inclusion = inside[mesh.f2t[0, outer]]
    named = {
        "inner": on_circle & of_inclusion, "outer": on_circle & ~of_inclusion,
        "left": x.max(axis=0) < 1e-9, "right": x.min(axis=0) > 1 - 1e-9,
    }  # fmt: skip
    return mesh.with_boundaries({name: outer[which] for name, which in named.items()}), inside


def curve() -> np.ndarray:
    """Force in N per mm of thickness at each of the steps (STEPS,)."""
    mesh, inside = plate()
    space = Space.build(mesh, 1)
    volume = space.volume(1)
    halves = ((MATRIX, ~inside), (INCLUSIONS, inside))
    bodies = [BulkForm((LinearElastic(*known),), volume.some(which), 1.0) for known, which in halves]
    bodies[1].name = "inclusions"
    plus, minus = space.faces("inner", DEGREE), space.faces("outer", DEGREE)
    ends = space.X[:, plus.nodes]
    along = (plus.X[:, :, 0] - ends[:, 0, 0, None]).T @ (ends[:, 1, 0] - ends[:, 0, 0])
    along = np.abs(along - along[0]) / np.ptp(along)
    shear = MATRIX[0] / (2 * (1 + MATRIX[1]))
    p = SimpleNamespace(G=shear, G_c=G_C, delta_c=G_C / SIGMA_C / math.e, beta=BETA)
    cut = CutForm((TourLaw(law("smith_ferrante"), along),), plus, 1.0, paired(plus, minus, space.X))
    left, right = space.nodes_on("left"), space.nodes_on("right")
    fixed = np.concatenate([2 * left, 2 * left + 1, 2 * right, 2 * right + 1])
    problem = Problem([*bodies, cut], space.ndof, fixed, p)
    u, states, force = np.zeros(space.ndof), problem.start(), []
    for i in range(1, STEPS + 1):
        step = step_at_rest(u)
        u[2 * right] = i * STEP_MM
        u, states["cohesion"], pull = fixed_point(problem, cut, u, states, step, right)
        force.append(pull)
    return np.array(force)


def fixed_point(problem: Problem, cut: CutForm, u, states: dict, step, right):
    """Displacements at fixed damage and damage at fixed displacements in turn, until damage stands still."""
    held, w = states["cohesion"], cut.faces.w.ravel()
    for _ in range(200):
        still = replace(step, damage_held=True)
        u, result = solve(problem, u, {**states, "cohesion": held}, still)
        new = problem.evaluate(u, states, step).states["cohesion"]
        change = np.sqrt(w @ (new["damage"] - held["damage"]) ** 2) / w.sum()
        held = new
        if change < STANDSTILL:
            return u, held, float(result.residual[2 * right].sum())
    raise ArithmeticError("the fixed-point iteration does not stand still")


def compute() -> Iterator[Check]:
    force = curve()
    notes = {16: ", peak", 17: ", after the snap", 23: ", minimum"}
    for i, reference in FORCE.items():
        what = f"force at {i * STEP_MM:.3f} mm{notes.get(i, '')}"
        yield Check(what, "N", reference, force[i - 1], 2e-4)
    top, bottom = force.argmax() + 1, force[16:].argmin() + 17
    yield Check("displacement at the peak", "mm", 0.016, top * STEP_MM, 1e-9)
    yield Check("displacement at the minimum after it", "mm", 0.023, bottom * STEP_MM, 1e-9)


REFERENCE = Reference(
    "inclusions",
    "A plate with two inclusions that debond: G_c = 0.5 N/mm, σ_c = 50 MPa, β = 2, h = 0.02 mm, P1.",
    "DOLFINx run of Bleyer's comet-fenicsx tour 'Cohesive zone modeling restricted to an interface'",
    compute,
    laws=("smith_ferrante",),
    seconds=7.0,
)
