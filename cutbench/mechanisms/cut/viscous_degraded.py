"""Viscous regularisation that decays with damage: T = G_c/δ_c² (1 − d) η_reg d⟦u⟧/dt.

The general form that the paper's footnote names and does not use. What is cut no longer resists,
so the dissipation is confined to the process zone and converges under refinement.

In the mean over a step d is its mean over the opening from the step's start to its end: the work is then that
of an opening at constant rate, however much of the cohesion one step breaks. With d at the end alone, a point
that opens within one step would dissipate nothing.
"""

from cutbench.mechanisms.base import Estimate
from cutbench.mechanisms.cut.viscous import Viscous


class ViscousDegraded(Viscous):
    """Rate term that fades as the interface breaks."""

    name = "viscous_degraded"
    title = "viscous (degraded)"
    family = "rate of cutting"
    standard = True

    def estimate(self, p, rate, width):
        return Estimate(work=p.G_c / p.delta_c * p.eta_reg * rate)

    def traction(self, jump, p, state, at):
        T, new = super().traction(jump, p, state, at)
        cohesive = at.before.get("cohesive")
        return T if cohesive is None else T * (1 - cohesive.mean_damage), new

    def ending(self, rate, p, before):
        cohesive = before.get("cohesive")
        return None if cohesive is None else self.viscosity(p) * (1 - cohesive.new["damage"]) * rate
