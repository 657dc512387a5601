"""Bulk form: ∫ P : ∇₀δu dV (paper, eq. weak_form1, first term), in 2D with F padded to plane strain."""

from __future__ import annotations

import numpy as np

from cutbench.forms.base import Form, Local, add_states, component_major, nodal
from cutbench.forms.space import Volume
from cutbench.mechanisms.base import Points
from cutbench.mechanisms.bulk._isotropic import Isotropic, Kinematics, tangent_blocks


class BulkForm(Form):
    """Sum of the bulk laws' stresses over one volume quadrature."""

    name = "bulk"

    def __init__(self, laws, volume: Volume, height: float):
        self.laws, self.volume = tuple(laws), volume
        # Isotropic laws are summed as factors, before any tensor is built; others give whole tensors.
        self._isotropic = tuple(law for law in self.laws if _by_factors(law))
        self._others = tuple(law for law in self.laws if not _by_factors(law))
        self.dim = volume.X.shape[0]
        nq, dim, nn = volume.dphi.shape
        self.dofs = component_major(volume.nodes, dim)
        self._gradient = volume.dphi.reshape(nq * dim, nn)
        # Products of reference gradients: one matrix for all elements, and its transpose in the nodes.
        pair = np.einsum("qma,qnb->abqmn", volume.dphi, volume.dphi)
        self._pairs = np.ascontiguousarray(pair.reshape(nn, nn, nq * dim * dim))
        self._pairs_transposed = np.ascontiguousarray(self._pairs.transpose(1, 0, 2))
        #: The unit tensor with both indices pushed to the reference element.
        self._metric = np.einsum("mje,nje->mne", volume.jinv, volume.jinv)
        X = np.zeros((3, volume.w.size))
        X[:dim] = volume.X.reshape(dim, -1)
        self._X, self._depth = X, height - X[1]

    def points(self, step) -> Points:
        return Points(X=self._X, depth=self._depth, dt=None if step is None else step.dt, shared={})

    def start(self, p):
        return add_states(*(law.start(self.volume.w.size, p) for law in self.laws))

    def _in_plane(self, u: np.ndarray) -> np.ndarray:
        """The components of F that vary (dim, dim, nq·ne)."""
        v, dim = self.volume, self.dim
        nq, ne = v.w.shape
        G = np.matmul(self._gradient, nodal(u, v.nodes, dim)).reshape(dim, nq, dim, ne)
        F = np.einsum("iqme,mje->ijqe", G, v.jinv)
        for i in range(dim):
            F[i, i] += 1.0
        return F.reshape(dim, dim, -1)

    def deformation(self, u: np.ndarray) -> np.ndarray:
        """F (3, 3, nq·ne)."""
        return self._padded(self._in_plane(u))

    def _padded(self, inner: np.ndarray) -> np.ndarray:
        if self.dim == 3:
            return inner
        F = np.zeros((3, 3, inner.shape[-1]), dtype=inner.dtype)
        F[:2, :2] = inner
        F[2, 2] = 1.0
        return F

    def evaluate(self, u, p, state, step, tangent=True):
        k, at = Kinematics(self._in_plane(u)), self.points(step)
        vector = matrix = 0.0
        if self._isotropic:
            F, C = self._push(k.F), self._push(k.C)
            s, c = self._summed("stress_factors", k, p, at)
            vector = self._project(s[:, None] * F + c[:, None] * C)
            if tangent:
                factors = self._summed("tangent_factors", k, p, at)
                matrix = self._sandwich(tangent_blocks(factors, F, C, self._metric))
        parts = []
        for law in self._others:
            whole = self._padded(k.F)
            P, new = law.stress(whole, p, state, at)
            vector = vector + self._vector(P)
            parts.append(new)
            if tangent:
                matrix = matrix + self._matrix(law.tangent(whole, p, state, at, self.dim))
        return Local(vector, matrix if tangent else None, add_states(*parts))

    def _summed(self, factors: str, k: Kinematics, p, at) -> list[np.ndarray]:
        """Factors of all isotropic laws together, times the quadrature weights, each (nq, ne)."""
        w = self.volume.w
        sums = zip(*(getattr(law, factors)(k, p, at) for law in self._isotropic), strict=True)
        return [np.multiply(sum(values), w.ravel()).reshape(w.shape) for values in sums]

    def _push(self, T: np.ndarray) -> np.ndarray:
        """The material index pushed to the reference element: (dim, dim, nq·ne) to (dim, nq, dim, ne)."""
        v, dim = self.volume, self.dim
        return np.einsum("ijqe,mje->iqme", T.reshape(dim, dim, *v.w.shape), v.jinv)

    def _project(self, P: np.ndarray) -> np.ndarray:
        """Nodal forces (dim·nn, ne) of pushed stresses times weights (dim, nq, dim, ne)."""
        ne = P.shape[-1]
        return np.matmul(self._gradient.T, P.reshape(self.dim, -1, ne)).reshape(-1, ne)

    def _sandwich(self, blocks) -> np.ndarray:
        """Element matrices of pushed tangents times weights: i, k ≥ i, (nq, dim, dim, ne)."""
        v, dim = self.volume, self.dim
        ne, nn = v.w.shape[1], v.nodes.shape[0]
        out = np.empty((dim, nn, dim, nn, ne))
        for i, k, block in blocks:
            block = block.reshape(-1, ne)
            np.matmul(self._pairs, block, out=out[i, :, k])
            if k > i:
                np.matmul(self._pairs_transposed, block, out=out[k, :, i])
        return out.reshape(dim * nn, dim * nn, ne)

    def _vector(self, P: np.ndarray) -> np.ndarray:
        """Nodal forces (dim·nn, ne) of a first Piola stress (3, 3, nq·ne)."""
        dim, w = self.dim, self.volume.w
        return self._project(self._push(P[:dim, :dim]) * w[:, None])

    def _matrix(self, A: np.ndarray) -> np.ndarray:
        """Element matrices (dim·nn, dim·nn, ne) of a tangent dP/dF (dim, dim, dim, dim, nq·ne)."""
        v, dim = self.volume, self.dim
        A = A.reshape(dim, dim, dim, dim, *v.w.shape)
        return self._sandwich(
            (i, k, np.einsum("jlqe,mje,nle,qe->qmne", A[i, :, k], v.jinv, v.jinv, v.w, optimize=True))
            for i in range(dim)
            for k in range(i, dim)
        )

    def smallest_volume_ratio(self, u: np.ndarray) -> float:
        """min J over the quadrature points: an inverted element shows here."""
        return float(Kinematics(self._in_plane(u)).J.min())

    def energies(self, u, p, state) -> dict[str, float]:
        """Stored energy of each law."""
        F, at = self.deformation(u), self.points(None)
        w = self.volume.w.ravel()
        return {law.name: float(w @ law.energy(F, p, state, at)) for law in self.laws}

    def work(self, u, p, old, new, step):
        before = self.energies(step.u_old, p, old)
        after = self.energies(u, p, new)
        return {name: after[name] - before[name] for name in after}


def _by_factors(law) -> bool:
    """Whether a law is its factors, and no class below Isotropic has a stress or tangent of its own."""
    kind = type(law)
    return isinstance(law, Isotropic) and (kind.stress, kind.tangent) == (Isotropic.stress, Isotropic.tangent)
