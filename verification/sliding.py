"""Sliding on the blade: pressure of a given indentation, sticking, slipping, turning round."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import skfem

from cutbench.forms.base import Step
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.models2d.section import named
from cutbench.models3d.block import block
from cutbench.models3d.mesh import quarter
from verification._common import law, parameters, space_of
from verification.base import Check, Reference

#: How deep the face lies inside the blade, and its height (times 0.5 mm of length in 3D).
DEPTH, HEIGHT, LENGTH = 0.02, 1.0, 0.5
MU, TAU_W = 0.35, 0.04
#: Penalty and stiffness of sticking, MPa/mm.
NORMAL, STICK = 8.0, 5.0
#: Way of the blade: down by two millimetres, up by one, in steps.
DOWN, UP, STEPS = 2.0, 1.0, 100


class Slider:
    """A rigid piece whose cut face lies DEPTH inside the band of the blade, which moves along it."""

    def __init__(self, dim: int, p, normal: str, laws=("contact", "coulomb", "adhesion")):
        if dim == 2:
            line = np.linspace(0, HEIGHT, 4)
            mesh = named(skfem.MeshTri.init_tensor(np.array([0.0, 1.0]), line), 1.0, HEIGHT)
        else:
            mesh = block(quarter(2.0, HEIGHT, 2 * LENGTH, 0.5)).mesh
        space = space_of(mesh, "P2")
        face = space.faces("cut", 6)
        numerics, laws = ContactNumerics(NORMAL, STICK, normal=normal), tuple(map(law, laws))
        self.form = BladeForm(laws, face, numerics, keep_touched=["cut"], height=HEIGHT)
        self.u = np.tile([p.thickness / 2 - DEPTH, 0.0, 0.0][:dim], space.X.shape[1])
        self.area = face.w.sum()
        # The band is beside the piece all the way.
        self.p, self.state, self.y = p, self.form.start(p), -5.0
        self.move(0.0)
        self.state = self.form.touch(self.state)

    def move(self, way: float) -> tuple[np.ndarray, float]:
        """Force on the blade (dim,) over the face's area after it moved up by ``way``, and the work spent."""
        step = Step(1.0, self.u, np.array([0, self.y + way, 0]), np.array([0, self.y, 0]))
        local = self.form.evaluate(self.u, self.p, self.state, step)
        work = self.form.work(self.u, self.p, self.state, local.state, step)
        self.state, self.y = self.form.touch(local.state), self.y + way
        return self.form.force(local.state) / self.area, sum(work.values()) / self.area


def compute() -> Iterator[Check]:
    p = parameters("elastomer", mu=MU, tau_W=TAU_W)
    pressure = NORMAL * DEPTH
    strength = MU * pressure + TAU_W
    for dim, normal in ((2, "tool"), (2, "material"), (3, "tool"), (3, "material")):
        kind = f"{dim}D, {normal} normal"
        slider = Slider(dim, p, normal)
        steps = np.concatenate([np.full(STEPS, -DOWN / STEPS), np.full(STEPS, UP / STEPS)])
        rows = [slider.move(way) for way in steps]
        travel = np.cumsum(steps)
        # kPa, across the face and along it
        across, along = 1e3 * np.array([force[:2] for force, _ in rows]).T
        off = np.abs(along - 1e3 * spring_slider(travel, strength)).max()
        what = f"{kind}: shear when it slips, μ p + τ_W"
        yield Check(f"{kind}: pressure, ε times the depth", "kPa", 1e3 * pressure, -across[-1], 1e-9)
        yield Check(what, "kPa", 1e3 * strength, along[STEPS - 1], 1e-9)
        yield Check(f"{kind}: stick and slip, largest error", "kPa", 0.0, off, 1e-9)
        # Twice through the elastic give of sticking, the rest at full strength; the give is held at the end.
        way = (DOWN - strength / STICK / 2) + (UP - 2 * strength / STICK)
        spent = sum(w for _, w in rows)
        yield Check(f"{kind}: work of the way down and up", "mJ/mm^2", strength * way, spent, 1e-3)
    for absent, left in (("coulomb", TAU_W), ("adhesion", MU * pressure)):
        names = tuple(name for name in ("contact", "coulomb", "adhesion") if name != absent)
        slider = Slider(2, p, "tool", names)
        for _ in range(20):
            force, _ = slider.move(-0.1)
        yield Check(f"2D, without {absent}: shear when it slips", "kPa", 1e3 * left, 1e3 * force[1], 1e-9)


def spring_slider(travel: np.ndarray, strength: float) -> np.ndarray:
    """Upward force of a spring of stiffness STICK in line with a slider, as the blade goes to ``travel``."""
    out, force, before = np.empty_like(travel), 0.0, 0.0
    for i, y in enumerate(travel):
        force = float(np.clip(force - STICK * (y - before), -strength, strength))
        out[i], before = force, y
    return out


REFERENCE = Reference(
    "sliding",
    "A rigid face pressed into the blade's band, which slides down and back: contact, Coulomb, adhesion.",
    "p = ε g; spring and slider in line, of strength μ p + τ_W",
    compute,
    laws=("contact", "coulomb", "adhesion"),
    seconds=0.6,
)
