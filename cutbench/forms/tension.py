"""Surface tension: γ ∫ |cof F N| dA on the top and on what is cut of the cut plane.

While the plane is whole the top goes on across it: between its two edges there it spans their opening, with
γ (1 − d) ⟦u⟧_n per length of the edge, and so holds what it pulls at both. At the block's other edges it is
held by a force γ per length: a block at rest has the shape that is meshed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutbench.forms.base import blend, component_major
from cutbench.forms.normals import cross
from cutbench.forms.space import Faces
from cutbench.forms.surface import Rim, Share, SurfaceForm, edge_lines
from cutbench.mechanisms.base import Skin


class TensionForm(SurfaceForm):
    """On the faces of one surface."""

    def __init__(self, name: str, law: Skin, faces: Faces, share: Share):
        dim = faces.X.shape[0]
        super().__init__(name, law, component_major(faces.nodes, dim), share)
        self.faces, self._dim = faces, dim

    def coefficient(self, p):
        return self.law.tension(p)

    def part(self, columns):
        some = super().part(columns)
        some.faces = self.faces.some(columns)
        return some

    def carried(self, other, state, p):
        return {name: self.faces.from_others(other.faces, value) for name, value in state.items()}

    def _slopes(self, U):
        """Tangents (dim, nq, nf) of the deformed faces, and their cross product over its length, the area."""
        f, u = self.faces, U.reshape(self._dim, -1, U.shape[-1])
        slopes = [t[:, None] + blend(dN, u) for t, dN in zip(f.tangents, f.dN, strict=True)]
        normal = cross(slopes)
        area = np.sqrt((normal * normal).sum(axis=0))
        return slopes, normal / area, area

    def energies(self, U):
        return (self._slopes(U)[2] * self.faces.w).ravel()

    def forces(self, U, there):
        slopes, n, _ = self._slopes(U)
        w = self.faces.w * there.reshape(self.faces.w.shape)
        if self._dim == 2:
            pulls = [np.stack([-n[1], n[0]])]
        else:
            a, b = slopes
            pulls = [cross([b, n]), cross([n, a])]
        found = sum(
            np.einsum("qaf,iqf->iaf", dN, pull * w) for dN, pull in zip(self.faces.dN, pulls, strict=True)
        )
        return found.reshape(self.dofs.shape)


#: Points and weights on (0, 1), shape functions of lines with two or three nodes there, and derivatives.
_x, _w = np.polynomial.legendre.leggauss(3)
POINTS, WEIGHTS = (1 + _x) / 2, _w / 2
SHAPES = {
    1: (np.ones((3, 1)), np.zeros((3, 1))),
    2: (np.stack([1 - POINTS, POINTS], axis=1), np.tile([-1.0, 1.0], (3, 1))),
    3: (
        np.stack([(1 - POINTS) * (1 - 2 * POINTS), POINTS * (2 * POINTS - 1), 4 * POINTS * (1 - POINTS)], 1),
        np.stack([4 * POINTS - 3, 4 * POINTS - 1, 4 - 8 * POINTS], 1),
    ),
}


class SpanForm(SurfaceForm):
    """Across the opening of the cut plane: from edge to edge of the top, or to the plane of symmetry."""

    def __init__(self, name: str, law: Skin, rim: Rim, cut: Faces, X: np.ndarray):
        lines, _ = edge_lines(cut.nodes, X)
        pieces = np.searchsorted(rim.plus, lines[:, np.isin(lines, rim.plus).all(axis=0)])
        sides = [side for side in (rim.plus, rim.minus) if side is not None]
        nodes, n = np.stack([side[pieces] for side in sides]), pieces.shape[1]
        at = Rim.nearest(cut, X[:, nodes[0]].mean(axis=1))
        share = Share.all_of(n).until_cut(np.arange(n), at)
        super().__init__(name, law, component_major(nodes.reshape(-1, n), X.shape[0]), share)
        self._X = X[:, nodes]  # (dim, sides, k, n)
        #: Of a section: how wide it is.
        self._width = cut.w.sum() / np.ptp(cut.X[1]) if len(pieces) == 1 else 0.0

    def coefficient(self, p):
        return self.law.tension(p)

    def part(self, columns):
        some = super().part(columns)
        some._X = self._X[..., columns]
        return some

    def _geometry(self, U):
        """At points of the lines (3, n): their opening, or half of it; length and direction (…, n)."""
        x = self._X + U.reshape(self._X.shape)
        N, dN = SHAPES[x.shape[2]]
        signs = np.array([1.0, -1.0])[: x.shape[1], None]
        opening = N @ (signs[..., None] * x[0]).sum(axis=0)
        if self._width:
            return opening, np.full(opening.shape, self._width), None
        way = np.einsum("qa,isan->iqn", dN, x[1:]) / x.shape[1]
        length = np.sqrt((way * way).sum(axis=0))
        return opening, length, way / length

    def energies(self, U):
        opening, length, _ = self._geometry(U)
        return WEIGHTS @ (opening * length)

    def forces(self, U, there):
        opening, length, way = self._geometry(U)
        _, sides, k, _ = self._X.shape
        (N, dN), w = SHAPES[k], WEIGHTS[:, None] * there
        out = np.zeros(self._X.shape, np.result_type(U, there))
        for side, sign in zip(range(sides), (1.0, -1.0), strict=False):
            out[0, side] = sign * N.T @ (w * length)
            if way is not None:
                out[1:, side] = np.einsum("qa,iqn->ian", dN, w * opening * way) / sides
        return out.reshape(U.shape)


class HeldForm(SurfaceForm):
    """Along the edges of the top that are neither on the cut plane nor on a plane of symmetry."""

    def __init__(self, name: str, law: Skin, top: Faces, inner: Sequence[np.ndarray], X: np.ndarray):
        """``inner``: the nodes of planes on which it goes on, or lies as a whole."""
        lines, opposite = edge_lines(top.nodes, X)
        goes_on = [np.isin(lines, at).all(axis=0) for at in inner if not np.isin(top.nodes, at).all()]
        outer = ~np.any([np.zeros(opposite.size, bool), *goes_on], axis=0)
        lines, opposite = lines[:, outer], opposite[outer]
        away, length = X[:, lines[0]] - X[:, opposite], top.w.sum() / np.ptp(top.X[0])
        if len(lines) > 1:
            along = X[:, lines[1]] - X[:, lines[0]]
            length = np.linalg.norm(along, axis=0)
            away = away - along * (away * along).sum(axis=0) / length**2
        pull = -length * away / np.linalg.norm(away, axis=0)
        super().__init__(name, law, component_major(lines, X.shape[0]), Share.all_of(opposite.size))
        parts = WEIGHTS @ SHAPES[len(lines)][0]
        self._pull = (pull[:, None] * parts[:, None]).reshape(self.dofs.shape)

    def coefficient(self, p):
        return self.law.tension(p)

    def part(self, columns):
        some = super().part(columns)
        some._pull = self._pull[:, columns]
        return some

    def energies(self, U):
        return (self._pull * U).sum(axis=0)

    def forces(self, U, there):
        return self._pull * there + 0 * U
