"""A wedge: two flat flanks, an included angle 2α apart, tangent to an edge of radius r and to a band above.

Utility blades have 15 to 30 degrees and edges of 1 to 20 µm. Flank and band go over into one another along an
arc, the shoulder: along a corner the blade's normal, and with it Newton's method, would jump.
"""

from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Group
from cutbench.mechanisms.blade._profile import Profiled, flank
from cutbench.mechanisms.blade._rigid import PLACED

EDGE = Parameter.positive(
    "edge_radius", "mm", "r", "radius of the edge", default=0.02, sought=False, unmeasured=(0.5, 2.0),
    lever="edge",
)  # fmt: skip
SHOULDER = Parameter.positive(
    "shoulder", "mm", "r_s", "radius between flank and band", default=0.35, sought=False
)
#: The radius of the edge in units of half the thickness.
ROUNDNESS = Group(
    "roundness", "r/a", "$r/a$", "edge_radius", ("thickness",),
    lambda p: p.edge_radius / (p.thickness / 2), lambda p, x: x * p.thickness / 2,
)  # fmt: skip


def ground(angle, out, p):
    """A flank, ``angle`` from upright, from the edge to a band that is ``out`` from the apex."""
    r, R = p.edge_radius, p.shoulder
    flat = (out - r * np.cos(angle)) / np.sin(angle) - R * np.tan(angle / 2)
    return flank((1 / r, r * (np.pi / 2 - angle)), (0.0, flat), (1 / R, R * angle), (0.0, np.inf))


def unground(angle, out, p):
    """What is wrong with such a flank: of edge or shoulder the one that leaves no room for it."""
    if p.edge_radius * np.cos(angle) >= out:
        yield (
            "edge_radius",
            f"{p.edge_radius:g} mm",
            f"less than {out / np.cos(angle):.3g} mm, for this thickness",
        )
        return
    room = (out - p.edge_radius * np.cos(angle)) / np.sin(angle) / np.tan(angle / 2)
    if p.shoulder >= room:
        yield "shoulder", f"{p.shoulder:g} mm", f"less than {room:.3g} mm, or no flank is left"


class Wedge(Profiled):
    """Contact with a wedge under a band."""

    name = "wedge"
    title = "contact (wedge)"
    family = "tool"
    edge = ("edge_radius", "its radius")
    settable = (ROUNDNESS,)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.positive("thickness", "mm", "2a", "blade thickness", default=0.7, sought=False),
        Parameter(
            "angle", "deg", "2α", "between the flanks", low=1, high=178, default=20.0, sought=False,
            lever="angle",
        ),
        EDGE,
        SHOULDER,
        *PLACED,
    )  # fmt: skip

    def groups(self, p):
        return {"r/a": p.edge_radius / (p.thickness / 2), "2 alpha": p.angle}

    def flanks(self, p):
        both = ground(p.angle / 2, p.thickness / 2, p)
        return both, both

    def misfits(self, p):
        return unground(p.angle / 2, p.thickness / 2, p)
