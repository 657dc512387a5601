"""A smooth rigid punch on a block large enough to be a half-space, through the form of the blade."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import skfem
from scipy.integrate import quad

from cutbench.forms.base import Step
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.mechanisms.blade._rigid import SKIN
from cutbench.models2d.section import named
from cutbench.solver.problem import Problem
from verification._common import bulk_forms, law, parameters, solve, space_of

#: Block, in half-widths of the contact: the half-space's fields have decayed as the inverse of it.
BLOCK = 1000.0
#: Elements across half the contact.
ACROSS = 24
#: Depth below the contact to which its approach is measured, in half-widths.
DEPTH = 10.0
#: The penalty grows by a factor in so many stages.
STIFFEN, STAGES = 6.0, 6
STEPS = 6
#: Growth of the elements with the distance from the contact.
GROWTH = 0.3


@dataclass(frozen=True)
class Indented:
    """What a punch came to, per mm of length: force in N, pressure in MPa at x in mm, approach in mm.

    Arrays are (nq, faces). With a stiff penalty the pressure oscillates within a face (more points press
    than nodes can answer), so it is compared face by face.
    """

    force: float
    x: np.ndarray
    pressure: np.ndarray
    weight: np.ndarray
    approach: float
    depth: float
    modulus: float  # E/(1 − ν²)
    nu: float

    @property
    def half_width(self) -> float:
        """c from the second moment of the pressure given its shape is √(c² − x²): 4 ∫p x²/∫p."""
        p = self.weight * self.pressure
        return float(2 * np.sqrt((p * self.x**2).sum() / p.sum()))

    def by_face(self, values: np.ndarray) -> np.ndarray:
        return (self.weight * values).sum(axis=0) / self.weight.sum(axis=0)

    def misfit(self, expected: Callable[[np.ndarray], np.ndarray]) -> float:
        """Root mean square of the error of the faces' pressures over that of the pressures."""
        w, e = self.weight.sum(axis=0), self.by_face(expected(self.x))
        return float(np.sqrt(w @ (self.by_face(self.pressure) - e) ** 2 / (w @ e**2)))


def indented(half_thickness: float, tip: float, contact: float, travel: float) -> Indented:
    """Press an elliptic punch by ``travel`` into a block meshed for a contact of half-width ``contact``."""
    slope = contact * tip / half_thickness**2
    p = parameters("gelatin", thickness=2 * half_thickness, tip=tip)
    return pressed("contact", p, contact, travel, slope)


def pressed(tool: str, p, contact: float, travel: float, slope: float) -> Indented:
    """Press the punch ``tool`` by ``travel`` into a block meshed for a contact of half-width ``contact``, at
    whose end the punch has about the ``slope``.

    Elements are quadratic, the load frictionless, the penalty so stiff that its give does not count: the
    rounding of contact then makes the punch thicker by its skin, all round.
    """
    size = BLOCK * contact
    mesh = half_space(size, contact)
    space = space_of(mesh, "P2")
    forms, ndof = bulk_forms(space, "P2", size)
    modulus = 2 * p.G / (1 - p.nu)
    skin = SKIN * p.thickness / 2
    # p = ε (depth + skin)²/(4 skin): let the largest pressure give less than a 500th of the indentation.
    shallow, strain = contact * slope / 2, slope / 2
    penalty = 4 * skin * strain * modulus / (shallow / 500) ** 2
    face = space.faces("top", 6)
    soft = ContactNumerics(penalty / STIFFEN**STAGES, 1.0)
    blade = BladeForm((law(tool),), face, soft, keep_touched=[], height=size)
    bottom, middle = space.nodes_on("bottom"), space.nodes_on("cut")
    problem = Problem([*forms, blade], ndof, np.concatenate([2 * bottom, 2 * bottom + 1, 2 * middle]), p)
    u, states = np.zeros(ndof), problem.start()
    centre = np.array([0.0, size + skin, 0.0])
    # Down first, against a soft penalty; nothing remembers the way, so a stiffer one can follow in place.
    for part in np.arange(1, STEPS + 1) / STEPS:
        # From a guess that is clear of the punch, so that its sides are never met.
        u[1 : space.ndof : 2] -= travel / STEPS * space.X[1] / size
        u, _ = solve(problem, u, states, still(u, centre - [0.0, part * travel, 0.0]))
    for stage in range(1, STAGES + 1):
        problem.forms[-1] = blade.with_numerics(replace(soft, stiffness=soft.stiffness * STIFFEN**stage))
        u, result = solve(problem, u, states, still(u, centre - [0.0, travel, 0.0]))
    states = result.states
    state = states[blade.name]
    far = DEPTH * contact
    below = middle[np.abs(space.X[1, middle] - (size - far)).argmin()]
    top = middle[space.X[1, middle].argmax()]
    touching = face.X[0].max(axis=0) < 3 * contact
    return Indented(
        force=2 * float(blade.force(state)[1]),
        x=face.X[0][:, touching],
        pressure=state["pressure"][:, touching],
        weight=face.w[:, touching],
        approach=float(u[2 * below + 1] - u[2 * top + 1]),
        depth=float(size - space.X[1, below]),
        modulus=modulus,
        nu=p.nu,
    )


def still(u: np.ndarray, centre: np.ndarray) -> Step:
    return Step(1.0, u.copy(), centre, centre)


def half_space(size: float, contact: float) -> skfem.MeshTri:
    """Right half of a block 2 size × size: fine within 1.5 half-widths of the contact, growing beyond."""
    line = np.linspace(0, size, 5)
    mesh = skfem.MeshTri.init_tensor(line, line)
    fine = contact / ACROSS
    while True:
        corners = mesh.p[:, mesh.t]
        x, below = corners[0].min(axis=0), size - corners[1].max(axis=0)
        away = np.hypot(np.maximum(x - 1.5 * contact, 0), below)
        marked = np.flatnonzero(np.ptp(corners, axis=1).max(axis=0) > fine + GROWTH * away)
        if marked.size == 0:
            return named(mesh, size, size)
        mesh = mesh.refined(marked)


def approach(pressure: Callable[[float], float], c: float, depth: float, modulus: float, nu: float) -> float:
    """Shortening of the axis from the surface to ``depth`` under p(x) on |x| < c of a half-space, mm.

    Flamant's stresses on the axis, integrated: σ_z = −2/π ∫ p z³/(s² + z²)² ds, σ_x with s² z.
    """
    # s = z tan φ turns ∫ p z³/(s²+z²)² ds into ∫ p cos²φ dφ and ∫ p s² z/(s²+z²)² ds into ∫ p sin²φ dφ.
    angle, weight = np.polynomial.legendre.leggauss(400)

    def strain(z: float) -> float:
        end = np.arctan(c / z)
        phi = end * (angle + 1) / 2
        p = np.array([pressure(s) for s in np.minimum(z * np.tan(phi), c)]) * weight * end / 2
        sz, sx = -4 / np.pi * (p @ np.cos(phi) ** 2), -4 / np.pi * (p @ np.sin(phi) ** 2)
        return -(sz - nu / (1 - nu) * sx) / modulus

    # Logarithmic in depth.
    return quad(lambda t: strain(np.exp(t)) * np.exp(t), np.log(1e-6 * c), np.log(depth), epsrel=1e-7)[0]
