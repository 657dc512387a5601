"""Lopez-Pamies: Ψ = G/2 [(1 − w) (Ī₁ − 3) + w 3^(1−α)/α (Ī₁^α − 3^α)], a power of Ī₁ beside neo-Hooke.

w = 0 is neo-Hooke; α is above 1, so that the power stiffens. Lopez-Pamies, C. R. Mécanique 338 (2010) 3,
10.1016/j.crme.2009.12.007, with two terms of which one is of power 1.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk._isotropic import Isochoric
from cutbench.mechanisms.bulk.neo_hookean import NeoHookean


class LopezPamies(Isochoric):
    """Stiffens as a power of Ī₁."""

    name = "lopez_pamies"
    title = "Lopez-Pamies"
    family = "strain stiffening"
    role = "isochoric"
    parameters = (
        *NeoHookean.parameters,
        Parameter.effect("w_power", "1", "w", "part of G that follows a power of Ī₁", high=1.0, typical=0.3),
        Parameter("a_power", "1", "α", "exponent of Ī₁", low=1.05, high=10.0, default=2.5),
    )

    def groups(self, p):
        return {"w (power of I_1)": p.w_power, "w α (power of I_1)": p.w_power * p.a_power}

    def dW_dI1(self, I1, p, at):
        return p.G / 2 * (1 - p.w_power + p.w_power * (I1 / 3) ** (p.a_power - 1))

    def W(self, I1, p, at):
        power = 3 / p.a_power * ((I1 / 3) ** p.a_power - 1)
        return p.G / 2 * ((1 - p.w_power) * (I1 - 3) + p.w_power * power)
