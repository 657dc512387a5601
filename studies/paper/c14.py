"""Poisson's ratio a little smaller (paper, footnote on near incompressibility)."""

from studies.paper.base import Ask, Claim, Finding, at_least
from studies.paper.reading import force_at, measure, ratio

#: Onset or force must move by this part to be called marked.
MARKED = 0.05


def read(runs):
    base, less = runs["base"], runs["less"]

    def moved(what, of):
        value = abs(ratio(of(less), of(base)) - 1)
        what = f"{what}, ν = 0.47 against 0.49, relative change"
        return Finding(what, "1", "marked (0.05 or more here)", value, at_least(value, MARKED))

    return (
        moved("onset of the cut", lambda run: measure(run, "onset_mm")),
        moved("force at 2 mm", lambda run: force_at(run, 2.0)),
        moved("steady force", lambda run: measure(run, "steady_N")),
    )


CLAIM = Claim(
    "C14",
    "A slightly smaller ν changes onset and force markedly.",
    {"base": Ask("gelatin"), "less": Ask("gelatin", {"nu": 0.47})},
    read,
)
