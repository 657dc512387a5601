"""A cohesive law of another shape: from Smith–Ferrante's long tail (q = 0) to a bell without one (q = 1).

With s = δ/δ_c, 1 − d = (1 − q) e^(−s) + q Q(λ s), Q(y) = e^(−y) (1 + y + y²/2 + y³/6), and the stiffness
G_c/(δ_c² M), M = 1 − q + 10 q/λ². λ is such that both ends peak at δ_c; G_c is the work of separation for
every q. The peak traction rises from 0.37 to 0.57 G_c/δ_c. Compare the shape parameters of Park, Paulino
& Roesler, J. Mech. Phys. Solids 57 (2009) 891, 10.1016/j.jmps.2008.10.003.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.cut.smith_ferrante import SmithFerrante

#: Positive root of 1 + λ + λ²/2 + λ³/6 = λ⁴/6, where s Q(λ s) peaks at s = 1.
BELL = float(max(r.real for r in np.roots([1 / 6, -1 / 6, -1 / 2, -1, -1]) if abs(r.imag) < 1e-9))


def _poisson(y, terms: int):
    """e^(−y) Σ_{k < terms} y^k/k!."""
    total = term = np.ones_like(y)
    for k in range(1, terms):
        term = term * y / k
        total = total + term
    return np.exp(-y) * total


class CompactCohesion(SmithFerrante):
    """Cohesive law whose shape q runs from an exponential tail to a compact bell."""

    name = "compact_cohesion"
    title = "cohesive (shape)"
    parameters = (
        *SmithFerrante.parameters,
        Parameter.effect(
            "compactness", "1", "q", "shape: 0 Smith–Ferrante, 1 a bell without tail", high=1.0, typical=0.5
        ),
    )

    def groups(self, p):
        return {**super().groups(p), "compactness": p.compactness}

    def keep(self, s, p):
        return (1 - p.compactness) * np.exp(-s) + p.compactness * _poisson(BELL * s, 4)

    def _moment(self, p):
        return 1 - p.compactness + p.compactness * 10 / BELL**2

    def stiffness(self, p):
        return super().stiffness(p) / self._moment(p)

    def spent(self, s, keep, p):
        y, q = BELL * s, p.compactness
        tail = np.exp(-s)
        bell = s**2 / 2 * _poisson(y, 4) + 10 / BELL**2 * (1 - _poisson(y, 6))
        return ((1 - q) * super().spent(s, tail, p) + q * bell) / self._moment(p)
