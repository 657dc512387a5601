"""A block twice as wide (paper, supplementary figure on boundary conditions; an experiment there)."""

from studies.paper.base import Ask, Claim, Finding, near
from studies.paper.reading import measure, ratio


def read(runs):
    def kept(what, name):
        value = ratio(measure(runs["wide"], name), measure(runs["base"], name))
        return Finding(what, "1", "the same (within 15 % here)", value, near(value, 1.0))

    return (
        kept("steady force, 60 mm over 30 mm", "steady_N"),
        kept("steady slope, 60 mm over 30 mm", "slope_N_per_mm"),
    )


CLAIM = Claim(
    "C9",
    "Gelatin 60 mm wide instead of 30 mm: the same steady slope and level.",
    {"base": Ask("gelatin"), "wide": Ask("gelatin", {"width": "60 mm"})},
    read,
    note="The paper shows experiments for it, no simulation.",
)
