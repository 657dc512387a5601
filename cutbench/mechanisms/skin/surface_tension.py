"""Surface tension: the energy γ per area of the deformed top, and of what is cut of the cut plane

Soft gels have that of their liquid, 30 to 70 mN/m; what is finer than γ/G it keeps flat. It costs nothing to
cut: the energy of new faces is a part of G_c. Style, Jagota, Hui, Dufresne, Annu. Rev. Condens. Matter Phys.
8 (2017), 10.1146/annurev-conmatphys-031016-025326.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin


class SurfaceTension(Skin):
    """Isotropic, and the same however the surface is stretched."""

    name = "surface_tension"
    title = "surface tension"
    family = "surface"
    surfaces = ("top", "cut")
    parameters = (Parameter.effect("gamma_s", "mN/m", "γ", "surface tension", high=1000.0, typical=50.0),)
    reads = ("G", "thickness")

    def groups(self, p):
        return {"gamma_s/(G a)": p.gamma_s / (p.G * p.thickness / 2)}

    def tension(self, p):
        return p.gamma_s
