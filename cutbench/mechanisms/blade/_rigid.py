"""What rigid blades have in common, whatever their profile: how they press, and how they lie."""

from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Tool

#: Half-width of the rounded bracket, in units of the blade's half-thickness.
SKIN = 0.01

#: How a blade lies in three dimensions.
PLACED: tuple[Parameter, ...] = (
    Parameter(
        "tilt",
        "deg",
        "φ",
        "turn of the blade about the direction in which it moves (three dimensions)",
        low=-30,
        high=30,
        default=0.0,
        sought=False,
    ),
    Parameter(
        "incline",
        "deg",
        "ψ",
        "angle by which the edge rises along the blade, as a guillotine's (three dimensions)",
        low=-45,
        high=45,
        default=0.0,
        sought=False,
    ),
    Parameter(
        "overhang",
        "mm",
        "l_o",
        "length of the blade beyond each end of the specimen, negative where it is shorter",
        default=0.0,
        sought=False,
    ),
)


class Rigid(Tool):
    """A tool that keeps the material out and lends no shear strength of its own."""

    rank: ClassVar[int] = -10

    def pressure(self, gap, multiplier, stiffness, p):
        """t_N and its slope. The Macaulay bracket is rounded over ``SKIN`` of the blade's half-thickness: a
        kink there makes Newton's method cycle between contact states.
        """
        depth = multiplier / stiffness - gap
        skin = SKIN * p.thickness / 2
        inside = np.real(depth) >= np.real(skin)
        near = ~inside & (np.real(depth) > -np.real(skin))
        bent = (depth + skin) ** 2 / (4 * skin)
        t_N = stiffness * np.where(inside, depth, np.where(near, bent, 0))
        slope = -stiffness * np.where(inside, 1.0, np.where(near, (depth + skin) / (2 * skin), 0))
        return t_N, slope

    def strength(self, t_N, p, state, at):
        return 0 * t_N
