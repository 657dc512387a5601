"""Support of the base: ∫ λ·u_t − c/2 λ·λ dA, λ the tangential traction, an unknown of its own.

δu: ∫ λ·δu_t dA,   δλ: ∫ δλ·(u_t − c λ) dA: u_t = c λ at every point, and c = 0 is a base that does not give.
With the traction as an unknown that limit, and the derivative there, need no infinite stiffness.
"""

from __future__ import annotations

import numpy as np

from cutbench.forms.base import Form, Local
from cutbench.forms.space import Faces


class SupportForm(Form):
    """One support law on the faces ``faces`` below the block, normal to the second axis.

    The tractions' unknowns begin at number ``first``; ``ndof`` is the number of all with them.
    """

    name = "support"

    def __init__(self, law, faces: Faces, first: int):
        self.law, self.dim = law, faces.X.shape[0]
        axes = [i for i in range(self.dim) if i != 1]
        nodes, place = np.unique(faces.nodes, return_inverse=True)
        place = place.reshape(faces.nodes.shape)
        self.ndof = first + nodes.size * len(axes)
        moving = [faces.nodes * self.dim + i for i in axes]
        traction = [first + place * len(axes) + j for j in range(len(axes))]
        self.dofs = np.concatenate(moving + traction)
        self._half = self.dofs.shape[0] // 2
        self._mass = np.einsum("qaf,qbf,qf->abf", faces.N, faces.N, faces.w)
        #: Each traction's unknown (n,) and the displacement (n,) that it holds.
        tractions = first + np.arange(nodes.size * len(axes))
        self.pairs = np.stack([tractions, (nodes[:, None] * self.dim + np.array(axes)).ravel()])

    def _matrix(self, c) -> np.ndarray:
        nn = self._mass.shape[0]
        out = np.zeros((*self.dofs.shape[:1], *self.dofs.shape), dtype=np.result_type(c, float))
        for j in range(0, self._half, nn):
            u, t = slice(j, j + nn), slice(self._half + j, self._half + j + nn)
            out[u, t] = out[t, u] = self._mass
            out[t, t] = -c * self._mass
        return out

    def evaluate(self, u, p, state, step):
        matrix = self._matrix(self.law.compliance(p))
        vector = np.einsum("abf,bf->af", matrix, u[self.dofs])
        return Local(vector, np.real(matrix), {})

    def energy(self, u, p) -> float:
        """∫ λ·u_t − c/2 λ·λ dA, which is what the layer stores."""
        x = u[self.dofs]
        return float(np.einsum("af,abf,bf->", x, self._matrix(self.law.compliance(p)), x) / 2)

    def stored(self, u, p, state):
        return {self.law.name: self.energy(u, p)}

    def work(self, u, p, old, new, step):
        return {self.law.name: self.energy(u, p) - self.energy(step.u_old, p)}
