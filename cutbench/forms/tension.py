"""Surface tension: γ ∫ |cof F N| dA on the top and on what is cut of the cut plane.

While the plane is whole the top goes on across it: between its two edges there it spans their opening, with
γ (1 − d) ⟦u⟧_n per length of the edge, and so holds what it pulls at both.
"""

from __future__ import annotations

import numpy as np

from cutbench.forms.base import blend, component_major
from cutbench.forms.normals import cross
from cutbench.forms.space import Faces
from cutbench.forms.surface import Rim, Share, SurfaceForm
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


class SpanForm(SurfaceForm):
    """Across the opening of the cut plane: from one edge of the top to the other, or to the plane of
    symmetry."""

    def __init__(self, name: str, law: Skin, rim: Rim, pieces: np.ndarray, cut: Faces, X: np.ndarray):
        """``pieces`` (1 or 2, n) of the rim, numbers of its nodes: points, or lines along the blade."""
        nodes = rim.plus[pieces]
        if rim.minus is not None:
            nodes = np.concatenate([nodes, rim.minus[pieces]])
        n = pieces.shape[1]
        at = Rim.nearest(cut, X[:, rim.plus[pieces]].mean(axis=1))
        super().__init__(
            name, law, component_major(nodes, X.shape[0]), Share.all_of(n).until_cut(np.arange(n), at)
        )
        self._X, self._split, self._line = X[:, nodes], rim.minus is not None, len(pieces) == 2
        #: Of a section in space: how wide it is.
        self._width = 1.0 if self._line else cut.w.sum() / np.ptp(cut.X[1])

    def coefficient(self, p):
        return self.law.tension(p)

    def part(self, columns):
        some = super().part(columns)
        some._X = self._X[..., columns]
        return some

    def _geometry(self, U):
        """Opening (n,), its ends (dim, 2, n) halved, and the piece's length and direction (2, n)."""
        x = self._X + U.reshape(self._X.shape)
        k = len(x[0]) // 2 if self._split else len(x[0])
        opening = (x[0, :k] - x[0, k:]).mean(axis=0) if self._split else x[0].mean(axis=0)
        if not self._line:
            return opening, self._width, None
        line = x[1:, :k] if not self._split else (x[1:, :k] + x[1:, k:]) / 2
        way = line[:, 1] - line[:, 0]
        length = np.sqrt((way * way).sum(axis=0))
        return opening, length, way / length

    def energies(self, U):
        opening, length, _ = self._geometry(U)
        return opening * length

    def forces(self, U, there):
        opening, length, way = self._geometry(U)
        out = np.zeros(self._X.shape, np.result_type(U, there))
        sides = 2 if self._split else 1
        k = out.shape[1] // sides
        for side, sign in zip(range(sides), (1.0, -1.0), strict=False):
            here = slice(side * k, side * k + k)
            out[0, here] = sign * there * length / k
            if way is not None:
                pull = there * opening * way / sides
                out[1:, here] = np.stack([-pull, pull], axis=1)
        return out.reshape(U.shape)
