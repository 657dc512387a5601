"""A one-sided bevel: an upright flank on the left, a flat one at an angle to it on the right, a band above.

Chisels and many knives are ground so. Edge and shoulder are rounded as in ``wedge``. The cut is not
symmetric: the whole section is meshed. The edge's lowest point runs along the cut plane.
"""

from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.blade._profile import Profiled, flank
from cutbench.mechanisms.blade._rigid import PLACED
from cutbench.mechanisms.blade.wedge import EDGE, ROUNDNESS, SHOULDER, ground, unground


class Bevel(Profiled):
    """Contact with a blade that is ground on one side."""

    name = "bevel"
    title = "contact (bevel)"
    family = "tool"
    edge = ("edge_radius", "its radius")
    settable = (ROUNDNESS,)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.positive("thickness", "mm", "2a", "blade thickness", default=0.7, sought=False),
        Parameter(
            "bevel_angle", "deg", "β", "of the ground flank", low=1, high=80, default=20.0, sought=False
        ),
        EDGE,
        SHOULDER,
        *PLACED,
    )

    def groups(self, p):
        return {"r/a": p.edge_radius / (p.thickness / 2), "beta": p.bevel_angle}

    def flanks(self, p):
        r = p.edge_radius
        upright = flank((1 / r, r * np.pi / 2), (0.0, np.inf))
        return ground(p.bevel_angle, p.thickness - r, p), upright

    def misfits(self, p):
        return unground(p.bevel_angle, p.thickness - p.edge_radius, p)
