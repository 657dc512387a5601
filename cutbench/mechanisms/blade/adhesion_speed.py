"""Adhesion that grows with the sliding speed: strength τ_v Θ ln(1 + ṡ/v_a).

Rubbers and gels on hard surfaces at slow to moderate speed; a logarithm covers the rising branch of
Schallamach's and Grosch's curves (Grosch, Proc. R. Soc. Lond. A 274 (1963) 21, 10.1098/rspa.1963.0112).
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Blade


class AdhesionSpeed(Blade):
    """Shear strength beside τ_W that depends on the speed of sliding, not on the pressure."""

    name = "adhesion_speed"
    title = "adhesion by speed"
    family = "adhesion by speed"
    resembles = ("tau_W",)
    role = "adhesion_speed"
    parameters = (
        Parameter.effect(
            "tau_v", "kPa", "τ_v", "shear strength gained per e-fold of sliding speed", high=1e3, typical=0.3
        ),
        Parameter(
            "adhesion_reference",
            "mm/s",
            "v_a",
            "speed above which it grows",
            low=1e-6,
            high=1e3,
            default=0.01,
        ),
    )
    reads = ("G", "speed")

    def groups(self, p):
        return {"tau_v/G": p.tau_v / p.G, "v/v_a": p.speed / p.adhesion_reference}

    def strength(self, t_N, p, state, at):
        return p.tau_v * at.touched * np.log(1 + at.slip_rate / p.adhesion_reference)
