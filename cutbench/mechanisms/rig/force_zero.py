"""Error of the force's zero: the recorded force is the true one plus F₀."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Rig


class ForceZero(Rig):
    """A shift of the zero of the force."""

    name = "force_zero"
    title = "load-cell zero"
    family = "reading"
    cause = "reading"
    approach = "force"
    rank = 3  # the machine gives under the true force
    parameters = (
        Parameter.effect("zero", "N", "F_0", "force recorded where there is none", low=None, typical=0.01),
    )
    reads = ("G", "length")

    def groups(self, p):
        return {"F_0/(G L^2)": p.zero / (p.G * p.length**2)}

    def record(self, displacement, force, time, p):
        return displacement, force + p.zero
