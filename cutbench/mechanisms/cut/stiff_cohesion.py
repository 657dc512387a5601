"""A cohesive law that is stiff until its strength is reached; from there Smith–Ferrante's.

With s = δ/δ_c and x = e m s, T = σ_c tanh x for s < s₁: m times Smith–Ferrante's stiffness at first, then all
of σ_c = G_c/(e δ_c). For s ≥ s₁, T = G_c/δ_c y e^(−y) with y = 1 + s − s₁, Smith–Ferrante's fall from its
peak. With s₁ = e − 2 + ln 2/(e m) the work of separation is G_c. Damage is 1 − e^(−s), as there.

A law that yields from the start lets a plane open that nothing strains to its strength: waves shorter than
π G δ_c²/G_c meet more resistance in the bulk than on the plane, which then is as good as a free surface and
folds where it is squeezed (the artificial compliance of intrinsic laws: Falk, Needleman, Rice, J. Phys. IV
11, 2001, Pr5-43). That length is m times shorter here.
"""

import math

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Estimate
from cutbench.mechanisms.cut.smith_ferrante import SmithFerrante


class StiffCohesion(SmithFerrante):
    """Cohesive law without the initial compliance of Smith–Ferrante's, of the same G_c, σ_c and δ_c."""

    name = "stiff_cohesion"
    title = "cohesive (stiff)"
    family = "traction–separation"
    standard = True
    alternatives = ("smith_ferrante",)
    parameters = (
        *SmithFerrante.parameters,
        Parameter(
            "onset_stiffness",
            "1",
            "m",
            "first stiffness over Smith–Ferrante's",
            low=5.0,
            high=1000.0,
            default=20.0,
            sought=False,
            unmeasured=(0.25, 4.0),
        ),
    )

    def groups(self, p):
        return {**super().groups(p), "onset stiffness": p.onset_stiffness}

    def estimate(self, p, rate, width):
        return Estimate(strength=p.G_c / (math.e * p.delta_c), opening=p.delta_c, work=p.G_c)

    def stiffness(self, p):
        return p.onset_stiffness * super().stiffness(p)

    def whole(self, s, p):
        return np.exp(-s)

    def _turns(self, p):
        """s₁, where the traction begins to fall."""
        return math.e - 2 + np.log(2) / (math.e * p.onset_stiffness)

    def keep(self, s, p):
        x = math.e * p.onset_stiffness * s
        small = np.real(x) < 1e-4
        first = np.where(small, 1 - x * x / 3, np.tanh(x) / np.where(small, 1.0, x))
        y = 1 + s - self._turns(p)
        falls = np.real(y) >= 1
        y = np.where(falls, y, 1.0)
        return np.where(falls, y * np.exp(1 - y) / np.where(falls, x, 1.0), first)

    def spent(self, s, keep, p):
        x = math.e * p.onset_stiffness * s
        # ln cosh x, free of cancellation where x is small.
        first = np.where(np.real(x) < 1e-4, x * x / 2, x + np.log1p(np.exp(-2 * x)) - np.log(2))
        y = 1 + s - self._turns(p)
        falls = np.real(y) >= 1
        y = np.where(falls, y, 1.0)
        return np.where(falls, 1 - (1 + y) * np.exp(-y), first / (math.e**2 * p.onset_stiffness))
