"""The elastomer's curve: smooth, nearly linear, little or no drop (paper, figures 2b and 3b)."""

from studies.paper.base import Ask, Claim, Finding, at_least, below, near
from studies.paper.reading import measure, straightness

#: A curve is nearly linear if a line explains this part of its variance.
NEARLY_LINEAR = 0.97


def read(runs):
    run = runs["base"]
    onset, drop, straight = measure(run, "onset_mm"), measure(run, "drop_rel"), straightness(run)
    return (
        Finding("onset of the cut", "mm", "1.56 mm", onset, near(onset, 1.56)),
        Finding("fall of the force at the transition, relative", "1", "little or none (below 0.1 here)", drop,
                below(drop, 0.1)),
        Finding("R² of a straight line", "1", "nearly linear (0.97 here)", straight,
                at_least(straight, NEARLY_LINEAR)),
    )  # fmt: skip


CLAIM = Claim(
    "C2",
    "Elastomer: smooth, nearly linear, little or no drop; indentation ends at about 1.56 mm.",
    {"base": Ask("elastomer")},
    read,
    note="b was chosen for the first of these on the paper's numerics.",
    dissect=True,
)
