"""Toughness by the fibres' angle to the cut plane: T = k (κ + (1 − 3κ) cos² ψ) T_cohesive, ψ from its normal.

Beside the cohesive law that is a work of separation of G_c (1 + k N·H N), where H is the structure tensor
of ``fibres``, κ their dispersion and N the normal of the cut plane: fibres that cross it have to be cut, and
between fibres that lie in it G_c does. That a structure tensor weighs toughness is usual for soft tissues
(Gültekin, Dal & Holzapfel 2018, Numerical aspects of anisotropic failure in soft biological tissues favor
energy-based criteria, Comput. Methods Appl. Mech. Eng.).
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Cut, Estimate
from cutbench.mechanisms.bulk.fibres import direction


class FibreToughness(Cut):
    """The cohesive traction, stronger where fibres cross the cut plane."""

    name = "fibre_toughness"
    title = "toughness by fibres"
    family = "anisotropy"
    resembles = ("G_c",)
    role = "fibres"
    follows = ("cohesive",)
    directed = "specimen_angle"
    parameters = (
        Parameter.effect(
            "fibre_toughening", "1", "k", "relative growth of G_c where all fibres cross the cut plane",
            high=1000.0, typical=1.0,
        ),
    )  # fmt: skip
    reads = ("G_c", "delta_c", "fibre_dispersion", "fibre_angle", "fibre_incline", "specimen_angle")

    def groups(self, p):
        return {"fibre toughening": p.fibre_toughening}

    def growth(self, p):
        """k N·H N."""
        kappa = p.fibre_dispersion
        return p.fibre_toughening * (kappa + (1 - 3 * kappa) * direction(p)[0] ** 2)

    def like(self, p):
        return {"G_c": p.G_c * (1 + self.growth(p))}

    def estimate(self, p, rate, width):
        return Estimate(strength=self.growth(p) * p.G_c / (np.e * p.delta_c), work=self.growth(p) * p.G_c)

    def traction(self, jump, p, state, at):
        T = self.growth(p) * at.before["cohesive"].traction
        # What resists closing is contact, not cohesion.
        T[0] = np.where(jump[0].real > 0, T[0], 0)
        return T, {}
