"""Coulomb friction against adhesion in steady cutting (paper, section on adhesion)."""

from studies.paper.base import Ask, Claim, Finding, below
from studies.paper.reading import measure, ratio, share

#: Steady cutting is looked at from here on, mm.
FROM_MM = 8.0
#: A share is negligible below this.
NEGLIGIBLE = 0.1


def read(runs):
    with_, without = runs["base"], runs["without"]
    part = share(with_, "coulomb", "adhesion", FROM_MM)
    more = 1 - ratio(measure(without, "steady_N"), measure(with_, "steady_N"))
    return (
        Finding("elastomer: work of Coulomb friction over that of adhesion from 8 mm on", "1",
                "negligible (below 0.1 here)", part, below(part, NEGLIGIBLE)),
        Finding("elastomer: part of the steady force that goes with μ", "1", "negligible (below 0.1 here)",
                more, below(more, NEGLIGIBLE)),
    )  # fmt: skip


CLAIM = Claim(
    "C10",
    "In steady cutting Coulomb friction is negligible against adhesion.",
    {"base": Ask("elastomer"), "without": Ask("elastomer", {"mu": 0.0})},
    read,
    note="Gelatin and meat have μ = 0 in the paper's table, so only the elastomer can tell.",
)
