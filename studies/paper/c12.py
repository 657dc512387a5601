"""Notched strips in tension (paper, supplementary figure of tensile tests)."""

from studies.paper.base import NOTCHED, TENSION, Ask, Claim, Finding, below
from studies.paper.reading import measure, ratio

#: A strip is as long as this, mm, and is pulled to twice that at the most.
LONG_MM = 30.0
MATERIALS = ("gelatin", "elastomer", "meat")


def read(runs):
    found = []
    for name in MATERIALS:
        notched, whole = runs[name], runs[f"{name}, whole"]
        what, onset = f"{name}: elongation at which the notch begins to run", measure(notched, "onset_mm")
        found.append(Finding(what, "mm", "before twice the length", onset, below(onset, LONG_MM), solid=True))
        what = f"{name}: largest force, over that of a whole strip pulled to twice its length"
        left = ratio(measure(notched, "max_N"), measure(whole, "max_N"))
        found.append(Finding(what, "1", "less than 1", left, below(left, 1.0), solid=True))
    return tuple(found)


CLAIM = Claim(
    "C12",
    "Notched strips (12 × 30 × 3 mm, notch 2.4 mm) in tension, up to the cut.",
    {name: Ask(name, depth_mm=LONG_MM, test=NOTCHED) for name in MATERIALS}
    | {f"{name}, whole": Ask(name, depth_mm=LONG_MM, test=TENSION) for name in MATERIALS},
    read,
    changes=(),
    note="The paper gives the curves as pictures: what is held against is that the notch runs, and first.",
)
