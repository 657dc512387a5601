"""Gent: chains of finite length, Ψ = −G J_m/2 ln(1 − (Ī₁ − 3)/J_m), with 1/J_m as the parameter.

1/J_m = 0 is neo-Hooke. Gent, Rubber Chem. Technol. 69 (1996) 59, 10.5254/1.3538357. From 98 % of
the locking stretch on the stress grows with the slope it has there: a trial state may lie beyond.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk._isotropic import Isochoric
from cutbench.mechanisms.bulk.neo_hookean import NeoHookean

#: Part of the locking invariant from which the law goes on linearly.
LOCKED = 0.98


class Gent(Isochoric):
    """Stiffens without bound as Ī₁ approaches 3 + J_m."""

    name = "gent"
    title = "Gent"
    family = "strain stiffening"
    role = "isochoric"
    parameters = (
        *NeoHookean.parameters,
        Parameter.effect(
            "inv_J_m", "1", "1/J_m", "strain stiffening: one over Ī₁ − 3 at locking", high=2.0, typical=0.05
        ),
    )

    def groups(self, p):
        return {"1/J_m": p.inv_J_m}

    def dW_dI1(self, I1, p, at):
        y = p.inv_J_m * (I1 - 3)
        inside = np.where(y.real < LOCKED, y, 0)
        beyond = 1 / (1 - LOCKED) + (y - LOCKED) / (1 - LOCKED) ** 2
        return p.G / 2 * np.where(y.real < LOCKED, 1 / (1 - inside), beyond)

    def W(self, I1, p, at):
        x = I1 - 3
        y = p.inv_J_m * x
        inside = np.where(y.real < LOCKED, y, 0)
        # −ln(1 − y)/y, by its series where the quotient is 0/0.
        small = np.abs(inside.real) < 0.01
        series = 1 + inside * (1 / 2 + inside * (1 / 3 + inside * (1 / 4 + inside * (1 / 5 + inside / 6))))
        mean = np.where(small, series, -np.log(1 - inside) / np.where(small, 1, inside))
        over = np.where(y.real < LOCKED, 0, y - LOCKED)
        beyond = -np.log(1 - LOCKED) + over / (1 - LOCKED) + (over / (1 - LOCKED)) ** 2 / 2
        return p.G / 2 * x * np.where(y.real < LOCKED, mean, beyond / np.where(y.real < LOCKED, 1, y))
