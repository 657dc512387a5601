"""Gelatin's curve: indentation to about 4 mm, a sharp drop, a linear rise (paper, figures 2a and 3a)."""

from cutbench.run.measures import label
from studies.paper.base import Ask, Claim, Finding, at_least, near
from studies.paper.reading import end_of_indentation, measure

#: Rise of the force by adhesion on both sides of the blade, 2 τ_W L, with τ_W = 0.8 kPa and L = 30 mm.
RISE_N_PER_MM = 0.048


def read(runs):
    run = runs["base"]
    end, drop = end_of_indentation(run), measure(run, "drop_rel")
    slope = measure(run, "slope_N_per_mm")
    return (
        Finding("end of indentation", "mm", "4.19 mm", end, near(end, 4.19)),
        Finding(
            "fall of the force at the transition, relative", "1", "sharp (0.1 or more here)", drop,
            None if drop != drop else label(drop) == "abrupt",
        ),
        Finding("slope after it", "N/mm", "linear rise; 2 τ_W L = 0.048 N/mm", slope,
                at_least(slope, 0.5 * RISE_N_PER_MM)),
    )  # fmt: skip


CLAIM = Claim(
    "C1",
    "Gelatin: indentation ends at 4.19 mm, then a sharp drop, then a linear rise.",
    {"base": Ask("gelatin")},
    read,
    note="b was chosen for the first of these, on the paper's numerics. Half of 2 τ_W L or more holds."
    " The paper's elements let the force fall again and again, once for each that the front passes; the fall"
    " at the transition is the first of these.",
    dissect=True,
)
