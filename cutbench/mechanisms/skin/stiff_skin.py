"""A stiffer surface layer: all bulk stresses times 1 + s e^(−depth/ℓ_s).

Drying, oxidation or a mould's wall leave gels and elastomers with such a layer. Poisson's ratio and
relaxation times stay what they are below.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin
from cutbench.mechanisms.skin._layer import THICKNESS, fading


class StiffSkin(Skin):
    """Stiffness that falls off with depth."""

    name = "stiff_skin"
    title = "stiff surface layer"
    family = "layered specimen"
    parameters = (
        Parameter.effect(
            "skin_stiffness", "1", "s", "surface modulus over the block's, less 1", high=100.0, typical=2.0
        ),
        THICKNESS,
    )
    reads = ("height",)

    def groups(self, p):
        return {"skin stiffness": p.skin_stiffness, "l_s/H": p.skin_thickness / p.height}

    def stiffness(self, p, at):
        return 1 + p.skin_stiffness * fading(p, at)
