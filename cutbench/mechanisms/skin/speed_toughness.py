"""Toughness that grows with the blade's speed: G_c (1 + k ln(1 + v/v_b)).

What a test at several speeds tells of a toughness, whatever in the process zone makes it grow: G_c rises by k
for each e-fold of the blade's speed v above v_b, at equal δ_c, and all that the cut plane's laws measure by
it. Where the front jumps its faces part as fast as viscosity lets them, at any speed of the blade, and a law
of their own rate (``rate_toughness``) grows little with it.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin


class SpeedToughness(Skin):
    """The cut plane's tractions, stronger the faster the blade goes."""

    name = "speed_toughness"
    title = "toughness by speed"
    family = "rate of cutting"
    resembles = ("G_c",)
    role = "speed_toughness"
    #: Only a blade has its speed.
    kinds = ("cut",)
    parameters = (
        Parameter.effect(
            "speed_toughening",
            "1",
            "k",
            "relative growth of G_c per e-fold of speed",
            high=20.0,
            typical=0.3,
        ),
        Parameter(
            "toughness_speed", "mm/s", "v_b", "speed above which G_c grows", low=1e-6, high=1e3, default=0.01
        ),
    )
    reads = ("speed",)

    def groups(self, p):
        return {"speed toughening": p.speed_toughening, "v/v_b": p.speed / p.toughness_speed}

    def toughness(self, p, at):
        return 1 + p.speed_toughening * np.log(1 + p.speed / p.toughness_speed)

    def like(self, p):
        return {"G_c": p.G_c * self.toughness(p, None)}
