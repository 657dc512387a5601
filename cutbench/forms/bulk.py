"""Bulk form: ∫ P : ∇₀δu dV (paper, eq. weak_form1, first term), in 2D with F padded to plane strain."""

from __future__ import annotations

import numpy as np

from cutbench.forms.base import Form, Local, add_states, component_major, nodal
from cutbench.forms.space import Volume
from cutbench.mechanisms.base import Points
from cutbench.mechanisms.bulk._isotropic import det


class BulkForm(Form):
    """Sum of the bulk laws' stresses over one volume quadrature."""

    name = "bulk"

    def __init__(self, laws, volume: Volume, height: float):
        self.laws, self.volume = tuple(laws), volume
        self.dim = volume.X.shape[0]
        nq, dim, nn = volume.dphi.shape
        self.dofs = component_major(volume.nodes, dim)
        self._gradient = volume.dphi.reshape(nq * dim, nn)
        # Products of reference gradients: one matrix for all elements.
        pair = np.einsum("qma,qnb->abqmn", volume.dphi, volume.dphi)
        self._pairs = np.ascontiguousarray(pair.reshape(nn * nn, nq * dim * dim))
        X = np.zeros((3, volume.w.size))
        X[:dim] = volume.X.reshape(dim, -1)
        self._X, self._depth = X, height - X[1]

    def points(self, step) -> Points:
        return Points(X=self._X, depth=self._depth, dt=None if step is None else step.dt, shared={})

    def start(self, p):
        return add_states(*(law.start(self.volume.w.size, p) for law in self.laws))

    def deformation(self, u: np.ndarray) -> np.ndarray:
        """F (3, 3, nq·ne)."""
        v, dim = self.volume, self.dim
        nq, ne = v.w.shape
        U = nodal(u, v.nodes, dim)
        G = np.matmul(self._gradient, U).reshape(dim, nq, dim, ne)
        F = np.zeros((3, 3, nq, ne), dtype=G.dtype)
        for i in range(3):
            F[i, i] = 1.0
        for i in range(dim):
            for J in range(dim):
                for M in range(dim):
                    F[i, J] += G[i, :, M] * v.jinv[M, J]
        return F.reshape(3, 3, -1)

    def evaluate(self, u, p, state, step, tangent=True):
        F = self.deformation(u)
        at = self.points(step)
        P, parts = 0, []
        for law in self.laws:
            stress, new = law.stress(F, p, state, at)
            P = P + stress
            parts.append(new)
        matrix = None
        if tangent:
            matrix = self._matrix(sum(law.tangent(F, p, state, at, self.dim) for law in self.laws))
        return Local(self._vector(P), matrix, add_states(*parts))

    def _vector(self, P):
        v, dim = self.volume, self.dim
        nq, ne = v.w.shape
        P = P[:dim, :dim].reshape(dim, dim, nq, ne) * v.w
        R = np.zeros((dim, nq, dim, ne), dtype=P.dtype)
        for i in range(dim):
            for M in range(dim):
                for J in range(dim):
                    R[i, :, M] += P[i, J] * v.jinv[M, J]
        return np.matmul(self._gradient.T, R.reshape(dim, nq * dim, ne)).reshape(-1, ne)

    def _matrix(self, A):
        v, dim = self.volume, self.dim
        nq, ne = v.w.shape
        nn = v.nodes.shape[0]
        A = A.reshape(dim, dim, dim, dim, nq, ne)
        out = np.empty((dim, nn, dim, nn, ne))
        block = np.empty((nq, dim, dim, ne))
        for i in range(dim):
            for k in range(i, dim):
                Aw = A[i, :, k] * v.w
                # Push both material indices to the reference element.
                half = [sum(Aw[:, L] * v.jinv[N, L] for L in range(dim)) for N in range(dim)]
                for M in range(dim):
                    for N in range(dim):
                        block[:, M, N] = sum(half[N][J] * v.jinv[M, J] for J in range(dim))
                K = (self._pairs @ block.reshape(-1, ne)).reshape(nn, nn, ne)
                out[i, :, k] = K
                if k > i:
                    out[k, :, i] = K.transpose(1, 0, 2)
        return out.reshape(dim * nn, dim * nn, ne)

    def smallest_volume_ratio(self, u: np.ndarray) -> float:
        """min J over the quadrature points: an inverted element shows here."""
        return float(det(self.deformation(u)).min())

    def energies(self, u, p, state) -> dict[str, float]:
        """Stored energy of each law."""
        F, at = self.deformation(u), self.points(None)
        w = self.volume.w.ravel()
        return {law.name: float(w @ law.energy(F, p, state, at)) for law in self.laws}

    def work(self, u, p, old, new, step):
        before = self.energies(step.u_old, p, old)
        after = self.energies(u, p, new)
        return {name: after[name] - before[name] for name in after}
