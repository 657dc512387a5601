"""Fung: Ψ = G/(2 b) [exp(b (Ī₁ − 3)) − 1], the stress of soft tissue grows by itself.

b = 0 is neo-Hooke. Demiray, J. Biomech. 5 (1972) 309, 10.1016/0021-9290(72)90047-4, after Fung,
Am. J. Physiol. 213 (1967) 1532. Beyond b (Ī₁ − 3) = 6 the stress grows with the slope it has there: a trial
state may lie beyond.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk._isotropic import Isochoric
from cutbench.mechanisms.bulk.neo_hookean import NeoHookean

#: Exponent from which the law goes on linearly.
STEEP = 6.0


class Fung(Isochoric):
    """Stiffens as the exponential of Ī₁ − 3."""

    name = "fung"
    title = "Fung"
    family = "strain stiffening"
    role = "isochoric"
    parameters = (
        *NeoHookean.parameters,
        Parameter.effect("b_fung", "1", "b", "strain stiffening: exponent of Ī₁ − 3", high=20.0, typical=0.1),
    )

    def groups(self, p):
        return {"b (Fung)": p.b_fung}

    def dW_dI1(self, I1, p, at):
        y = p.b_fung * (I1 - 3)
        inside = np.where(y.real < STEEP, y, 0)
        beyond = np.exp(STEEP) * (1 + y - STEEP)
        return p.G / 2 * np.where(y.real < STEEP, np.exp(inside), beyond)

    def W(self, I1, p, at):
        x = I1 - 3
        y = p.b_fung * x
        inside = np.where(y.real < STEEP, y, 0)
        # (exp y − 1)/y, by its series where the quotient is 0/0.
        small = np.abs(inside.real) < 0.01
        series = 1 + inside * (1 / 2 + inside * (1 / 6 + inside * (1 / 24 + inside / 120)))
        mean = np.where(small, series, (np.exp(inside) - 1) / np.where(small, 1, inside))
        over = np.where(y.real < STEEP, 0, y - STEEP)
        beyond = np.exp(STEEP) * (1 + over + over**2 / 2) - 1
        return p.G / 2 * x * np.where(y.real < STEEP, mean, beyond / np.where(y.real < STEEP, 1, y))
