"""A surface with a length ℓ that resists gradients of its deformation: ½ B |Δ₀φ|², B = G ℓ³/3

On the top and on both faces of the cut plane. It resists bends as a film of the block's material does which
is ℓ thick, and gradients of the stretch along it as much: a second-gradient surface energy (Steigmann,
Ogden, Proc. R. Soc. A 455, 1999, 437-474, 10.1098/rspa.1999.0320). A soft surface without a length folds as
finely as elements allow where it is squeezed (Biot, Appl. Sci. Res. A 12, 1963, 168-182), and under a blunt
tip one element can be stretched alone; with it folds and stretches are not much finer than ℓ. No test
measures it: what depends on it is undecided.

The top ends at the cut plane, as where the edge of the blade nicks it as it touches it first: an ellipse
stands for an edge that is sharper than itself. ``whole_surface_gradient`` is not nicked.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin


class SurfaceGradient(Skin):
    """Resistance of all faces at the blade to gradients of their deformation."""

    name = "surface_gradient"
    title = "surface gradient"
    family = "surface"
    role = "gradient"
    standard = True
    surfaces = ("top", "cut")
    continuous = False
    parameters = (
        Parameter(
            "surface_length",
            "mm",
            "ℓ",
            "length of the surface's resistance to gradients; 0: none",
            low=0.0,
            high=1000.0,
            default=0.07,
            sought=False,
            unmeasured=(0.5, 2.0),
        ),
    )
    alternatives = ("whole_surface_gradient",)
    reads = ("G", "thickness")
    meant = {"layer": "surface_length, a length, of the mechanism surface_gradient"}  # noqa: RUF012

    def groups(self, p):
        return {"surface_length/a": p.surface_length / (p.thickness / 2)}

    def gradient(self, p):
        return p.G * p.surface_length**3 / 3
