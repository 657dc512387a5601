"""Imperfect bonding at the base: tangential displacement c t under the traction t, instead of none.

A specimen that is glued through a soft layer, held by friction or by suction. c = 0 is the clamped base.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Support


class ImperfectBond(Support):
    """A base that gives sideways in proportion to the shear on it; it never lifts."""

    name = "imperfect_bond"
    title = "imperfect bonding"
    family = "support"
    role = "bond"
    parameters = (
        Parameter.effect(
            "bond_compliance", "mm/kPa", "c_b", "slip of the base per shear traction", high=1e4, typical=0.3
        ),
    )
    reads = ("G", "height")

    def groups(self, p):
        return {"c_b G/H": p.bond_compliance * p.G / p.height}

    def compliance(self, p):
        return p.bond_compliance
