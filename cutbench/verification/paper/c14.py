"""Poisson's ratio a little smaller (paper, footnote on near incompressibility)."""

from cutbench.verification.paper.base import Ask, Claim, Finding, at_least
from cutbench.verification.paper.reading import force_at, measure, ratio

#: Onset or force must move by this part to be called marked.
MARKED = 0.05


def _change(a, b):
    return abs(ratio(a, b) - 1)


def read(runs):
    base, less = runs["base"], runs["less"]
    onset = _change(measure(less, "onset_mm"), measure(base, "onset_mm"))
    force = _change(force_at(less, 2.0), force_at(base, 2.0))
    steady = _change(measure(less, "steady_N"), measure(base, "steady_N"))
    return tuple(
        Finding(f"{what}, ν = 0.47 against 0.49, relative change", "1", "marked (0.05 or more here)", value,
                at_least(value, MARKED))
        for what, value in (("onset of the cut", onset), ("force at 2 mm", force), ("steady force", steady))
    )  # fmt: skip


CLAIM = Claim(
    "C14",
    "A slightly smaller ν changes onset and force markedly.",
    {"base": Ask("gelatin"), "less": Ask("gelatin", {"nu": 0.47})},
    read,
)
