"""A tougher surface layer: cohesive tractions, and so G_c, times 1 + s e^(−depth/ℓ_s) at equal δ_c."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin
from cutbench.mechanisms.skin._layer import THICKNESS, fading


class ToughSkin(Skin):
    """Toughness that falls off with depth: it delays the start of the cut and leaves the rest alone."""

    name = "tough_skin"
    title = "tough surface layer"
    family = "layered specimen"
    parameters = (
        Parameter.effect(
            "skin_toughness", "1", "s_c", "surface G_c over the block's, less 1", high=100.0, typical=1.0
        ),
        THICKNESS,
    )
    reads = ("height",)

    def groups(self, p):
        return {"skin toughness": p.skin_toughness, "l_s/H": p.skin_thickness / p.height}

    def toughness(self, p, at):
        return 1 + p.skin_toughness * fading(p, at)
