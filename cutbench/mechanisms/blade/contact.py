"""Unilateral contact with the rigid blade (paper, eq. KKT and normal_traction_augmented).

t_N = ⟨λ − ε g⟩ with the gap g > 0 outside. The blade's section is an elliptic tip (semi-axes a, b)
under a band of thickness 2a. The paper never gives b.
"""

from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Group
from cutbench.mechanisms.blade._rigid import PLACED, Rigid
from cutbench.mechanisms.blade._tool import distance, ellipse


class Contact(Rigid):
    """The blade keeps the material out; it lends no shear strength of its own."""

    name = "contact"
    title = "contact"
    family = "tool"
    standard = published = True
    edge = ("tip", "its radius a^2/b")
    settable = (
        Group(
            "sharpness", "b/a", "$b/a$", "tip", ("thickness",),
            lambda p: p.tip / (p.thickness / 2), lambda p, x: x * p.thickness / 2,
        ),
    )  # fmt: skip
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.positive("thickness", "mm", "2a", "blade thickness", default=0.7, sought=False),
        Parameter.positive(
            "tip",
            "mm",
            "b",
            "length of the elliptic tip",
            default=1.05,
            lever="tip",
            sought=False,
            trial=("with a tip twice as long", 2.0),
            unmeasured=(0.5, 2.0),
        ),
        *PLACED,
    )

    def groups(self, p):
        return {"b/a": 2 * p.tip / p.thickness}

    def half_axes(self, p):
        """a and b of the tip, mm."""
        return p.thickness / 2, p.tip

    def distance(self, x, y, p):
        a, b = self.half_axes(p)
        return distance(x, y - b, a, b)

    def number(self, x, y, p):
        """The paper's dimensionless gap in place of the distance."""
        a, b = self.half_axes(p)
        return ellipse(x, y - b, a, b)

    def outline(self, p):
        a, b = self.half_axes(p)
        angle = np.linspace(np.pi, 2 * np.pi, 121)
        return np.column_stack([a * np.cos(angle), b * (1 + np.sin(angle))])

    def edge_radius(self, p):
        a, b = self.half_axes(p)
        return a**2 / b

    def edge_for(self, p, radius):
        return (p.thickness / 2) ** 2 / radius

    def height(self, p):
        return self.half_axes(p)[1]
