"""Adhesion that grows with the distance slid: strength w_s s Θ, s the sliding of a point so far.

A face that is roughened or wears as it is rubbed; Θ is that of the law ``adhesion``.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Blade


class AdhesionWear(Blade):
    """Shear strength proportional to the sliding distance of the material under it."""

    name = "adhesion_wear"
    title = "adhesion by sliding"
    family = "adhesion by sliding"
    role = "adhesion_wear"
    parameters = (
        Parameter.effect(
            "wear", "kPa/mm", "w_s", "shear strength gained for each mm slid", high=1e3, typical=0.2
        ),
    )
    reads = ("G", "height")

    def groups(self, p):
        return {"wear H/G": p.wear * p.height / p.G}

    def strength(self, t_N, p, state, at):
        return p.wear * at.slid * at.touched
