"""The elastomer without Coulomb friction (paper, supplementary figure on mu = 0)."""

from studies.paper.base import Ask, Claim, Finding, at_least, near
from studies.paper.reading import measure, ratio

#: The fall must grow by this much to be called more abrupt.
MORE = 0.02


def read(runs):
    with_, without = runs["base"], runs["without"]
    more = measure(without, "drop_rel") - measure(with_, "drop_rel")
    slopes = ratio(*(measure(run, "slope_N_per_mm") for run in (without, with_)))
    return (
        Finding("fall of the force with μ = 0, less that with 0.35", "1", "more abrupt (0.02 or more here)",
                more, at_least(more, MORE)),
        Finding("slope with μ = 0 over that with μ = 0.35", "1", "the same (within 15 % here)", slopes,
                near(slopes, 1.0)),
    )  # fmt: skip


CLAIM = Claim(
    "C4",
    "Elastomer with μ = 0: a more abrupt transition, the same slope afterwards.",
    {"base": Ask("elastomer"), "without": Ask("elastomer", {"mu": 0.0})},
    read,
)
