"""Toughness that grows as a power of the opening rate: T = (δ̇/v_0)^n T_cohesive while the faces part.

Beside the cohesive law that is G_c (1 + (v/v_0)^n), as wires through gelatin and the peeling and tearing of
viscoelastic solids have it (Gent & Schultz, J. Adhesion 3 (1972) 281, 10.1080/00218467208072199; Maugis &
Barquins, J. Phys. D 11 (1978) 1989, 10.1088/0022-3727/11/14/011): v_0 is the rate at which faces part where
toughness is twice its threshold. A front of a steady shape opens in proportion to its own speed.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.cut.rate_toughness import RateToughness

#: Where δ̇/v_0 is less than this, the power goes over to a straight line: at 0 it has no slope.
STRAIGHT = 0.01


class PowerToughness(RateToughness):
    """The cohesive traction, stronger by a power of the rate of opening."""

    name = "power_toughness"
    title = "rate toughness (power)"
    parameters = (
        Parameter(
            "inv_v_0", "s/mm", "1/v_0", "one over the opening rate of twice the toughness",
            low=0.0, high=1e6, off=0.0, default=0.0, typical=1.0,
        ),
        Parameter(
            "rate_exponent", "1", "n", "exponent of the rate", low=0.05, high=2.0, default=0.5, typical=0.3
        ),
    )  # fmt: skip

    def groups(self, p):
        return {"v/v_0": p.speed * p.inv_v_0, "n": p.rate_exponent}

    def growth(self, rate, p):
        x = rate * p.inv_v_0
        return x * (x + STRAIGHT) ** (p.rate_exponent - 1)
