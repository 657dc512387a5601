"""A section's mesh drawn out along the blade: prisms, each of three tetrahedra.

What a section resolves a block then resolves as well, and in every layer alike: functions on the section's
elements that are constant along the blade are among those on the block's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import skfem

from cutbench.forms.geometry import Geometry
from cutbench.models3d.mesh import tetrahedra


def planes(half: float, layers: int, ratio: float = 1.0) -> np.ndarray:
    """Places (layers + 1,) from 0 in the middle of the blade to ``half`` of its length: the layer in the
    middle is ``ratio`` times as thick as that at the end, and those between go down in equal proportion."""
    thick = ratio ** -np.linspace(0.0, 1.0, layers)
    return half * np.concatenate([[0.0], np.cumsum(thick) / thick.sum()])


def extruded(section: skfem.MeshTri, z: np.ndarray) -> skfem.MeshTet:
    """``section`` in all ``planes`` z (layers + 1,), without names.

    Tetrahedra conform, because each prism is cut by the numbers of its corners.
    """
    n = section.p.shape[1]
    p = np.vstack([np.tile(section.p, z.size), np.repeat(z, n)])
    a, b, c = np.sort(section.t, axis=0)
    prism = np.hstack([(a, b, c, c + n), (a, b, b + n, c + n), (a, a + n, b + n, c + n)])
    return tetrahedra(p, np.hstack([prism + n * k for k in range(z.size - 1)]))


def drawn_out(section: Geometry, length: float, layers: int, ratio: float, part: str) -> Geometry:
    """The ``part`` of a block ``length`` mm long whose ``section`` is half of one, or, of a full block, the
    whole, split; with so many ``layers`` along half of the blade."""
    z = planes(length / 2, layers, ratio)
    if part != "quarter":
        z = np.append(-z[:0:-1], z)
    multiplicity = {"quarter": 4.0, "half": 2.0, "full": 1.0}[part]
    held = (("middle", 2),) if part == "quarter" else ()
    mesh = extruded(section.mesh, z)
    return replace(section, mesh=mesh, multiplicity=multiplicity, held=held, section=section.mesh, planes=z)
