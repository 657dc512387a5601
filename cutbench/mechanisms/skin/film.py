"""A film on the top and on both faces of the cut plane that resists bending alone: ½ B (dθ/dS)², B = G t³/3

A cut plane without thickness gives way in folds that are as small as elements are: a cohesive zone stands for
a layer that fails, and this is the stiffness of that layer, on either side, cut or not. Else as
``bending_skin``.
"""

from cutbench.mechanisms.base import Skin
from cutbench.mechanisms.skin._film import stiffness, thickness

FILM = thickness("film_thickness", "film_bending", "a film on all faces")


class Film(Skin):
    """Bending stiffness of all faces at the blade."""

    name = "film"
    title = "film on all faces"
    family = "surface"
    surfaces = ("top", "cut")
    parameters = (stiffness("film_bending", "B_f", "a film on all faces"),)
    reads = ("G", "thickness")
    settable = (FILM,)

    def groups(self, p):
        return {"film_thickness/a": FILM.value(p) / (p.thickness / 2)}

    def bending(self, p):
        return p.film_bending
