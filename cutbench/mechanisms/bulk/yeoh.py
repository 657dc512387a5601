"""Yeoh: Ψ = G/2 [(Ī₁ − 3) + c₂ (Ī₁ − 3)² + c₃ (Ī₁ − 3)³], c₂ = 2 C₂/G and c₃ = 2 C₃/G.

c₂ = c₃ = 0 is neo-Hooke. Yeoh, Rubber Chem. Technol. 66 (1993) 754, 10.5254/1.3538343.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk._isotropic import Isochoric
from cutbench.mechanisms.bulk.neo_hookean import NeoHookean


class Yeoh(Isochoric):
    """Strain stiffening (after an initial softening where c₂ < 0) as a cubic in Ī₁ − 3."""

    name = "yeoh"
    title = "Yeoh"
    family = "strain stiffening"
    role = "isochoric"
    parameters = (
        *NeoHookean.parameters,
        Parameter.effect("c2", "1", "c₂", "quadratic term 2 C₂/G", low=-0.05, high=5, typical=0.05),
        Parameter.effect("c3", "1", "c₃", "cubic term 2 C₃/G", high=5, typical=0.002),
    )

    def groups(self, p):
        return {"2 C_2/G": p.c2, "2 C_3/G": p.c3}

    def dW_dI1(self, I1, p, at):
        x = I1 - 3
        return p.G / 2 * (1 + x * (2 * p.c2 + 3 * p.c3 * x))

    def W(self, I1, p, at):
        x = I1 - 3
        return p.G / 2 * (x * (1 + x * (p.c2 + p.c3 * x)))
