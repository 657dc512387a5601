"""A block twice as wide (paper, supplementary figure on boundary conditions; an experiment there)."""

from cutbench.verification.paper.base import Ask, Claim, Finding, near
from cutbench.verification.paper.reading import measure, ratio


def _ratio(runs, name):
    return ratio(measure(runs["wide"], name), measure(runs["base"], name))


def read(runs):
    slope, level = _ratio(runs, "slope_N_per_mm"), _ratio(runs, "steady_N")
    return (
        Finding(
            "steady force, 60 mm over 30 mm", "1", "the same (within 15 % here)", level, near(level, 1.0)
        ),
        Finding(
            "steady slope, 60 mm over 30 mm", "1", "the same (within 15 % here)", slope, near(slope, 1.0)
        ),
    )


CLAIM = Claim(
    "C9",
    "Gelatin 60 mm wide instead of 30 mm: the same steady slope and level.",
    {"base": Ask("gelatin"), "wide": Ask("gelatin", {"width": "60 mm"})},
    read,
    note="The paper shows experiments for it, no simulation.",
)
