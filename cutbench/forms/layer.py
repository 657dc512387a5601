"""Bending stiffness of the surfaces at the blade, ½ B ∫ |Δ₀φ|² dA, as of a layer of thickness t: B = G t³/3.

They are the faces of the cut plane and the top face. The cohesive zone stands for a layer that fails; a
surface without thickness has no resistance to folds.

Squeezed along itself to about half its height a soft surface folds, at all wavelengths at once (Biot, Appl.
Sci. Res. A 12, 1963), and a cut plane that resists opening by G_c/δ_c² at first does so at all that are short
enough: what a mesh shows then hangs on its elements. So does the edge where both surfaces meet: pressed by
the tip, it crumples one element at a time. With a stiffness that grows with the fourth power of the wave
number short folds cost more than they free.

Zero for rigid motions and homogeneous deformations, quadratic, the same in 2D and 3D: Δ₀ on the flat pieces
between neighbouring nodes, with lumped mass (Ciarlet, Raviart, in: Mathematical Aspects of Finite Elements,
1974). Edges of the plane are free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy

import numpy as np
import scipy.sparse as sp

from cutbench.forms.base import Form, Local, component_major
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import Bulk, Cut


class LayerForm(Form):
    """On one surface, the top or a side of the cut plane, for a layer ``layer`` times δ_c thick.

    Its modulus and δ_c, the opening at the peak of the cohesion, are those of ``laws``.
    """

    name = "bending"

    def __init__(
        self,
        faces: Faces,
        X: np.ndarray,
        layer: float,
        laws: Sequence[Bulk | Cut],
        mirrors: Sequence[tuple[np.ndarray, int]] = (),
        name: str | None = None,
    ):
        """``X`` (dim, nnode) positions of all nodes; ``mirrors``: nodes on planes of symmetry, each with the
        component that is zero there; ``name`` tells the surfaces apart."""
        self.name = name or self.name
        dim = X.shape[0]
        # The whole plane lies in the mirrors of a layer: they continue nothing.
        ends = [at for at, _ in mirrors if not np.isin(faces.nodes, at).all()]
        symmetric = np.unique(np.concatenate(ends)) if ends else np.zeros(0, int)
        nodes, unit, area = _squared_laplacian(_pieces(faces.nodes, X), X, symmetric)
        # Lines in space are strips of which nothing varies across: the faces say how wide they are.
        unit = unit * (faces.w.sum() / area)
        nn, n = nodes.shape
        matrix = np.zeros((dim, nn, dim, nn, n))
        for i in range(dim):
            matrix[i, :, i] = unit
        # Beyond a mirror the component across it is odd: its second derivatives are zero there.
        for at, component in mirrors:
            matrix[component, ..., np.isin(nodes[0], at)] = 0.0
        self._matrix = matrix.reshape(dim * nn, dim * nn, n)  # for B = 1
        self.layer, self._laws = layer, tuple(laws)
        self.reads = tuple(n for law in laws for n in (*law.reads, *(q.name for q in law.parameters)))
        self.dofs = component_major(nodes, dim)

    def part(self, columns):
        some = copy(self)
        some.dofs = np.ascontiguousarray(self.dofs[:, columns])
        some._matrix = np.ascontiguousarray(self._matrix[..., columns])
        return some

    def stiffness(self, p):
        """B in N mm."""
        modulus = sum(law.shear_modulus(p) for law in self._laws if isinstance(law, Bulk))
        opening = sum(law.estimate(p, 0.0, 0.0).opening for law in self._laws)
        return modulus * (self.layer * opening) ** 3 / 3

    def _force(self, u, p):
        return self.stiffness(p) * np.einsum("ijn,jn->in", self._matrix, np.take(u, self.dofs))

    def evaluate(self, u, p, state, step, tangent=True):
        matrix = np.real(self.stiffness(p)) * self._matrix if tangent else None
        return Local(self._force(u, p), matrix, {})

    def energy(self, u: np.ndarray, p) -> float:
        """Stored energy in mJ, per mm of length in 2D."""
        return float((np.take(u, self.dofs) * self._force(u, p)).sum()) / 2

    def stored(self, u, p, state):
        return self.energy(u, p)

    def work(self, u, p, old, new, step):
        return {"bending": self.energy(u, p) - self.energy(step.u_old, p)}


def _pieces(nodes: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Flat simplices (m+1, n) between the nodes of linear or quadratic faces (nn, nf)."""
    corners = X.shape[0]
    c, middle = nodes[:corners], nodes[corners:]
    if not len(middle):
        return c

    def between(i, j):
        """Numbers (nf,) of the nodes half way between two corners."""
        away = np.linalg.norm(X[:, middle] - (X[:, c[i]] + X[:, c[j]])[:, None] / 2, axis=0)
        return np.take_along_axis(middle, away.argmin(axis=0)[None], axis=0)[0]

    if corners == 2:
        m = between(0, 1)
        return np.hstack([np.stack([c[0], m]), np.stack([m, c[1]])])
    a, b, d = between(1, 2), between(2, 0), between(0, 1)
    return np.hstack([np.stack(t) for t in ((c[0], d, b), (c[1], a, d), (c[2], b, a), (a, b, d))])


def _squared_laplacian(pieces, X, symmetric) -> tuple[np.ndarray, np.ndarray, float]:
    """For each node inside the plane or in a mirror (``symmetric``): it and its neighbours (nn, n), some more
    than once; the matrix (nn, nn, n) of the Laplacian's square times the node's part of the plane; its area.
    """
    corners = pieces.shape[0]
    edges = np.moveaxis(X[:, pieces[1:]] - X[:, pieces[:1]], 2, 0)  # (n, dim, m)
    # Gradients of the barycentric coordinates in the plane of each piece.
    inverse = np.linalg.pinv(edges)  # (n, m, dim)
    gradient = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)  # (n, m+1, dim)
    gram = np.linalg.det(np.einsum("ndi,ndj->nij", edges, edges))
    volume = np.sqrt(gram) / math.factorial(corners - 1)
    local = -np.einsum("nid,njd,n->ijn", gradient, gradient, volume)
    at = np.broadcast_to(pieces[:, None], local.shape), np.broadcast_to(pieces[None], local.shape)
    size = X.shape[1]
    slopes = sp.csr_matrix((local.ravel(), (at[0].ravel(), at[1].ravel())), shape=(size, size))
    area = np.bincount(pieces.ravel(), np.tile(volume / corners, corners), minlength=size)
    # A ridge that belongs to one piece alone is on the plane's edge, or in a mirror.
    ridges = np.hstack([np.sort(np.delete(pieces, k, axis=0), axis=0) for k in range(corners)])
    ridges, count = np.unique(ridges, axis=1, return_counts=True)
    edge = (count == 1) & ~np.isin(ridges, symmetric).all(axis=0)
    kept = np.setdiff1d(pieces, ridges[:, edge])
    width = int(np.diff(slopes.indptr)[kept].max(initial=1))
    nodes, row = np.tile(kept, (width, 1)), np.zeros((width, kept.size))
    for column, node in enumerate(kept):
        part = slice(slopes.indptr[node], slopes.indptr[node + 1])
        ring, values = slopes.indices[part], slopes.data[part]
        first = ring == node
        nodes[: ring.size, column] = np.concatenate([ring[first], ring[~first]])
        row[: ring.size, column] = np.concatenate([values[first], values[~first]])
    return nodes, row[:, None] * row[None] / area[kept], float(volume.sum())
