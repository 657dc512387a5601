"""Contact pressure before and after gelatin's onset (paper, figure 4b)."""

from studies.paper.base import NEAR_PEAK, Ask, Claim, Finding, below, near
from studies.paper.c05 import GELATIN
from studies.paper.reading import end_of_indentation, largest_until, measure, median_from, ratio

#: 0.035/0.27 in the paper; a fall to half of the pressure or less is called sharp here.
SHARP = 0.5


def read(runs):
    run = runs["base"]
    end = end_of_indentation(run)
    before = largest_until(run, "contact_peak_MPa", end)
    after = median_from(run, "contact_peak_MPa", measure(run, "onset_mm") + 4.0)
    fall = ratio(after, before)
    first, then = (measure(runs["block"], f"front_pressure_{part}_MPa") for part in ("before", "after"))
    return (
        Finding("largest contact pressure up to the end of indentation", "MPa", "0.27 MPa", before,
                near(before, 0.27, within=NEAR_PEAK)),
        Finding("largest contact pressure in steady cutting", "MPa", "0.035 MPa", after,
                near(after, 0.035, within=NEAR_PEAK)),
        Finding("the second over the first", "1", "0.13 (0.5 or less here)", fall,
                below(fall, SHARP)),
        Finding("block: largest contact pressure until the cut starts", "MPa", "0.27 MPa", first,
                near(first, 0.27, within=NEAR_PEAK), solid=True),
        Finding("block: largest once the cut has reached the end, over it", "1", "0.13 (0.5 or less here)",
                ratio(then, first), below(ratio(then, first), SHARP), solid=True),
    )  # fmt: skip


CLAIM = Claim(
    "C7",
    "Gelatin: the largest contact pressure is 0.27 MPa just before the onset and 0.035 MPa after it.",
    {"base": Ask("gelatin"), "block": GELATIN},
    read,
)
