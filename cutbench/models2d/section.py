"""Meshes of the plane-strain section, graded towards the cut plane by scikit-fem alone.

x is the distance from the cut plane (x = 0), y the height; the blade comes from above along y.
"""

from __future__ import annotations

import numpy as np
import skfem
from scipy.optimize import brentq

from cutbench.case.mesh_sizes import STANDARD, wanted
from cutbench.case.tuning import MeshTuning

#: Elements at the cut plane are this many times taller than wide: under the tip, and beside a cut that it
#: forces open, the material is stretched sideways several times. Small ones slenderer than that fold.
SLENDER = 2.0


def half_block(
    width: float,
    height: float,
    h: float,
    *,
    corner: float | None = None,
    slender: float = SLENDER,
    reach: float = 0.3,
    shallow: float = 1.0,
    surge: float = 1.0,
    rim: float = 0.0,
    tuning: MeshTuning = STANDARD,
    fine: tuple[float, float] = (0.0, np.inf),
    kept: np.ndarray | None = None,
    largest: float = np.inf,
) -> skfem.MeshTri:
    """Right half of the block, 0 ≤ x ≤ width/2, with faces "cut", "top", "bottom", "side".

    Element edges on the cut plane are the largest H/(n 2^k) not above ``h``. Where the cut surges, down to
    ``surge``, they are ``shallow`` times as tall, and grow with depth from there, to what is ``largest`` at
    the most. Under the blade, from
    where the top face meets the cut plane down to ``reach``, they shrink to ``corner``: there the tip indents
    before anything is cut, and the cut begins. On the top they are smaller than where the cut surges, out to
    ``rim``, until the front has left, and as long as something is kept there.
    All this between the two depths ``fine``, and at the places ``kept`` (2, n); elsewhere they grow with the
    distance from there.
    Across the cut plane they are ``slender`` times smaller, growing to the same size over ``reach``.
    """

    def across(xi):
        return xi - (1 - 1 / slender) * reach * -np.expm1(-xi / reach)

    if kept is not None:
        line = np.linspace(0, width / 2 + reach, 4000)
        kept_at = np.stack([np.interp(kept[0], across(line), line), kept[1]])
        folded = ((kept_at[0] < rim) & (kept_at[1] > height - rim / 4)).any()
        # Of a fold it is all or nothing: on elements of many sizes it rolls in jumps.
        rim = rim if folded or fine[0] <= 0 else 0.0
    half = width / 2 * brentq(lambda x: across(x * width / 2) / (width / 2) - 1, 1.0, 1 + 2 * reach / width)
    levels = max(0, int(np.floor(np.log2(min(half, height) / 4 / h))))
    coarse = h * 2**levels
    ny = int(np.ceil(height / coarse - 1e-9))
    nx = max(1, int(np.ceil(half / coarse - 1e-9)))
    # Mirrored in x so that the corner under the blade belongs to two triangles, not to one.
    mesh = skfem.MeshTri.init_tensor(np.linspace(-half, 0, nx + 1), np.linspace(0, height, ny + 1))
    mesh = skfem.MeshTri(mesh.p * np.array([[-1.0], [1.0]]), mesh.t)
    edge = height / ny / 2**levels
    corner = edge if corner is None else min(corner, edge)
    smallest = min(corner, shallow * edge, largest)
    for _ in range(levels + int(np.ceil(np.log2(edge / smallest) - 1e-9))):
        corners = mesh.p[:, mesh.t]
        size = np.ptp(corners, axis=1).max(axis=0)
        nearest, deep = corners[0].min(axis=0), height - corners[1].max(axis=0)
        outside = np.maximum(np.maximum(fine[0] - (height - corners[1].min(axis=0)), deep - fine[1]), 0)
        if kept is not None:
            outside = np.minimum(outside, _away(corners, kept_at))
        most = wanted(
            nearest, deep, h, corner=corner, reach=reach, shallow=shallow, surge=surge, rim=rim,
            tuning=tuning, outside=outside, largest=largest,
        )  # fmt: skip
        marked = np.flatnonzero(size > 1.5 * most)
        if marked.size == 0:
            break
        mesh = mesh.refined(marked)
    p = np.array([across(mesh.p[0]), mesh.p[1]])
    p[0, mesh.p[0] > half * (1 - 1e-12)] = width / 2
    return named(skfem.MeshTri(p, mesh.t), width / 2, height)


def _away(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance (ne,) of the nearest point (2, n) from the box around each of ``corners`` (2, 3, ne)."""
    low, high = corners.min(axis=1)[..., None], corners.max(axis=1)[..., None]
    apart = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0)
    return np.hypot(*apart).min(axis=1, initial=np.inf)


def named(mesh: skfem.MeshTri, half: float, height: float) -> skfem.MeshTri:
    """Name the faces of a rectangular section by their position."""
    eps = 1e-9 * height
    return mesh.with_boundaries(
        {
            "cut": lambda x: np.abs(x[0]) < eps,
            "top": lambda x: np.abs(x[1] - height) < eps,
            "bottom": lambda x: np.abs(x[1]) < eps,
            "side": lambda x: np.abs(x[0] - half) < eps,
        }
    )
