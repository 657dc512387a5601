"""The viscous terms of the cut at a point, opened at constant speed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from verification._common import law, parameters
from verification.base import Check, Reference
from verification.cohesive_law import Interface

#: The opening at the end in units of δ_c, and steps to it: work must not depend on how many.
END = 10.0
STEPS = (20, 400)


def compute() -> Iterator[Check]:
    p = parameters("gelatin")
    # Opened at the blade's speed v.
    steady = p.G_c / p.delta_c**2 * p.eta_reg * p.speed
    spent = p.G_c * p.eta_reg * p.speed / p.delta_c
    for steps in STEPS:
        T, work = opened("viscous", p, steps)
        many = f"in {steps} steps"
        yield Check(f"viscous: T = G_c/δ_c² η v, {many}", "kPa", 1e3 * steady, 1e3 * T[-1], 1e-9)
        expected = steady * END * p.delta_c
        yield Check(f"viscous: work to 10 δ_c, {many}", "J/m^2", 1e3 * expected, 1e3 * work, 1e-9)
        T, work = opened("viscous_degraded", p, steps)
        expected = -spent * np.expm1(-END)
        yield Check(f"viscous_degraded: work to 10 δ_c, {many}", "J/m^2", 1e3 * expected, 1e3 * work, 1e-6)
    # The traction of a step is the mean over it, here that at its middle.
    middle = steady * np.exp(-END / STEPS[-1] * 40.5)
    what = "viscous_degraded: T = exp(−δ/δ_c) G_c/δ_c² η v, δ = 1.01 δ_c"
    yield Check(what, "kPa", 1e3 * middle, 1e3 * T[40], 1e-4)


def opened(name: str, p, steps: int) -> tuple[np.ndarray, float]:
    """Viscous traction (steps,) of each step, with the cohesive law's taken off, and its work per area."""
    bare = Interface((law("smith_ferrante"),), p)
    both = Interface((law("smith_ferrante"), law(name)), p)
    step = END * p.delta_c / steps
    T = np.empty(steps)
    for i in range(steps):
        dt = step / p.speed
        T[i] = both.move((i + 1) * step, dt=dt)[0][0] - bare.move((i + 1) * step, dt=dt)[0][0]
    return T, float(T.sum() * step)


REFERENCE = Reference(
    "viscous_law",
    "Both viscous forms at a point, opened at gelatin's η v: traction and dissipated work.",
    "∫ (1 − d) G_c/δ_c² η v dδ = G_c η v/δ_c for the degraded form; G_c/δ_c² η v δ for the other",
    compute,
    laws=("viscous", "viscous_degraded"),
    seconds=0.5,
)
