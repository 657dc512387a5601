"""Adhesion and wear on the blade (paper, eq. flow_potential and piecewise_adhesion): strength τ_W Θ.

Θ is 1 under contact and stays 1 on a cut face that has touched, until the blade is away.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Blade, Estimate, Group


class Adhesion(Blade):
    """Shear strength that does not depend on the pressure."""

    name = "adhesion"
    title = "adhesion"
    family = "adhesion"
    role = "adhesion"
    parameters = (
        Parameter.effect(
            "tau_W",
            "kPa",
            "τ_W",
            "shear strength of adhesion and wear",
            typical=0.8,
            lever="coating",
            trial=("with a lubricated blade", 0.1),
        ),
    )
    reads = ("G_c", "delta_c")
    standard = published = True
    settable = (
        Group(
            "adhesion", "tau_W/(G_c/delta_c)", r"$\tau_\mathrm{W}/(G_\mathrm{c}/\delta_\mathrm{c})$", "tau_W",
            ("G_c", "delta_c"), lambda p: p.tau_W / (p.G_c / p.delta_c), lambda p, x: x * p.G_c / p.delta_c,
        ),
    )  # fmt: skip

    def estimate(self, p, rate, width):
        return Estimate(drag=p.tau_W)

    def groups(self, p):
        return {"tau_W/(G_c/delta_c)": p.tau_W / (p.G_c / p.delta_c)}

    def strength(self, t_N, p, state, at):
        return p.tau_W * at.touched
