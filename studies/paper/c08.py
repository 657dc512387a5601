"""Contact pressure at 13 mm, and where it acts (paper, figure 4c)."""

from studies.paper.base import NEAR_PEAK, Ask, Claim, Finding, below, near
from studies.paper.reading import observed_at, ratio

COLUMNS = ("peak_MPa", "peak_above_tip_mm", "peak_depth_mm", "behind_MPa")
AT_MM = 13.0
#: "At the front": within so many tip lengths of the blade's lowest point.
FRONT = 1.5
#: "At the top edge": within so many mm of the top, in the reference state.
EDGE_MM = 1.5
#: "Almost none": behind the tip, the mean pressure is less than this part of the largest.
ALMOST_NONE = 0.05


def _material(name, run, published, front):
    value, up, deep, behind = (observed_at(run, f"contact_{column}", AT_MM) for column in COLUMNS)
    behind = ratio(behind, value)
    if front:
        what, where = f"{name}: height of that place above the blade's lowest point", "at the front"
        place = Finding(what, "mm", where, up, below(up, FRONT * run.case.model.tool.height(run.case.p)))
    else:
        what, where = f"{name}: depth of that place below the top, unloaded", "at the top edge"
        place = Finding(what, "mm", where, deep, below(deep, EDGE_MM))
    return (
        Finding(f"{name}: largest contact pressure at 13 mm", "MPa", f"{published:g} MPa", value,
                near(value, published, within=NEAR_PEAK)),
        place,
        Finding(f"{name}: mean pressure behind the tip, over it", "1", "almost none (below 0.05 here)",
                behind, below(behind, ALMOST_NONE)),
    )  # fmt: skip


def read(runs):
    told = (("gelatin", 0.04, True), ("elastomer", 1.2, False), ("meat", 0.94, True))
    return tuple(finding for name, *published in told for finding in _material(name, runs[name], *published))


CLAIM = Claim(
    "C8",
    "At 13 mm the largest contact pressure is 0.04 MPa (gelatin, at the front), 1.2 MPa (elastomer, at the"
    " top edge), 0.94 MPa (meat, at the front), almost none behind.",
    {name: Ask(name) for name in ("gelatin", "elastomer", "meat")},
    read,
    beyond="the pattern over the blade's length: with the paper's numerics in docs/validation/published3d.md;"
    " with the defaults no block has gone to 13 mm",
)
