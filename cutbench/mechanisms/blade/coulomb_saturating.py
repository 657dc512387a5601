"""Friction that saturates with the pressure: strength μ t_N/(1 + t_N/p_s), with 1/p_s as the parameter.

The real contact area cannot outgrow the apparent one: at t_N ≫ p_s the strength stays at μ p_s (Bowden
and Tabor's argument for soft solids). 1/p_s = 0 is the law ``coulomb``.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.blade.coulomb import Coulomb


class CoulombSaturating(Coulomb):
    """Coulomb friction at low pressure, a constant strength at high pressure."""

    name = "coulomb_saturating"
    title = "saturating friction"
    family = "friction"
    parameters = (
        *Coulomb.parameters,
        Parameter.effect(
            "inv_p_s", "1/kPa", "1/p_s", "one over the pressure of saturation", high=100.0, typical=0.05
        ),
    )
    reads = ("G",)

    def groups(self, p):
        return {"mu": p.mu, "G/p_s": p.inv_p_s * p.G}

    def strength(self, t_N, p, state, at):
        return p.mu * t_N / (1 + t_N * p.inv_p_s)
