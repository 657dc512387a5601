"""A long strip with a cut along its middle, pulled apart between grips on which it slides: pure shear.

The strip is H high (across the cut) and so long that its ends do not matter. Far ahead of the front it
is stretched by λ with nothing holding it along y, far behind it is free of stress. One step of the front
by da then sets free W(λ) H da, whatever the strains: Rivlin and Thomas (1953).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import skfem
from scipy.optimize import brentq

from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.space import Space
from cutbench.solver.newton import NoConvergence
from cutbench.solver.problem import Problem
from verification._common import DEGREE, bulk_forms, law, solve, space_of, step_at_rest

#: Height of the strip, mm, and its parts ahead of the front and behind it in units of the height.
H = 21.0
AHEAD, BEHIND = 3.0, 2.0
#: Growth of the elements away from the front, from one to the next.
GROWTH = 1.25
#: Steps of the grips to the first load, at least.
STEPS = 4


@dataclass(frozen=True)
class Strip:
    """The half x ≥ 0: displacements at the grip are those of the unknowns ``grip``, times λ − 1 and H/2."""

    space: Space
    problem: Problem
    cut: CutForm
    grip: np.ndarray
    front: float


def strip(p, element: str, fine: float, run: float, viscosity: float = 0.0, *, uncut: bool = False) -> Strip:
    """``fine``: elements at the front and over ``run`` ahead of it, mm; ``viscosity`` of the solid, MPa s.

    Behind the front the plane is free; ``uncut``: the cohesive law holds it, but for the pre-cut of ``p``.
    """
    front = AHEAD * H
    across = graded(fine, H / 2)
    ahead = front - run - graded(fine, front - run)[::-1]
    path = np.linspace(front - run, front, int(np.ceil(run / fine)) + 1)
    behind = front + graded(fine, BEHIND * H)
    mesh = skfem.MeshTri.init_tensor(across, np.concatenate([ahead, path[1:], behind[1:]]))
    mesh = mesh.with_boundaries({
        "ahead": lambda x: (np.abs(x[0]) < 1e-9) & (uncut | (x[1] < front)),
        "grip": lambda x: np.abs(x[0] - H / 2) < 1e-9,
        "end": lambda x: np.abs(x[1]) < 1e-9,
    })  # fmt: skip
    space = space_of(mesh, element)
    forms, ndof = bulk_forms(space, element)
    top = (AHEAD + BEHIND) * H
    cut = CutForm((law("smith_ferrante"),), space.faces("ahead", 6), top)
    forms.append(cut)
    if viscosity:
        forms.append(DampingForm(space.volume(DEGREE[element]), viscosity))
    grip = 2 * space.nodes_on("grip")
    problem = Problem(forms, ndof, np.concatenate([grip, 2 * space.nodes_on("end") + 1]), p)
    return Strip(space, problem, cut, grip, front)


def graded(first: float, length: float) -> np.ndarray:
    """Points from 0 to ``length`` whose distances grow from ``first``."""
    n = int(np.ceil(np.log(1 + length / first * (GROWTH - 1)) / np.log(GROWTH)))
    points = np.cumsum(np.concatenate([[0.0], GROWTH ** np.arange(n)]))
    return length * points / points[-1]


def transverse(stretch: float, p) -> float:
    """Stretch along the strip at which nothing pulls there: ∂W/∂λ_y = 0."""
    step = 1e-30
    return brentq(lambda y: energy_of(stretch, y + 1j * step, p).imag / step, 0.5 / stretch, 2.0 / stretch)


def energy_of(x, y, p):
    """W of F = diag(x, y, 1), MPa: G/2 (J^(−2/3) I₁ − 3) + κ/2 (J − 1)²."""
    J = x * y
    kappa = 2 * p.G * (1 + p.nu) / (3 * (1 - 2 * p.nu))
    return p.G / 2 * (J ** (-2 / 3) * (x * x + y * y + 1) - 3) + kappa / 2 * (J - 1) ** 2


def energy(stretch: float, p) -> float:
    """W(λ), MPa: stretched by λ across the cut, free along it, held along the blade."""
    return float(energy_of(stretch, transverse(stretch, p), p))


def opening_ahead(stretch: float, p) -> float:
    """How far the plane yet to be cut gives, mm: T(δ) is the stress of the solid, left with λ − δ/H."""
    step = 1e-6
    stiffness = p.G_c / p.delta_c**2

    def out_of_balance(opening: float) -> float:
        x = stretch - opening / H
        stress = (energy(x + step, p) - energy(x - step, p)) / (2 * step)
        return stiffness * opening * np.exp(-opening / p.delta_c) - stress

    return brentq(out_of_balance, 0.0, p.delta_c, xtol=1e-14)


def held_ahead(stretch: float, p) -> float:
    """Energy per area that this plane holds, mJ/mm²."""
    s = opening_ahead(stretch, p) / p.delta_c
    return p.G_c * (-np.expm1(-s) - s * np.exp(-s))


def release(stretch: float, p) -> float:
    """What a step of the front sets free per area, mJ/mm²: W H, and what the plane ahead holds."""
    return energy(stretch - opening_ahead(stretch, p) / H, p) * H + held_ahead(stretch, p)


def stretch_for(spent: float, p) -> float:
    """λ at which the release is ``spent`` (mJ/mm²)."""
    # An incompressible strip would have (λ − 1/λ)² G H/2; twice its strain is more than enough.
    half = np.sqrt(spent / (2 * p.G * H))
    most = 1 + 2 * (half + np.hypot(half, 1) - 1)
    return brentq(lambda x: release(x, p) - spent, 1 + 1e-6, most, xtol=1e-12)


def homogeneous(strip: Strip, stretch: float) -> np.ndarray:
    """Displacements of the uncut strip, as a guess."""
    p, X = strip.problem.p, strip.space.X
    u = np.zeros(strip.problem.ndof)
    u[0 : strip.space.ndof : 2] = (stretch - 1) * X[0]
    u[1 : strip.space.ndof : 2] = (transverse(stretch, p) - 1) * np.minimum(X[1], strip.front)
    return u


def pulled(strip: Strip, parts: Sequence[float]) -> Iterator[tuple[np.ndarray, dict]]:
    """Pull slowly until the release is each of ``parts`` of G_c, all below 1: unknowns and states there."""
    problem, p = strip.problem, strip.problem.p
    u, states, before, last = np.zeros(problem.ndof), problem.start(), None, 1.0
    size = (stretch_for(parts[0] * p.G_c, p) - 1) / STEPS
    for part in parts:
        goal = stretch_for(part * p.G_c, p)
        while last < goal - 1e-12:
            stretch = min(last + size, goal)
            # The last step's change again, or the uncut strip's.
            again = 0.0 if before is None else (stretch - last) / (last - before[1])
            guess = homogeneous(strip, stretch) if before is None else u + again * (u - before[0])
            guess[strip.grip] = (stretch - 1) * H / 2
            try:
                new, result = solve(problem, guess, states, step_at_rest(u))
            except NoConvergence:
                size /= 2
                if size < 1e-3 * (goal - 1):
                    raise
                continue
            before, last, u, states = (u, last), stretch, new, result.states
        yield u, states


def process_zone(p) -> float:
    """4 G G_c/σ_c², mm."""
    return 4 * p.G * p.G_c / (p.G_c / (math.e * p.delta_c)) ** 2
