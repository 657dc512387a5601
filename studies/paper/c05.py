"""Where the cut starts along the blade (paper, figure 4a)."""

from studies.paper.base import BLOCK, Ask, Claim, Finding, at_least, below
from studies.paper.reading import measure

#: Deep enough for the cut to reach the end, mm.
DEPTH_MM = 5.0
#: The middle: within this part of the blade's half-length.
MIDDLE = 0.5
#: What every claim about gelatin's front asks for.
GELATIN = Ask("gelatin", depth_mm=DEPTH_MM, test=BLOCK)


def read(runs):
    run = runs["block"]
    place = abs(measure(run, "front_start_z_mm"))
    later = measure(run, "front_edge_mm") - measure(run, "front_centre_mm")
    return (
        Finding("gelatin: distance from the middle at which the cut starts", "mm", "0 (7.5 mm or less here)",
                place, below(place, MIDDLE * run.case.p.length / 2), solid=True),
        Finding("gelatin: travel at its start at the end less that at the middle", "mm", "more than 0", later,
                at_least(later, 1e-6), solid=True),
    )  # fmt: skip


CLAIM = Claim(
    "C5",
    "The cut starts at the middle of the blade and runs to its edges.",
    {"block": GELATIN},
    read,
    changes=(),
)
