"""A film on the top that resists bending alone: ½ B (dθ/dS)², B = G t³/3

θ is its angle along the length S before loading. Drying leaves such a film. It is continuous across the cut
plane until that is cut, and has a free edge there then. B is 4 G t³/12, that of a plate in plane strain which
is t thick and as soft as the block.
"""

from cutbench.mechanisms.base import Skin
from cutbench.mechanisms.skin._film import stiffness, thickness

BENT = thickness("bent_thickness", "skin_bending", "a film on the top")


class BendingSkin(Skin):
    """Bending stiffness of the top."""

    name = "bending_skin"
    title = "film on the top"
    family = "surface"
    surfaces = ("top",)
    parameters = (stiffness("skin_bending", "B_s", "a film on the top"),)
    reads = ("G", "thickness")
    settable = (BENT,)

    def groups(self, p):
        return {"bent_thickness/a": BENT.value(p) / (p.thickness / 2)}

    def bending(self, p):
        return p.skin_bending
