"""Compressibility beyond that of Poisson's ratio: U = κ_c/2 (J − 1)², 1/κ_c = 1/κ + c/G.

For a material whose ν is taken from a book but that holds pores or loses solvent under pressure: c
adds to its compliance to volume change. c = 0 is the law ``volumetric`` (paper, eq. for Ψ_vol).
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk.volumetric import QuadraticVolumetric


class Compressible(QuadraticVolumetric):
    """Quadratic in J with a second compliance in series."""

    name = "compressible"
    title = "compressibility"
    family = "volume change"
    parameters = (
        *QuadraticVolumetric.parameters,
        Parameter.effect(
            "compressibility", "1", "c", "volume compliance beside that of ν, times G", high=10.0, typical=0.1
        ),
    )

    def groups(self, p):
        return {"kappa/G": self.kappa(p) / p.G}

    def kappa(self, p):
        base = super().kappa(p)
        return base / (1 + p.compressibility * base / p.G)
