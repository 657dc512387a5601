"""The blade as a shape: its section, and its surface as a mesh."""

from __future__ import annotations

import meshio
import numpy as np

from cutbench.case.case import Case
from cutbench.forms.blade_gap import Lie


def blade_outline(case: Case, travel_mm: float, top_mm: float) -> np.ndarray:
    """The blade's section (n, 2), mm: its profile, the apex at height − travel, a band up to ``top_mm``."""
    tool = case.model.tool
    assert tool is not None, "a section is that of a cut"
    profile = tool.outline(case.p) + np.array([0.0, case.p.height - travel_mm])
    if not tool.band:
        return profile
    ends = profile[[0, -1]]
    ends[:, 1] = np.maximum(ends[:, 1], top_mm)
    return np.vstack([ends[:1], profile, ends[1:]])


def blade_mesh(case: Case, travel_mm: float, top_mm: float) -> meshio.Mesh:
    """The blade's surface where it first touches, and ``displacement_mm`` (n, 3), its way to ``travel_mm``.

    Of a section one polygon; of a block the profile along the blade, turned by tilt and incline, closed by a
    polygon at each end. A band ends at ``top_mm``.
    """
    outline = blade_outline(case, 0.0, top_mm)
    if np.allclose(outline[0], outline[-1]):
        outline = outline[:-1]
    n = len(outline)
    loop = np.arange(n)
    if case.dim == 2:
        points = np.column_stack([outline, np.zeros(n)])
        cells = [("polygon", loop[None])]
    else:
        v, lie = case.values, Lie.of(case.p)
        end, (x, y) = v["length"] / 2 + v.get("overhang", 0.0), outline.T
        apex, places = case.p.height, []
        for z in (-end, end):
            up, along = lie.ci * (y - apex) + lie.si * z, lie.ci * z - lie.si * (y - apex)
            height = apex + lie.lift + up
            places.append(np.column_stack([lie.c * x + lie.s * along, height, lie.c * along - lie.s * x]))
        points = np.concatenate(places)
        on = np.roll(loop, -1)
        sides, closed = np.column_stack([loop, on, on + n, loop + n]), np.stack([loop[::-1], loop + n])
        cells = [("quad", sides), ("polygon", closed)]
    way = np.zeros_like(points)
    way[:, 1] = -travel_mm
    return meshio.Mesh(points, cells, point_data={"displacement_mm": way})
