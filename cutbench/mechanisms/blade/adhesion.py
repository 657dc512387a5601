"""Adhesion and wear on the blade (paper, eq. flow_potential and piecewise_adhesion): strength τ_W Θ.

Θ is 1 under contact and stays 1 on a cut face that has touched once.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Blade


class Adhesion(Blade):
    """Shear strength that does not depend on the pressure."""

    name = "adhesion"
    title = "adhesion"
    role = "adhesion"
    parameters = (
        Parameter(
            "tau_W",
            "kPa",
            "τ_W",
            "shear strength of adhesion and wear",
            low=0,
            off=0.0,
            default=0.0,
            typical=0.8,
        ),
    )
    reads = ("G_c", "delta_c")

    def groups(self, p):
        return {"tau_W/(G_c/delta_c)": p.tau_W / (p.G_c / p.delta_c)}

    def strength(self, t_N, p, state, at):
        return p.tau_W * at.touched
