"""Resistance to volume change (paper, eq. for Ψ_vol): U = κ/2 (J − 1)², κ = 2G(1+ν)/(3(1−2ν))."""

from typing import ClassVar

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk._isotropic import Volumetric


class QuadraticVolumetric(Volumetric):
    """Quadratic in J; the bulk modulus follows from the shear modulus and Poisson's ratio."""

    name = "volumetric"
    title = "volume change"
    family = "volume change"
    role = "volumetric"
    standard = published = True
    reads = ("G",)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "nu", "1", "ν", "Poisson's ratio", low=0.0, high=0.5, open_high=True, default=0.49, sought=False
        ),
    )

    def groups(self, p):
        return {"kappa/G": self.kappa(p) / p.G}

    def kappa(self, p):
        return 2 * p.G * (1 + p.nu) / (3 * (1 - 2 * p.nu))

    def U(self, J, p):
        return self.kappa(p) / 2 * (J - 1) ** 2

    def dU_dJ(self, J, p):
        return self.kappa(p) * (J - 1)
