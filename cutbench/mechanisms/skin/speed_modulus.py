"""Modulus that grows with the blade's speed: G (1 + k ln(1 + v/v_g)).

What a test at several speeds tells of a modulus: material that relaxes over many decades of time is stiffer
the less time a cut takes, and within a cut, at one speed, its modulus changes little. G rises by k for each
e-fold of the blade's speed v above v_g, at equal ν, and all that the bulk laws measure by it.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin


class SpeedModulus(Skin):
    """Stresses that are higher the faster the blade goes, as of what relaxes at all times."""

    name = "speed_modulus"
    title = "modulus by speed"
    family = "viscoelasticity"
    resembles = ("G",)
    role = "speed_modulus"
    #: Only a blade has its speed.
    kinds = ("cut",)
    parameters = (
        Parameter.effect(
            "speed_stiffening", "1", "k_G", "relative growth of G per e-fold of speed", high=20.0, typical=0.3
        ),
        Parameter(
            "stiffening_speed", "mm/s", "v_g", "speed above which G grows", low=1e-6, high=1e3, default=0.01
        ),
    )
    reads = ("G", "speed")

    def groups(self, p):
        return {"speed stiffening": p.speed_stiffening, "v/v_g": p.speed / p.stiffening_speed}

    def stiffness(self, p, at):
        return 1 + p.speed_stiffening * np.log(1 + p.speed / p.stiffening_speed)

    def like(self, p):
        return {"G": p.G * self.stiffness(p, None)}
