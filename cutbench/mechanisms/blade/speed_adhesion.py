"""Adhesion that grows with the blade's speed: strength k ln(1 + v/v_w) τ_W Θ.

What a test at several speeds tells of an adhesion, whatever in the interface makes it grow: τ_W rises by k
for each e-fold of the blade's speed v above v_w. Where material sticks to a blade it hardly slides, and a law
of the sliding speed (``adhesion_speed``) grows little with that of the blade.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Blade


class SpeedAdhesion(Blade):
    """The shear strength of adhesion, higher the faster the blade goes."""

    name = "speed_adhesion"
    title = "adhesion by blade speed"
    family = "adhesion by speed"
    resembles = ("tau_W",)
    role = "speed_adhesion"
    follows = ("adhesion",)
    parameters = (
        Parameter.effect(
            "speed_sticking",
            "1",
            "k_W",
            "relative growth of τ_W per e-fold of speed",
            high=20.0,
            typical=0.3,
        ),
        Parameter(
            "sticking_speed", "mm/s", "v_w", "speed above which τ_W grows", low=1e-6, high=1e3, default=0.01
        ),
    )
    reads = ("tau_W", "speed", "slice_push")

    def groups(self, p):
        return {"speed sticking": p.speed_sticking, "v/v_w": self._ratio(p)}

    def _ratio(self, p):
        """Of the blade's speed, down and along its edge, and v_w."""
        return p.speed * np.sqrt(1 + p.slice_push**2) / p.sticking_speed

    def like(self, p):
        return {"tau_W": p.tau_W * (1 + p.speed_sticking * np.log(1 + self._ratio(p)))}

    def strength(self, t_N, p, state, at):
        return (self.like(p)["tau_W"] - p.tau_W) * at.touched
