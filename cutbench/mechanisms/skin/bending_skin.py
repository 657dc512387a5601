"""A film on the top that resists bending alone: ½ B (dθ/dS)², B = G t³/3

θ is its angle along the length S before loading. Drying leaves such a film. It is continuous across the cut
plane until that is cut, and has a free edge there then. B is 4 G t³/12, that of a plate in plane strain which
is t thick and as soft as the block.
"""

from typing import ClassVar

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Group, Skin
from cutbench.mechanisms.skin._film import stiffness, thickness


class BendingSkin(Skin):
    """Bending stiffness of the top."""

    name = "bending_skin"
    title = "film on the top"
    family = "surface"
    surfaces: ClassVar[tuple[str, ...]] = ("top",)
    parameters: ClassVar[tuple[Parameter, ...]] = (stiffness("skin_bending", "B_s", "a film on the top"),)
    reads = ("G", "thickness")
    settable: ClassVar[tuple[Group, ...]] = (
        thickness("bent_thickness", "skin_bending", "a film on the top"),
    )

    def groups(self, p):
        return {f"{film.name}/a": film.value(p) / (p.thickness / 2) for film in self.settable}

    def bending(self, p):
        return sum(getattr(p, film.parameter) for film in self.settable)
