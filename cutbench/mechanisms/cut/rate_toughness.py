"""Toughness that grows with the opening rate: T = k ln(1 + δ̇/v_c) T_cohesive while the faces part.

G_c then rises by k for each e-fold of the rate above v_c, as in the tearing of viscoelastic solids
(Maugis & Barquins, J. Phys. D 11 (1978) 1989, 10.1088/0022-3727/11/14/011, have a power). Unlike the
viscous term, which is linear in the rate, it spans decades of speed.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Cut
from cutbench.mechanisms.cut.smith_ferrante import squared_opening


class RateToughness(Cut):
    """The cohesive traction, stronger the faster the cut opens."""

    name = "rate_toughness"
    title = "rate toughness"
    family = "rate of cutting"
    resembles = ("G_c",)
    role = "rate"
    follows = ("cohesive",)
    parameters = (
        Parameter.effect(
            "rate_toughening", "1", "k", "relative growth of G_c per e-fold of rate", high=20.0, typical=0.3
        ),
        Parameter(
            "rate_reference", "mm/s", "v_c", "rate above which it grows", low=1e-6, high=1e3, default=0.01
        ),
    )
    reads = ("beta", "speed")

    def groups(self, p):
        return {"rate toughening": p.rate_toughening, "v/v_c": p.speed / p.rate_reference}

    def growth(self, rate, p):
        """Relative growth of the toughness (N,) at opening rates (N,), mm/s."""
        return p.rate_toughening * np.log(1 + rate / p.rate_reference)

    def traction(self, jump, p, state, at):
        now, old = squared_opening(jump, p), squared_opening(at.jump_old, p)
        opens = now.real > old.real
        # sqrt has no derivative at 0; where nothing opens neither root counts.
        old_is_zero = old.real <= 0
        delta_old = np.where(old_is_zero, 0, np.sqrt(np.where(old_is_zero, 1.0, old)))
        delta = np.sqrt(np.where(opens, now, 1.0))
        rate = np.where(opens, (delta - delta_old) / at.dt, 0)
        T = self.growth(rate, p) * at.before["cohesive"].traction
        # What resists closing is contact, not cohesion.
        T[0] = np.where(jump[0].real > 0, T[0], 0)
        return T, {}
