"""Plates that hold the faces of what they press: it bulges, and is stiffer than one whose faces slide.

A cylinder of diameter D and height h whose faces are held takes 1 + 2 S² times the force, with S = D/(4 h)
its loaded area over its free one (Gent & Lindley 1959, 10.1243/PIME_PROC_1959_173_022_02), of the cylinder as
it is then: at constant volume S² grows as λ⁻³. Between held and sliding faces it is a part of that.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Rig


class HeldFaces(Rig):
    """Plates without a lubricant: what is pressed between them seems stiffer, the flatter it is."""

    name = "held_faces"
    title = "faces held by the plates"
    family = "held faces"
    rank = -2  # it is the specimen's own force
    kinds = ("uniaxial",)
    parameters = (
        Parameter.effect("holding", "1", "h", "part of the faces that is held", low=0, high=1, typical=0.5),
    )

    def groups(self, p):
        return {"h": p.holding}

    def record(self, displacement, force, time, p):
        stretch = 1 + np.minimum(np.real(displacement), 0.0) / getattr(p, "specimen_length", np.inf)
        stiffer = 1 + 2 * p.holding * getattr(p, "shape_factor", 0.0) ** 2 / stretch**3
        return displacement, np.where(np.real(displacement) < 0, force * stiffer, force)
