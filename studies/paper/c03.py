"""Meat's curve: a peak at 8 to 10 mm, a plateau of 12 to 16 N, no drop (paper, figures 2c and 3c)."""

from studies.paper.base import Ask, Claim, Finding, below, near
from studies.paper.reading import end_of_indentation, mean_force, measure


def read(runs):
    run = runs["base"]
    end, drop = end_of_indentation(run), measure(run, "drop_rel")
    plateau = mean_force(run, 10.0, 14.0)
    return (
        Finding("place of the peak", "mm", "8–10 mm (9.76 mm)", end, near(end, 8.0, 10.0)),
        Finding("mean force from 10 to 14 mm", "N", "12–16 N", plateau,
                near(plateau, 12.0, 16.0, within=0.0)),
        Finding("fall of the force at the transition, relative", "1", "none (below 0.1 here)", drop,
                below(drop, 0.1)),
    )  # fmt: skip


CLAIM = Claim(
    "C3",
    "Meat: peak at 8–10 mm (9.76 mm), plateau of 12–16 N, no drop.",
    {"base": Ask("meat")},
    read,
    note="b was chosen for the first of these on the paper's numerics.",
    dissect=True,
)
