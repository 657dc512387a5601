"""A taut wire of diameter d: a circle with nothing above it, so that the cut closes behind it.

Kamyab, Chakrabarti and Williams (1998), J. Mater. Sci. 33, 2763, cut cheese so: the force per length grows
with d, from the work of separation.
"""

from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.blade._profile import Profiled, flank
from cutbench.mechanisms.blade._rigid import PLACED


class Wire(Profiled):
    """Contact with a wire."""

    name = "wire"
    title = "contact (wire)"
    family = "tool"
    band = False
    edge = ("thickness", "its radius d/2")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.positive("thickness", "mm", "d", "diameter of the wire", default=0.3, sought=False),
        *PLACED,
    )

    def flanks(self, p):
        both = flank((2 / p.thickness, np.pi * p.thickness / 2))
        return both, both

    def edge_radius(self, p):
        return p.thickness / 2

    def edge_for(self, p, radius):
        return 2 * radius

    def height(self, p):
        return p.thickness / 2
