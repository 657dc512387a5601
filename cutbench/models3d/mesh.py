"""Tetrahedral meshes of a block, graded towards the cut plane by scikit-fem alone.

x is the distance from the cut plane (x = 0), y the height, z the place along the blade with z = 0 in
the middle of the block; the blade comes from above along y.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import skfem
from scipy.optimize import brentq

from cutbench.case.mesh_sizes import STANDARD, wanted
from cutbench.case.tuning import MeshTuning

#: Along the blade things change slowly: elements are longer there, by this factor at the most.
ALONG = 4.0
#: Elements at the cut plane are this many times taller than wide: the material is stretched sideways several
#: times there. Elements of a section are smaller, and need less.
SLENDER = 8.0


def length_along(length: float, h: float, along: float = ALONG, longest: float = MeshTuning.longest) -> float:
    """Element size along the blade that goes with height ``h``, all mm: longer than tall only up to the part
    ``longest`` of ``length``."""
    return max(h, min(along * h, longest * length))


def quarter(
    width: float,
    height: float,
    length: float,
    h: float,
    *,
    h_z: float | None = None,
    corner: float | None = None,
    slender: float = SLENDER,
    reach: float = 0.3,
    shallow: float = 1.0,
    surge: float = 1.0,
    rim: float = 0.0,
    tuning: MeshTuning = STANDARD,
) -> skfem.MeshTet:
    """The part 0 ≤ x ≤ width/2, 0 ≤ z ≤ length/2 of a block, without names, all lengths in mm.

    On the cut plane edges across the blade are the largest H/(n 2^k) not above ``h``; along the blade they
    are ``h_z`` (``length_along``) at the most. Away from it they grow by ``tuning.grading`` times the
    distance. Where the cut surges, down to ``surge``, they are ``shallow`` times as large, and grow with
    depth from there, and on the top out to ``rim``; under the blade, where the top face meets the cut plane,
    they shrink to ``corner``, and by as much along the blade. Across the cut plane they are ``slender`` times
    smaller, growing to the same size over ``reach``.
    """

    def across(xi):
        return xi - (1 - 1 / slender) * reach * -np.expm1(-xi / reach)

    half = width / 2 * brentq(lambda x: across(x * width / 2) / (width / 2) - 1, 1.0, 1 + 2 * reach / width)
    h_z = length_along(length, h) if h_z is None else h_z
    corner = None if corner is None or corner >= h else corner
    # Lengths along the blade in units of h_z / h: there the wanted mesh is isotropic.
    stretch = h_z / h
    sides = np.array([half, height, length / 2 / stretch])
    levels = max(0, int(np.floor(np.log2(sides.min() / 2 / h))))
    counts = np.maximum(np.ceil(sides / (h * 2**levels) - 1e-9), 1).astype(int)
    # Bisection halves the longest edges: among cubes, unlike bricks, all of a kind at once.
    brick = (sides / counts)[:, None, None]
    with _quiet():
        mesh = skfem.MeshTet.init_tensor(*(np.arange(n + 1.0) for n in counts))
        # Three bisections halve an element.
        finer = int(np.ceil(np.log2(h / min(corner or h, shallow * h, h)) - 1e-9))
        for _ in range(3 * (levels + finer)):
            corners = brick * mesh.p[:, mesh.t]
            size = np.ptp(corners, axis=1).max(axis=0)
            nearest, deep = corners[0].min(axis=0), height - corners[1].max(axis=0)
            most = wanted(
                nearest, deep, h, corner=corner, shallow=shallow, surge=surge, rim=rim, tuning=tuning
            )
            marked = np.flatnonzero(size > most * (1 + 1e-6))
            if marked.size == 0:
                break
            mesh = mesh.refined(marked)
    x, y, z = brick[..., 0] * mesh.p
    x = np.where(x > half * (1 - 1e-12), width / 2, across(x))
    return tetrahedra(np.stack([x, y, z * stretch]), mesh.t)


def tetrahedra(p: np.ndarray, t: np.ndarray) -> skfem.MeshTet:
    """A mesh of points (3, n) and corners (4, m)."""
    return skfem.MeshTet(np.ascontiguousarray(p, dtype=float), np.ascontiguousarray(t))


def mirrored(mesh: skfem.MeshTet, axis: int, *, joined: bool) -> skfem.MeshTet:
    """With its mirror image across the plane where coordinate ``axis`` is 0, sharing its nodes or not."""
    p, n = mesh.p, mesh.p.shape[1]
    sign = np.ones((3, 1))
    sign[axis] = -1.0
    shared = np.abs(p[axis]) < 1e-9 * np.ptp(p[axis]) if joined else np.zeros(n, bool)
    image = np.where(shared, np.arange(n), n + np.cumsum(~shared) - 1)
    return tetrahedra(np.hstack([p, (sign * p)[:, ~shared]]), np.hstack([mesh.t, image[mesh.t]]))


def outside(mesh: skfem.MeshTet, eps: float):
    """The outer faces (nf,), their corners (3, 3, nf), and a function that tells where a coordinate of all
    corners of a face has a value, within ``eps``."""
    outer = mesh.boundary_facets()

    def at(coordinate: np.ndarray, value: float) -> np.ndarray:
        return np.all(np.abs(coordinate - value) < eps, axis=0)

    return outer, mesh.p[:, mesh.facets[:, outer]], at


@contextmanager
def _quiet() -> Iterator[None]:
    """Refinement inside scikit-fem warns about the memory layout of its own arrays; nobody can act on it."""
    log = logging.getLogger("skfem")
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(before)
