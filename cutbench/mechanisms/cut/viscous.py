"""Viscous regularisation of the opening, as printed (paper, eq. traction_separation):
T = G_c/δ_c² η_reg d⟦u⟧/dt.

It stays when the cohesion is gone, so it also loads faces that are long cut (the paper's footnote
admits it). With an elliptic tip and faces that follow it, ∫(dδ/dz)² dz grows like a logarithm under
refinement: the steady force has no limit. ``viscous_degraded`` has one.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Cut, Estimate, Group

ETA = Parameter.effect(
    "eta_reg", "s", "η_reg", "viscous time of the opening; η_reg · speed is what counts", typical=2.38
)


class Viscous(Cut):
    """Rate term with constant viscosity, whatever the damage."""

    name = "viscous"
    title = "viscous"
    family = "rate of cutting"
    role = "viscous"
    parameters = (ETA,)
    reads = ("G_c", "delta_c", "speed")
    published = regularises = over_step = True
    settable = (
        Group(
            "viscosity", "eta_reg v/delta_c", r"$\eta_\mathrm{reg}\,v/\delta_\mathrm{c}$", "eta_reg",
            ("speed", "delta_c"), lambda p: p.eta_reg * p.speed / p.delta_c,
            lambda p, x: x * p.delta_c / p.speed,
        ),
        # By its invariant as a length: the pseudo-time reading of the paper (t = blade travel).
        Group(
            "eta_v", "eta_reg v", "η_reg v", "eta_reg", ("speed",), lambda p: p.eta_reg * p.speed,
            lambda p, x: x / p.speed, "mm", "viscous length; sets eta_reg = eta_v/speed",
        ),
    )  # fmt: skip

    def groups(self, p):
        return {"eta_reg v/delta_c": p.eta_reg * p.speed / p.delta_c}

    def estimate(self, p, rate, width):
        return Estimate(work=p.G_c / p.delta_c**2 * p.eta_reg * rate * width)

    def viscosity(self, p):
        """MPa s/mm."""
        return p.G_c / p.delta_c**2 * p.eta_reg

    def traction(self, jump, p, state, at):
        return self.viscosity(p) * (jump - at.jump_old) / at.dt, {}
