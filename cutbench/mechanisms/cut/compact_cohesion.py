"""A cohesive law of another shape: from the exponential tail of ``stiff_cohesion`` (q = 0) to a bell (q = 1).

T = (1 − q) T_stiff + q T_bell, with s = δ/δ_c and T_bell = G_c/δ_c (λ²/10) s Q(λ s), Q(y) = e^(−y)
(1 + y + y²/2 + y³/6). λ is such that the bell peaks at δ_c; G_c is the work of separation for every q.
The traction at δ_c rises from 0.36 to 0.57 G_c/δ_c. Compare the shape parameters of Park, Paulino & Roesler,
J. Mech. Phys. Solids 57 (2009) 891, 10.1016/j.jmps.2008.10.003.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Estimate
from cutbench.mechanisms.cut.stiff_cohesion import StiffCohesion

#: Positive root of 1 + λ + λ²/2 + λ³/6 = λ⁴/6, where s Q(λ s) peaks at s = 1.
BELL = float(max(r.real for r in np.roots([1 / 6, -1 / 6, -1 / 2, -1, -1]) if abs(r.imag) < 1e-9))


def _poisson(y, terms: int):
    """e^(−y) Σ_{k < terms} y^k/k!."""
    total = term = np.ones_like(y)
    for k in range(1, terms):
        term = term * y / k
        total = total + term
    return np.exp(-y) * total


class CompactCohesion(StiffCohesion):
    """Cohesive law whose shape q runs from an exponential tail to a compact bell."""

    name = "compact_cohesion"
    title = "cohesive (shape)"
    family = "traction–separation"
    parameters = (
        *StiffCohesion.parameters,
        Parameter.effect(
            "compactness",
            "1",
            "q",
            "shape: 0 an exponential tail, 1 a bell without one",
            high=1.0,
            typical=0.5,
        ),
    )

    def groups(self, p):
        return {**super().groups(p), "compactness": p.compactness}

    def _parts(self, p):
        """First stiffnesses of the tail and of the bell, MPa/mm."""
        tail = (1 - p.compactness) * super().stiffness(p)
        return tail, p.compactness * p.G_c / p.delta_c**2 * BELL**2 / 10

    def stiffness(self, p):
        return sum(self._parts(p))

    def keep(self, s, p):
        (tail, bell), first = self._parts(p), super().keep(s, p)
        return first + bell / (tail + bell) * (_poisson(BELL * s, 4) - first)

    def whole(self, s, p):
        first = super().whole(s, p)
        return first + p.compactness * (_poisson(BELL * s, 4) - first)

    def spent(self, s, keep, p):
        y, first = BELL * s, super().spent(s, keep, p)
        bell = BELL**2 / 10 * s**2 / 2 * _poisson(y, 4) + 1 - _poisson(y, 6)
        return first + p.compactness * (bell - first)

    def estimate(self, p, rate, width):
        peak = self.stiffness(p) * p.delta_c * self.keep(np.ones(1), p)[0]
        return Estimate(strength=peak, opening=p.delta_c, work=p.G_c)
