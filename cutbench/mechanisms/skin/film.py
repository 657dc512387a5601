"""A film on the top and on both faces of the cut plane that resists bending alone: ½ B (dθ/dS)², B = G t³/3

A cut plane without thickness gives way in folds that are as small as elements are: a cohesive zone stands for
a layer that fails, and this is the stiffness of that layer, on either side, cut or not. Else as
``bending_skin``.
"""

from cutbench.mechanisms.skin._film import stiffness, thickness
from cutbench.mechanisms.skin.bending_skin import BendingSkin


class Film(BendingSkin):
    """Bending stiffness of all faces at the blade."""

    name = "film"
    title = "film on all faces"
    surfaces = ("top", "cut")
    parameters = (stiffness("film_bending", "B_f", "a film on all faces"),)
    settable = (thickness("film_thickness", "film_bending", "a film on all faces"),)
