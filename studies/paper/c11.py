"""The cohesive law at an opening of a blade's thickness (paper, figure of the traction–separation law)."""

import math

import numpy as np

from cutbench.homogeneous import LoadingHistory
from cutbench.homogeneous.interface import separation
from studies.paper.base import Ask, Claim, Finding, at_least, below
from studies.paper.reading import observed, ratio

#: d is about 1, and the traction has vanished, within this.
ABOUT = 0.01


def read(runs):
    run = runs["base"]
    p = run.case.p
    openings = LoadingHistory.along(np.array([p.delta_c, p.thickness]))
    at_peak, at_blade = separation(openings, run.case.model, p)[:, 0]
    left = ratio(float(at_blade), float(at_peak))
    damage = observed(run, "damage_at_widest")[1]
    found = float(damage[-1]) if damage.size else math.nan
    return (
        Finding("cohesive traction at 0.7 mm over its largest", "1", "vanished (below 0.01 here)", left,
                below(left, ABOUT)),
        Finding("damage where the cut is widest, at the end of the run", "1", "about 1 (0.99 here)", found,
                at_least(found, 1 - ABOUT)),
    )  # fmt: skip


CLAIM = Claim(
    "C11",
    "At an opening of 0.7 mm the cohesive traction has vanished and d is about 1.",
    {"base": Ask("gelatin")},
    read,
)
