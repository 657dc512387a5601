"""A surface that resists gradients of its deformation: ½ B ∫ |Δ₀φ|² dA, bends and uneven stretches alike.

Δ₀ on the flat pieces between neighbouring nodes, with lumped mass (Ciarlet, Raviart, in: Mathematical
Aspects of Finite Elements, 1974). Zero for rigid motions and homogeneous deformations of a flat surface;
quadratic, the same in two and three dimensions.
"""

from __future__ import annotations

import numpy as np

from cutbench.forms.base import spread
from cutbench.forms.bending import BendingForm


class GradientForm(BendingForm):
    """On one surface, with rim and mirrors as ``BendingForm`` has them."""

    def __init__(self, *args, **named):
        super().__init__(*args, **named)
        X, weights, _, area, keep = self._arrays
        length = np.linalg.norm(X - X[:, :, :1], axis=0)
        weights = np.divide(weights, length, out=np.zeros_like(weights), where=length > 0)
        # The Laplacian times a node's area (dim, dim·nn, n), which is linear in the displacements.
        weights[:, 0] -= weights.sum(axis=1)
        dim, columns = X.shape[0], X.shape[-1]
        flat = weights.reshape(-1, columns)
        rows = np.zeros((dim, dim, *flat.shape))
        for i in range(dim):
            rows[i, i] = flat * keep[i]
        rows = rows.reshape(dim, -1, columns)
        start = keep * (weights * X).sum(axis=(1, 2))
        matrices = np.ascontiguousarray(np.einsum("din,djn->ijn", rows, rows) / area)
        self._arrays = (rows, start, area, matrices, np.einsum("din,dn->in", rows, start / area))

    def coefficient(self, p):
        return self.law.gradient(p)

    def energies(self, U):
        rows, start, area, *_ = self._arrays
        return ((start + np.einsum("din,in->dn", rows, U)) ** 2).sum(axis=0) / (2 * area)

    def forces(self, U, there):
        *_, matrices, start = self._arrays
        return there * (start + spread(matrices, U))

    def slopes(self, U, there):
        return there * self._arrays[3]
