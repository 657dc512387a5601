"""Error of the contact point: the recorded displacement is the true one plus u₀.

u₀ > 0 where the zero was set before the blade touched, u₀ < 0 where it was set late.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Rig


class ContactOffset(Rig):
    """A shift of the zero of the displacement."""

    name = "contact_offset"
    title = "contact-point offset"
    family = "reading"
    cause = "reading"
    approach = "displacement"
    rank = 1
    parameters = (
        Parameter.effect("offset", "mm", "u_0", "displacement recorded at contact", low=None, typical=0.2),
    )
    reads = ("height",)

    def groups(self, p):
        return {"u_0/H": p.offset / p.height}

    def record(self, displacement, force, time, p):
        return displacement + p.offset, force
