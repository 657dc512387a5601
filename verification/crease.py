"""A crease: a soft surface squeezed along itself folds in on itself at a strain of 0.354, whatever its depth.

Pressed in at one point, the surface of a block in plane strain meets itself above that point. From a strain
on that point needs no force to stay: the crease is in balance. A half-space has no length, so this strain is
a pure number; without self-contact the surface passes through itself, and there is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import skfem

from cutbench.case.tuning import SelfContactTuning
from cutbench.forms.damping import DampingForm
from cutbench.forms.self_contact import SelfContactForm
from cutbench.solver.newton import NewtonSettings, newton
from cutbench.solver.problem import Problem
from verification._common import DEGREE, bulk_forms, law, space_of, step_at_rest
from verification._strip import energy, graded, transverse
from verification.base import Check, Reference

#: Height of the block and half its width, mm, and depth of the crease: small against both.
H, W, DEPTH = 2.0, 3.0, 0.12
#: Elements are small so far beside the crease and below it, mm.
BESIDE, BELOW = 0.2, 0.06
#: The strain at which it is made, in so many depths, and the steps by which it is taken back.
MADE, STEP, DEPTHS = 0.40, 0.01, 6
#: Drag that lets the surface go over into the crease, in G, one after the other.
DRAGS = (1.0, 0.1, 1e-2, 1e-6)
#: The strain of a half-space in the literature.
CRITICAL = 0.354
#: G in MPa, and ν: nearly incompressible.
P = SimpleNamespace(G=1.0, nu=0.499)


class Block:
    """Squeezed between walls on which it slides, on elements ``fine`` mm wide at the crease."""

    def __init__(self, fine: float):
        self.space = space = space_of(_mesh(fine), "P2")
        forms, ndof = bulk_forms(space, "P2")
        top = space.nodes_on("top")
        top = top[np.argsort(-space.X[0, top])]
        bulk = (law("neo_hookean"), law("volumetric"))
        forms.append(SelfContactForm([top], space.X, bulk, 1.0, SelfContactTuning()))
        forms.append(DampingForm(space.volume(DEGREE["P2"]), P.G))
        tip = top[np.abs(space.X[0, top]).argmin()]
        self._tip = 2 * tip + 1
        walls, bottom = 2 * space.nodes_on("walls"), 2 * space.nodes_on("bottom") + 1
        fixed = np.concatenate([walls, bottom, [2 * tip, self._tip]])
        self.problem = Problem(forms, ndof, fixed, P, pulled=True)
        self._strain, self.u = 0.0, np.zeros(ndof)

    def _flat(self, strain: float) -> np.ndarray:
        X = self.space.X
        return np.stack([-strain * X[0], (transverse(1 - strain, P) - 1) * X[1]]).T.ravel()

    def go(self, strain: float, depth: float, drags=DRAGS) -> float:
        """To a strain with the tip ``depth`` mm below the flat surface; the force that holds it up, N/mm."""
        X, flat = self.space.X, self._flat(strain)
        u = self.u + flat - self._flat(self._strain)
        # What surrounds the tip moves with it.
        down = flat[self._tip] - depth - u[self._tip]
        u[1::2] += down * np.exp(-(X[0] ** 2 + (X[1] - H) ** 2) / (DEPTH / 2) ** 2)
        for drag in drags:
            step = replace(step_at_rest(u), damping_factor=drag)
            u, found, _ = newton(self.problem, u, self.problem.start(), step, NewtonSettings())
        self._strain, self.u = strain, u
        return float(found.residual[self._tip])

    def set_free(self) -> float:
        """Energy that the crease has set free: what the flat surface holds more, mJ/mm."""
        bulk = self.problem.bulk.energies(self.u, P, {})
        return 2 * W * H * energy(1 - self._strain, P) - sum(bulk.values())


def _mesh(fine: float) -> skfem.MeshTri:
    def along(near: float, length: float) -> np.ndarray:
        small = np.linspace(0, near, round(near / fine) + 1)
        return np.append(small, near + graded(fine, length - near)[1:])

    half = skfem.MeshTri.init_tensor(along(BESIDE, W), H - along(BELOW, H)[::-1])
    whole = half + half.mirrored((1.0, 0.0))
    whole = skfem.MeshTri(np.ascontiguousarray(whole.p), np.ascontiguousarray(whole.t))
    return whole.with_boundaries({
        "top": lambda x: np.abs(x[1] - H) < 1e-9,
        "bottom": lambda x: np.abs(x[1]) < 1e-9,
        "walls": lambda x: np.abs(np.abs(x[0]) - W) < 1e-9,
    })  # fmt: skip


def balance(fine: float) -> tuple[float, float]:
    """The strain at which a crease of ``DEPTH`` is in balance, and what it has set free at ``MADE``."""
    block = Block(fine)
    for depth in np.linspace(0, DEPTH, DEPTHS + 1)[1:]:
        force = block.go(MADE, depth)
    free, strain = block.set_free(), MADE
    while True:
        before, strain = force, strain - STEP
        force = block.go(strain, DEPTH, DRAGS[1:])
        if force <= 0 or strain < 0.3:
            return strain + STEP * force / (force - before), free


def compute() -> Iterator[Check]:
    sizes = 0.04, 0.02, 0.01
    strains, free = np.array([balance(fine) for fine in sizes]).T
    for fine, strain in zip(sizes, strains, strict=True):
        yield Check(
            f"strain in balance, elements of 1/{DEPTH / fine:.0f} of the depth", "1", CRITICAL, strain, 0.02
        )
    # At the tip something is as long as an element: errors halve with it.
    limit = 2 * strains[2] - strains[1]
    yield Check("strain in balance, extrapolated", "1", CRITICAL, limit, 0.005)
    coarse, limit = 2 * free[1] - free[0], 2 * free[2] - free[1]
    what, other = f"energy set free at {MADE:g}, extrapolated", "the same from elements twice as large"
    yield Check(what, "mJ/mm", coarse, limit, 0.04, other)


REFERENCE = Reference(
    "crease",
    "A crease in the surface of a block in plane strain: the strain that keeps it, and the energy behind it.",
    "Hong, Zhao, Suo, Appl. Phys. Lett. 95 (2009) 111901; Cai, Chen, Suo, Hayward, Soft Matter 8 (2012) 1301",
    compute,
    laws=("neo_hookean",),
    quick=False,
    seconds=25.0,
)
