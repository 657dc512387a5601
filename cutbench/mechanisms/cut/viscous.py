"""Viscous regularisation of the opening, as printed (paper, eq. traction_separation):
T = G_c/δ_c² η_reg d⟦u⟧/dt.

It stays when the cohesion is gone, so it also loads faces that are long cut (the paper's footnote
admits it). With an elliptic tip and faces that follow it, ∫(dδ/dz)² dz grows like a logarithm under
refinement: the steady force has no limit. ``viscous_degraded`` has one.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Cut

ETA = Parameter(
    "eta_reg",
    "s",
    "η_reg",
    "viscous time of the opening; η_reg · speed is what counts",
    low=0,
    off=0.0,
    default=0.0,
    typical=2.38,
)


class Viscous(Cut):
    """Rate term with constant viscosity, whatever the damage."""

    name = "viscous"
    title = "viscous"
    role = "viscous"
    parameters = (ETA,)
    reads = ("G_c", "delta_c", "speed")

    def groups(self, p):
        return {"eta_reg v/delta_c": p.eta_reg * p.speed / p.delta_c}

    def viscosity(self, p, at):
        """MPa s/mm, a number or (N,)."""
        return p.G_c / p.delta_c**2 * p.eta_reg

    def traction(self, jump, p, state, at):
        return self.viscosity(p, at) * (jump - at.jump_old) / at.dt, {}
