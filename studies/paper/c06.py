"""Von Mises stress where the cut starts (paper, figure 4a.7-9)."""

from studies.paper.base import NEAR_PEAK, Ask, Claim, Finding, near
from studies.paper.c05 import GELATIN
from studies.paper.reading import measure, median_from, observed_at, ratio


def read(runs):
    run = runs["base"]
    onset = measure(run, "onset_mm")
    start = observed_at(run, "von_mises_peak_MPa", onset)
    later = median_from(run, "von_mises_peak_MPa", onset + 4.0)
    first, running = (measure(runs["block"], f"front_von_mises_{part}_MPa") for part in ("start", "running"))
    return (
        Finding("largest σ_vM on the cut plane at the onset", "MPa", "0.03 MPa", start,
                near(start, 0.03, within=NEAR_PEAK)),
        Finding("the same in steady cutting", "MPa", "0.03 MPa (while the front runs)", later,
                near(later, 0.03, within=NEAR_PEAK)),
        Finding("block: σ_vM in the process zone where the cut starts", "MPa", "0.03 MPa", first,
                near(first, 0.03, within=NEAR_PEAK), solid=True),
        Finding("block: the same where the front comes later, over it", "1", "the same (within 15 % here)",
                ratio(running, first), near(ratio(running, first), 1.0), solid=True),
    )  # fmt: skip


CLAIM = Claim(
    "C6",
    "σ_vM is about 0.03 MPa where and when the cut starts, and the same as the front runs.",
    {"base": Ask("gelatin"), "block": GELATIN},
    read,
    note="A mean over the elements at each node, so it says what elements of that size can see.",
)
