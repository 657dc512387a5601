"""The cohesive law at a point: work of separation, strength, unloading, closing, sliding."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cutbench.forms.cut import CutForm
from cutbench.forms.geometry import paired
from cutbench.mechanisms.base import Points
from verification._common import law, parameters, space_of, split_block, step_at_rest
from verification.base import Check, Reference

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
        step = step_at_rest(self.u, dt)
        local = self.form.evaluate(u, self.p, self.state, step)
        work = self.form.work(u, self.p, self.state, local.state, step)
        self.state, self.u = local.state, u
        plus = self.form.faces.nodes.shape[0]
        force = local.vector.reshape(2, -1, local.vector.shape[-1])[:, :plus].sum(axis=(1, 2))
        return force / self.area, {name: value / self.area for name, value in work.items()}


def compute() -> Iterator[Check]:
    yield from yielding()
    yield from stiff()


def swept(name: str, p, path: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, float]:
    """Tractions (n, 2) on the way along ``direction``, and all the work that the ledger has."""
    interface = Interface((law(name),), p)
    rows = [interface.move(*(s * direction)) for s in path]
    return np.array([T for T, _ in rows]), sum(work[name] for _, work in rows)


def simpson(path: np.ndarray, T: np.ndarray) -> float:
    return (path[1] - path[0]) / 3 * (T[0] + T[-1] + 4 * T[1:-1:2].sum() + 2 * T[2:-1:2].sum())


OPENING, SLIDING = np.array([1.0, 0.0]), np.array([0.0, 1.0]) / BETA


def yielding() -> Iterator[Check]:
    """Smith–Ferrante's law."""
    p = parameters("gelatin", beta=BETA)
    G_c, delta, unit = p.G_c, p.delta_c, "J/m^2"
    sigma = G_c / (math.e * delta)
    path = np.linspace(0, 25 * delta, 1001)

    T, work = swept("smith_ferrante", p, path, OPENING)
    yield Check("∫ T dδ, opening", unit, 1e3 * G_c, 1e3 * simpson(path, T[:, 0]), 1e-6)
    yield Check("the same in the energy ledger", unit, 1e3 * G_c, 1e3 * work, 1e-6)
    yield Check("largest T = G_c/(e δ_c)", "kPa", 1e3 * sigma, 1e3 * T[:, 0].max(), 1e-6)
    yield Check("opening at the largest T, over δ_c", "1", 1.0, path[T[:, 0].argmax()] / delta, 1e-9)
    yield Check("T at 10 δ_c", "kPa", 1e4 * G_c / delta * np.exp(-10), 1e3 * T[400, 0], 1e-9)
    T, work = swept("smith_ferrante", p, path, SLIDING)
    found = simpson(path, T[:, 1]) / BETA
    yield Check("∫ T dδ, sliding, β = 0.8", unit, 1e3 * G_c, 1e3 * found, 1e-6)
    yield Check("largest T, sliding, β = 0.8", "kPa", 1e3 * BETA * sigma, 1e3 * T[:, 1].max(), 1e-6)
    both = 0.6 * OPENING + 0.8 * SLIDING
    T, work = swept("smith_ferrante", p, path, both)
    found = simpson(path, T @ both)
    yield Check("∫ T·dδ, opening and sliding together", unit, 1e3 * G_c, 1e3 * found, 1e-6)

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


def stiff() -> Iterator[Check]:
    """The law without initial compliance: its strength and its work of separation are those of the other."""
    p = parameters("gelatin", beta=BETA)
    G_c, delta, name, unit = p.G_c, p.delta_c, "stiff_cohesion", "J/m^2"
    sigma, m = G_c / (math.e * delta), p.onset_stiffness
    falls = math.e - 2 + math.log(2) / (math.e * m)
    # First finely to where it falls, for the first part is over in δ_c/(e m).
    rise, fall = np.linspace(0, falls * delta, 1001), np.linspace(falls * delta, 30 * delta, 1001)
    path = np.concatenate([rise, fall[1:]])
    for what, direction in (("opening", OPENING), ("sliding, β = 0.8", SLIDING)):
        T, work = swept(name, p, path, direction)
        power = T @ direction
        found = simpson(rise, power[:1001]) + simpson(fall, power[1000:])
        yield Check(f"{name}: ∫ T dδ, {what}", unit, 1e3 * G_c, 1e3 * found, 1e-6)
        yield Check(f"{name}: the same in the energy ledger, {what}", unit, 1e3 * G_c, 1e3 * work, 1e-6)
        yield Check(f"{name}: largest T = G_c/(e δ_c), {what}", "kPa", 1e3 * sigma, 1e3 * power.max(), 1e-6)
    interface = Interface((law(name),), p)
    for part in (1e-3, 0.1, 0.5):
        (T, _), _ = interface.move(part * delta)
        expected = sigma * math.tanh(math.e * m * part)
        yield Check(f"{name}: T at {part:g} δ_c, σ_c tanh(e m δ/δ_c)", "kPa", 1e3 * expected, 1e3 * T, 1e-9)
    for s in (1.0, 10.0):
        (T, _), _ = interface.move(s * delta)
        y = 1 + s - falls
        expected = G_c / delta * y * math.exp(-y)
        yield Check(f"{name}: T at {s:g} δ_c, G_c/δ_c y exp(−y)", "kPa", 1e3 * expected, 1e3 * T, 1e-9)
    (half, _), _ = interface.move(5 * delta)
    yield Check(f"{name}: T at 5 δ_c, unloading from 10 δ_c", "kPa", 500 * expected, 1e3 * half, 1e-9)
    (T, _), _ = interface.move(-0.01 * delta)
    closed = m * G_c / delta * 0.01 + Points.closing * p.G * 0.01**2
    yield Check(f"{name}: T closed by δ_c/100: undamaged", "kPa", -1e3 * closed, 1e3 * T, 1e-9)


REFERENCE = Reference(
    "cohesive_law",
    "The traction–separation laws at a point, through the form of the cut: gelatin's G_c and δ_c.",
    "T = G_c/δ_c² exp(−δ/δ_c) δ (Smith–Ferrante; Ortiz and Pandolfi 1999), and σ_c tanh(e m δ/δ_c) up to its"
    " fall from the peak, integrated by hand",
    compute,
    laws=("smith_ferrante", "stiff_cohesion"),
    seconds=1.5,
)
