"""A strip in tension, whole or notched in the middle of one side: a quarter of it by symmetry.

x runs along the pull from the middle of the strip (x = 0, the plane in which it tears), y across it with
the notch at the top, z through its thickness from the middle.
"""

from __future__ import annotations

import numpy as np
import skfem

from cutbench.forms.geometry import Geometry
from cutbench.models3d.mesh import outside, tetrahedra

#: Growth of the element size with the distance from the notch's tip.
GROWTH = 0.3
#: Largest element in widths: the clamps' hold reaches about a width into the strip.
LARGEST = 0.2
#: Layers of elements through half of the thickness, at least.
LAYERS = 2


def strip(width: float, between: float, thickness: float, notch: float, h: float) -> Geometry:
    """A strip ``width`` wide, ``between`` the clamps long, with a notch ``notch`` long (0: none), all mm.

    Elements at the notch's tip have size ``h``. Faces: "cut", what is left of the plane x = 0; "notch", the
    open part of it; "clamp" at x = between/2, held there; "middle" at z = 0, a plane of symmetry; "top" at
    y = width.
    """
    tip = width - notch
    most = max(h, LARGEST * width)
    x = _away(between / 2, h, most)
    above = (tip + _away(notch, h, most))[1:] if notch else np.zeros(0)
    y = np.concatenate([tip - _away(tip, h, most)[::-1], above])
    z = np.linspace(0, thickness / 2, max(LAYERS, int(np.ceil(thickness / 2 / (4 * h)))) + 1)
    box = skfem.MeshTet.init_tensor(x, y, z)
    mesh = tetrahedra(box.p, box.t)
    outer, (X, Y, Z), at = outside(mesh, eps := 1e-9 * between)
    plane, left = at(X, 0.0), np.all(tip + eps > Y, axis=0)
    faces = {
        "cut": plane & left,
        "notch": plane & ~left,
        "clamp": at(X, between / 2),
        "middle": at(Z, 0.0),
        "top": at(Y, width),
    }
    mesh = mesh.with_boundaries({name: outer[chosen] for name, chosen in faces.items() if chosen.any()})
    # The force on a clamp is that of half the thickness, twice.
    return Geometry(mesh, width, 2.0, (("middle", 2),), clamped="clamp")


def _away(length: float, h: float, most: float) -> np.ndarray:
    """Places from 0 to ``length``, at distances that grow from ``h`` to ``most``."""
    steps = [h]
    while sum(steps) < length:
        steps.append(min(h + GROWTH * sum(steps), most))
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * (length / places[-1])
