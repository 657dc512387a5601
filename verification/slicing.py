"""An elastic slab on a rigid base, rubbed by the band of a blade that goes down and along its edge.

The slab is held where it is but along the blade, so that it is sheared alike all over: where it slides, the
friction μ p has the direction of the blade's way, and its part along the blade, μ p ξ/√(1 + ξ²), shears a
slab of thickness w that is squeezed to λ by u_z = τ w λ^(2/3)/G.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import skfem

from cutbench.forms.base import Step
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.forms.prisms import Sheared
from cutbench.models2d.section import named
from cutbench.solver.problem import Problem
from verification._common import bulk_forms, law, parameters, solve, space_of
from verification.base import Check, Reference

#: Height and thickness of the slab, mm; how deep the blade is in it; friction; contact stiffnesses, MPa/mm.
HEIGHT, WIDE, DEPTH, MU = 1.0, 0.8, 0.03, 0.25
NORMAL, STICK = 80.0, 40.0
#: Ways of the blade down in all, mm, and steps.
DOWN, STEPS = 4.0, 40


def compute() -> Iterator[Check]:
    for element in ("P1", "P2"):
        for ratio in (0.5, 2.0):
            yield from rubbed(element, ratio)


def rubbed(element: str, ratio: float) -> Iterator[Check]:
    p = parameters("gelatin", mu=MU, slice_push=ratio)
    line = np.linspace(0, WIDE, 4), np.linspace(0, HEIGHT, 4)
    flat = space_of(named(skfem.MeshTri.init_tensor(*line), WIDE, HEIGHT), element)
    space = Sheared.over(flat)
    forms, ndof = bulk_forms(space, element)
    numerics, laws = ContactNumerics(NORMAL, STICK), (law("contact"), law("coulomb"))
    blade = BladeForm(laws, space.faces("cut", 6), numerics, keep_touched=["cut"], height=HEIGHT)
    every, held = np.arange(space.X.shape[1]), space.nodes_on("side")
    fixed = np.concatenate([every * 3 + 1, *(held * 3 + i for i in range(3))])
    problem = Problem([*forms, blade], ndof, np.unique(fixed), p)
    u, states = np.zeros(ndof), problem.start()
    ways = np.linspace(0, DOWN, STEPS + 1)
    for before, now in pairwise(ways):
        # The band, a beside the blade's mid-plane, is in the slab by the depth from the start.
        there, then = (np.array([DEPTH - p.thickness / 2, -5.0 - way, ratio * way]) for way in (now, before))
        states = problem.touched(states)
        u, found = solve(problem, u, states, Step(1.0, u, there, then))
        states = found.states
    face, root = space.nodes_on("cut"), np.hypot(1, ratio)
    pressure = states["blade"]["pressure"].mean()
    squeezed = 1 - u[3 * face].mean() / WIDE
    expected = MU * pressure * ratio / root * WIDE * squeezed ** (2 / 3) / p.G
    what = f"{element}, ξ = {ratio:g}"
    yield Check(f"{what}: u_z of the rubbed face", "mm", expected, u[3 * face + 2].mean(), 1e-3)
    up, along = blade.force(states["blade"])[1:] / HEIGHT
    yield Check(f"{what}: friction up, μ p/√(1 + ξ²)", "kPa", 1e3 * MU * pressure / root, 1e3 * up, 1e-3)
    shear = 1e3 * MU * pressure * ratio / root
    yield Check(f"{what}: friction along the blade, μ p ξ/√(1 + ξ²)", "kPa", shear, -1e3 * along, 1e-3)


REFERENCE = Reference(
    "slicing",
    "A rigid blade that slides down and along its edge rubs an elastic slab.",
    "simple shear of a neo-Hookean slab",
    compute,
    laws=("neo_hookean", "coulomb"),
    seconds=0.5,
)
