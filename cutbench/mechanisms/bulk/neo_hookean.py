"""Neo-Hooke, isochoric part (paper, eq. for Ψ_iso): Ψ = G/2 (Ī₁ − 3)."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk._isotropic import Isochoric


class NeoHookean(Isochoric):
    """Entropic elasticity of a Gaussian network; G is the shear modulus at all strains."""

    name = "neo_hookean"
    title = "neo-Hooke"
    family = "elasticity"
    meant = {  # noqa: RUF012
        "E": "G, the shear modulus: G = E/(2 (1 + nu)), a third of Young's modulus E of a gel",
        "youngs_modulus": "G, the shear modulus: G = E/(2 (1 + nu)), a third of Young's modulus E of a gel",
        "shear_modulus": "G, the shear modulus",
        "modulus": "G, the shear modulus; of Young's modulus E of a gel a third",
    }
    role = "isochoric"
    standard = published = True
    parameters = (Parameter.positive("G", "kPa", "G", "shear modulus", typical=25.0, lever="stiffness"),)

    def dW_dI1(self, I1, p, at):
        return p.G / 2 + 0 * I1

    def W(self, I1, p, at):
        return p.G / 2 * (I1 - 3)
