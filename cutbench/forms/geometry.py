"""What a model hands to the solver: a mesh with named faces and what they mean. Free of dimension."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import skfem

from cutbench.forms.space import Faces


@dataclass(frozen=True)
class Geometry:
    """A block on its mesh.

    ``multiplicity`` turns the meshed part's force into the block's in N (2D: mm of length, times the
    number of mirror images; 3D: mirror images). ``held`` lists faces with the displacement component
    that symmetry keeps at zero. ``split``: both sides of the cut plane are meshed, as faces "cut"
    (x > 0) and "cut_minus". ``section``: of a block that is one drawn out, its mesh, and the ``planes`` along
    z between the layers, mm. ``sheared``: a section's points move along the blade, too.
    """

    mesh: skfem.Mesh
    height: float
    multiplicity: float
    held: tuple[tuple[str, int], ...] = ()
    clamped: str = "bottom"
    split: bool = False
    section: skfem.MeshTri | None = None
    planes: np.ndarray | None = None
    sheared: bool = False

    @property
    def blade_faces(self) -> tuple[str, ...]:
        """Faces that the blade can touch; Θ is kept on those of the cut plane."""
        return ("top", "cut", "cut_minus") if self.split else ("top", "cut")


def paired(plus: Faces, minus: Faces, X: np.ndarray) -> Faces:
    """``minus`` reordered so that faces, quadrature points and nodes lie opposite those of ``plus``.

    ``X`` (dim, nnode) node positions. Raises ValueError where the two sides do not match.
    """

    def key(points):  # (dim, n); adding 0 turns -0 into 0
        return np.lexsort(np.round(points / (1e-9 * size)) + 0.0)

    size = float(np.ptp(X))
    order_plus = key(plus.X.mean(axis=1))
    order_minus = key(minus.X.mean(axis=1))
    face = np.empty_like(order_plus)
    face[order_plus] = order_minus
    N, nodes, w, points = (np.empty_like(a) for a in (plus.N, plus.nodes, plus.w, plus.X))
    for f, g in enumerate(face):
        a = _match(plus.X[:, :, f] / size, minus.X[:, :, g] / size)
        b = _match(X[:, plus.nodes[:, f]] / size, X[:, minus.nodes[:, g]] / size)
        nodes[:, f] = minus.nodes[b, g]
        N[:, :, f] = minus.N[a][:, b, g]
        w[:, f], points[:, :, f] = minus.w[a, g], minus.X[:, a, g]
    rest = {name: getattr(minus, name)[..., face] for name in ("dN", "normal", "tangents", "size")}
    return replace(minus, nodes=nodes, N=N, w=w, X=points, **rest)


def _match(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    distance = np.abs(a[:, :, None] - b[:, None, :]).sum(axis=0)
    nearest = distance.argmin(axis=1)
    if distance.min(axis=1).max() > 1e-7 or np.unique(nearest).size != nearest.size:
        raise ValueError("the two sides of the cut plane do not have matching nodes")
    return nearest
