"""The cohesive law at a point: work of separation, strength, unloading, closing, sliding."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cutbench.forms.cut import CutForm
from cutbench.forms.geometry import paired
from cutbench.mechanisms.base import Points
from cutbench.verification.reference._parts import law, parameters, space_of, split_block, stay
from cutbench.verification.reference.base import Check, Reference

BETA = 0.8


class Interface:
    """Two rigid pieces with cut laws between them: traction for a jump, and the ledger's work."""

    def __init__(self, laws, p):
        self.space = space_of(split_block(2), "P1")
        plus, minus = (self.space.faces(name, 4) for name in ("cut", "cut_minus"))
        self.form = CutForm(laws, plus, 1.5, paired(plus, minus, self.space.X))
        self.p, self.state, self.u = p, self.form.start(p), np.zeros(self.space.ndof)
        self.area = plus.w.sum()

    def move(self, opening: float, sliding: float = 0.0, dt: float = 1.0):
        """Traction (2,) after a step to this jump and the work (by law) of the step per area."""
        right = self.space.X[0] > 0
        right[np.unique(self.form.faces.nodes)] = True  # of the nodes at x = 0 those of the right piece
        u = (right * np.array([[opening], [sliding]])).T.ravel()
        step = stay(self.u, dt)
        local = self.form.evaluate(u, self.p, self.state, step, tangent=False)
        work = self.form.work(u, self.p, self.state, local.state, step)
        self.state, self.u = local.state, u
        plus = self.form.faces.nodes.shape[0]
        force = local.vector.reshape(2, -1, local.vector.shape[-1])[:, :plus].sum(axis=(1, 2))
        return force / self.area, {name: value / self.area for name, value in work.items()}


def compute() -> Iterator[Check]:
    p = parameters("gelatin", beta=BETA)
    G_c, delta, unit = p.G_c, p.delta_c, "J/m^2"
    sigma = G_c / (math.e * delta)
    path = np.linspace(0, 25 * delta, 1001)

    def swept(direction: np.ndarray) -> tuple[np.ndarray, float]:
        interface = Interface((law("smith_ferrante"),), p)
        rows = [interface.move(*(s * direction)) for s in path]
        return np.array([T for T, _ in rows]), sum(work["smith_ferrante"] for _, work in rows)

    def simpson(T: np.ndarray) -> float:
        return (path[1] - path[0]) / 3 * (T[0] + T[-1] + 4 * T[1:-1:2].sum() + 2 * T[2:-1:2].sum())

    T, work = swept(np.array([1.0, 0.0]))
    yield Check("∫ T dδ, opening", unit, 1e3 * G_c, 1e3 * simpson(T[:, 0]), 1e-6)
    yield Check("the same in the energy ledger", unit, 1e3 * G_c, 1e3 * work, 1e-6)
    yield Check("largest T = G_c/(e δ_c)", "kPa", 1e3 * sigma, 1e3 * T[:, 0].max(), 1e-6)
    yield Check("opening at the largest T, over δ_c", "1", 1.0, path[T[:, 0].argmax()] / delta, 1e-9)
    yield Check("T at 10 δ_c", "kPa", 1e4 * G_c / delta * np.exp(-10), 1e3 * T[400, 0], 1e-9)
    T, work = swept(np.array([0.0, 1.0]) / BETA)
    yield Check("∫ T dδ, sliding, β = 0.8", unit, 1e3 * G_c, 1e3 * simpson(T[:, 1]) / BETA, 1e-6)
    yield Check("largest T, sliding, β = 0.8", "kPa", 1e3 * BETA * sigma, 1e3 * T[:, 1].max(), 1e-6)
    T, work = swept(np.array([0.6, 0.8 / BETA]))
    power = T @ np.array([0.6, 0.8 / BETA])
    yield Check("∫ T·dδ, opening and sliding together", unit, 1e3 * G_c, 1e3 * simpson(power), 1e-6)

    interface = Interface((law("smith_ferrante"),), p)
    interface.move(3 * delta)
    K = G_c / delta**2
    for part in (2.0, 0.5):
        (T, _), _ = interface.move(part * delta)
        what = f"T at {part:g} δ_c, unloading from 3 δ_c to the origin"
        yield Check(what, "kPa", 1e3 * K * np.exp(-3) * part * delta, 1e3 * T, 1e-9)
    (T, _), _ = interface.move(-0.01 * delta)
    closed = K * 0.01 * delta + Points.closing * p.G * 0.01**2
    yield Check("T closed by δ_c/100: undamaged", "kPa", -1e3 * closed, 1e3 * T, 1e-9)
    (T, _), work = interface.move(0.0)
    yield Check("T at 0 after a cycle", "kPa", 0.0, 1e3 * T, 1e-12)


REFERENCE = Reference(
    "cohesive_law",
    "The traction–separation law at a point, through the form of the cut: gelatin's G_c and δ_c.",
    "T = G_c/δ_c² exp(−δ/δ_c) δ integrated by hand (Smith–Ferrante; Ortiz and Pandolfi 1999)",
    compute,
    laws=("smith_ferrante",),
    seconds=0.6,
)
