"""Contact pressure at 13 mm, and where it acts (paper, figure 4c)."""

import math

from cutbench.verification.paper.base import NEAR_PEAK, Ask, Claim, Finding, below, near
from cutbench.verification.paper.reading import observed_at, ratio

AT_MM = 13.0
#: "At the front": within so many tip lengths of the blade's lowest point.
FRONT = 1.5
#: "At the top edge": within so many mm of the top, in the reference state.
EDGE_MM = 1.5
#: "Almost none": behind the tip, the mean pressure is less than this part of the largest.
ALMOST_NONE = 0.05


def _material(name, run, published, front):
    value = observed_at(run, "contact_peak_MPa", AT_MM)
    up = observed_at(run, "contact_peak_above_tip_mm", AT_MM)
    deep = observed_at(run, "contact_peak_depth_mm", AT_MM)
    behind = ratio(observed_at(run, "contact_behind_MPa", AT_MM), value)
    if front:
        place = Finding(f"{name}: height of that place above the blade's lowest point", "mm", "at the front",
                        up, below(up, FRONT * run.case.p.tip))  # fmt: skip
    else:
        place = Finding(f"{name}: depth of that place below the top, unloaded", "mm", "at the top edge",
                        deep, below(deep, EDGE_MM))  # fmt: skip
    return (
        Finding(f"{name}: largest contact pressure at 13 mm", "MPa", f"{published:g} MPa", value,
                near(value, published, within=NEAR_PEAK)),
        place,
        Finding(f"{name}: mean pressure behind the tip, over it", "1", "almost none (below 0.05 here)",
                behind, None if math.isnan(behind) else behind < ALMOST_NONE),
    )  # fmt: skip


def read(runs):
    return (
        *_material("gelatin", runs["gelatin"], 0.04, True),
        *_material("elastomer", runs["elastomer"], 1.2, False),
        *_material("meat", runs["meat"], 0.94, True),
    )


CLAIM = Claim(
    "C8",
    "At 13 mm the largest contact pressure is 0.04 MPa (gelatin, at the front), 1.2 MPa (elastomer, at the"
    " top edge), 0.94 MPa (meat, at the front), almost none behind.",
    {name: Ask(name) for name in ("gelatin", "elastomer", "meat")},
    read,
    beyond="the pattern over the blade's length: with the paper's numerics in docs/solid.md; with the"
    " defaults a block takes hours to 13 mm",
)
