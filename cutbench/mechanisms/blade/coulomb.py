"""Coulomb friction on the blade (paper, eq. flow_potential): strength μ t_N."""

from typing import ClassVar

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Blade, Group


class Coulomb(Blade):
    """Shear strength proportional to the contact pressure."""

    name = "coulomb"
    title = "Coulomb friction"
    family = "friction"
    meant = {"friction_coefficient": "mu, the friction coefficient"}  # noqa: RUF012
    role = "friction"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.effect(
            "mu",
            "1",
            "μ",
            "friction coefficient",
            typical=0.2,
            trial=("with a lubricated blade", 0.1),
            unmeasured=(0.5, 2.0),
        ),
    )
    standard = published = True
    settable = (Group("friction", "mu", r"$\mu$", "mu", (), lambda p: p.mu, lambda p, x: x),)

    def groups(self, p):
        return {"mu": p.mu}

    def strength(self, t_N, p, state, at):
        return p.mu * t_N
