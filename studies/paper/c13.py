"""The elastomer's shear modulus, half as large by cutting as by tension: how much of that is locking?

Linear elements are too stiff at ν = 0.49. Who fits G to a cutting curve with them finds a smaller one, by
the factor by which they are too stiff. In a homogeneous strip they are hardly too stiff, so the modulus of
the tension test stays.
"""

from studies.paper.base import CONVERGED, TENSION, Ask, Claim, Finding, near
from studies.paper.reading import force_at, measure, ratio

#: Indentation is compared here: before any cut, mm.
AT_MM = 1.0


def read(runs):
    cut = ratio(force_at(runs["reference"], AT_MM), force_at(runs["base"], AT_MM))
    pull = ratio(measure(runs["strip reference"], "modulus_MPa"), measure(runs["strip"], "modulus_MPa"))
    steady = ratio(measure(runs["reference"], "steady_N"), measure(runs["base"], "steady_N"))
    both = ratio(cut, pull)
    return (
        Finding("G from indentation to 1 mm over true G", "1", "–", cut, near(cut, 0.5)),
        Finding("G from the whole strip in tension over true G", "1", "1", pull, near(pull, 1.0)),
        Finding("G by cutting over G by tension", "1", "about 0.5", both, near(both, 0.5)),
        Finding("G from the steady force over true G", "1", "about 0.5", steady, near(steady, 0.5)),
    )


CLAIM = Claim(
    "C13",
    "The elastomer's G from cutting is about half of its G from tension.",
    {
        "base": Ask("elastomer"),
        "reference": Ask("elastomer", numerics=CONVERGED),
        "strip": Ask("elastomer", depth_mm=0.3, test=TENSION),
        "strip reference": Ask("elastomer", depth_mm=0.3, test=TENSION, numerics=CONVERGED),
    },
    read,
    note="The material is given one G. What a fit with a set of numerics would find is that G times the force"
    " of the converged run over the force of these; without locking it is 1.",
    dissect=True,
)
