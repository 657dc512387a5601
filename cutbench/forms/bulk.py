"""Bulk form: ∫ P : ∇₀δu dV (paper, eq. weak_form1, first term).

Of a section nothing depends on z: F is padded from its first two columns. With two displacements that is
plane strain, with the one along z, too, generalized plane strain.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, cKDTree

from cutbench.base.fused import fused, fusing
from cutbench.base.threads import shared_out
from cutbench.forms.base import Form, Local, Packed, add_states, component_major, gather, same, upper
from cutbench.forms.elements import deformed, flattened, pushed, stresses, tangents
from cutbench.forms.space import Volume
from cutbench.mechanisms.base import Bulk, Points
from cutbench.mechanisms.bulk._isotropic import Isotropic, Kinematics


class BulkForm(Form):
    """Sum of the bulk laws' stresses over one volume quadrature; ``skins`` make them vary with place."""

    name = "bulk"

    def __init__(self, laws, volume: Volume, height: float, skins=()):
        self.laws, self.volume, self.skins = tuple(laws), volume, tuple(skins)
        self._height = height
        # Isotropic laws are summed as factors, before any tensor is built; others give whole tensors.
        self._isotropic = tuple(law for law in self.laws if _by_factors(law))
        self._others = tuple(law for law in self.laws if not _by_factors(law))
        self.dim = volume.X.shape[0]
        nq, dim, nn = volume.dphi.shape
        self.dofs = self._places = component_major(volume.nodes, self.dim)
        self._gradient = volume.dphi.reshape(nq * dim, nn)
        # Products of reference gradients: one matrix for all elements; of a symmetric block half of it.
        pair = np.einsum("qma,qnb->abqmn", volume.dphi, volume.dphi)
        (a, b), (m, n) = np.triu_indices(nn), np.triu_indices(dim)
        half = pair[a, b][:, :, m, n] + np.where(m < n, pair[a, b][:, :, n, m], 0.0)
        # Some rows at a time: of large products BLAS begins threads, which cost more than they save.
        rows = nn + 1 if nn % 2 == 0 else nn
        half = np.ascontiguousarray(half.reshape(-1, rows, nq * m.size))
        self._pairs = pair.reshape(nn, nn, -1), half
        self._factors = fused(_factors) if fusing() else None
        self._last: list[tuple[np.ndarray, Kinematics]] = []
        self._weighed: tuple = (None, None)
        X = np.zeros((3, volume.w.size))
        X[: self.dim] = volume.X.reshape(self.dim, -1)
        self._X, self._depth = X, height - X[1]

    def part(self, columns):
        return BulkForm(self.laws, self.volume.some(columns), self._height, self.skins)

    def with_laws(self, laws, skins) -> BulkForm:
        """Others on the same points."""
        return BulkForm(laws, self.volume, self._height, skins)

    def points(self, step) -> Points:
        """Without a step, internal variables are taken as they are."""
        dt, held = (None, True) if step is None else (step.dt, False)
        return Points(X=self._X, depth=self._depth, dt=dt, laws=self.laws, held=held)

    def _stiffness(self, p):
        """Factor of the skins on all stresses, 1 or (nq, ne)."""
        at = self.points(None)
        factor = math.prod(skin.stiffness(p, at) for skin in self.skins)
        return np.broadcast_to(factor, self.volume.w.size).reshape(self.volume.w.shape)

    def weights(self, p) -> np.ndarray:
        """Quadrature weights times the skins' factor (nq, ne)."""
        if not self.skins:
            return self.volume.w
        if self._weighed[0] is not p:  # parameters are never changed in place
            self._weighed = p, self.volume.w * self._stiffness(p)
        return self._weighed[1]

    def start(self, p):
        return add_states(*(law.start(self.volume.w.size, p) for law in self.laws))

    def carried(self, other, state, p):
        if not state:
            return {}
        # On a straight line between points of the other mesh; beyond the last of them the nearest holds.
        there, here = (form._X[: len(self.volume.jinv)].T for form in (other, self))
        triangles = Delaunay(there)
        nearest = cKDTree(there).query(here)[1]
        new = {}
        for name, value in state.items():
            columns = value.reshape(-1, value.shape[-1]).T
            found = LinearNDInterpolator(triangles, columns)(here)
            found = np.where(np.isnan(found), columns[nearest], found)
            new[name] = found.T.reshape(*value.shape[:-1], -1)
        return new

    def _kinematics(self, u: np.ndarray) -> Kinematics:
        """Of F without what is as it was: the last row in plane strain, and a section's last column."""
        # Volume ratios, forces, tangent and energies are asked for one after the other, and the step's start.
        for k, (at, found) in enumerate(self._last):
            if at.dtype == u.dtype and same(at, u):
                self._last.insert(0, self._last.pop(k))
                return found
        v, dim = self.volume, self.dim
        nq, ne = v.w.shape
        G = np.matmul(self._gradient, gather(u, self._places, dim)).reshape(dim, nq, -1, ne)
        self._last = [(u.copy(), deformed(G, v.jinv)), *self._last[:2]]
        return self._last[0][1]

    def deformation(self, u: np.ndarray) -> np.ndarray:
        """F (3, 3, nq·ne)."""
        return self._padded(self._kinematics(u).F)

    def _padded(self, inner: np.ndarray) -> np.ndarray:
        if inner.shape[1] == 3:
            return inner
        F = np.zeros((3, 3, inner.shape[-1]), dtype=inner.dtype)
        F[: self.dim, :2] = inner
        F[2, 2] = 1.0
        return F

    def evaluate(self, u, p, state, step):
        k, at, w = self._kinematics(u), self.points(step), self.weights(p)
        vector: np.ndarray = np.zeros(())
        if self._isotropic:
            vector = self._project(stresses(k, self._summed(k, p, at, w, False), self.volume.jinv))
        parts = []
        for law in self._others:
            P, new = fused(law.stress)(self._padded(k.F), p, state, at)
            vector = vector + self._vector(P, w)
            parts.append(new)
        return Local(vector, lambda: self._slopes(k, p, state, at, w), add_states(*parts))

    def _slopes(self, k: Kinematics, p, state, at, w: np.ndarray) -> Packed:
        entries: np.ndarray = np.zeros(())
        if self._isotropic:
            entries = self._sandwich(tangents(k, self._summed(k, p, at, w, True), self.volume.jinv))
        for law in self._others:
            found = fused(law.tangent)(self._padded(k.F), p, state, at, self.dim)
            entries = entries + self._entries(found, w)
        return Packed(self.dim, self.volume.nodes.shape[0], entries)

    def _summed(self, k: Kinematics, p, at, w: np.ndarray, tangent: bool) -> list[np.ndarray]:
        """Factors of the stresses, or of their ``tangent``, of all isotropic laws together, times the weights
        ``w``, each (nq, ne)."""
        given = self._isotropic, p, at, w.ravel(), tangent
        found = self._factors(k.F, k.j, *given) if self._factors else _factors_of(k, *given)
        return [factor.reshape(w.shape) for factor in found]

    def _project(self, P: np.ndarray) -> np.ndarray:
        """Nodal forces (dim·nn, ne) of pushed stresses times weights (dim, nq, …, ne)."""
        ne = P.shape[-1]
        return np.matmul(self._gradient.T, P.reshape(self.dim, -1, ne)).reshape(-1, ne)

    def _sandwich(self, blocks) -> np.ndarray:
        """What ``Packed`` keeps of element matrices, of pushed ``tangents`` times weights."""
        ne, (every, half) = self.volume.w.shape[1], self._pairs
        out = np.empty((upper(self.dim, self.volume.nodes.shape[0])[0].size, ne))
        given = [(half if i == k else every, block.reshape(-1, ne)) for i, k, block in blocks]

        def multiply(begin: int, end: int) -> None:
            last = 0
            for pairs, block in given:
                at, last = last, last + pairs.shape[0] * pairs.shape[1]
                whole = out[at:last].reshape(*pairs.shape[:2], ne)
                np.matmul(pairs, block[:, begin:end], out=whole[..., begin:end])

        shared_out(multiply, ne, out.size)
        return out

    def _vector(self, P: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Nodal forces (dim·nn, ne) of a first Piola stress (3, 3, nq·ne) with weights (nq, ne)."""
        jinv = self.volume.jinv
        return self._project(pushed(P[: self.dim, : len(jinv)], jinv) * w[:, None])

    def _entries(self, A: np.ndarray, w: np.ndarray) -> np.ndarray:
        """The same of a tangent dP/dF (dim, dim, dim, dim, nq·ne) and weights (nq, ne)."""
        v, dim = self.volume, self.dim
        A = A.reshape(dim, dim, dim, dim, *v.w.shape)[:, : len(v.jinv), :, : len(v.jinv)]
        weighted = v.jinv[:, :, None] * w  # (m, j, q, e)
        blocks = (
            (i, k, np.einsum("qjne,mjqe->qmne", np.einsum("jlqe,nle->qjne", A[i, :, k], v.jinv), weighted))
            for i in range(dim)
            for k in range(i, dim)
        )
        return self._sandwich(flattened(blocks))

    def smallest_volume_ratio(self, u: np.ndarray) -> float:
        """min J over the quadrature points: an inverted element shows here."""
        return float(self._kinematics(u).J.min())

    def stress(self, u: np.ndarray, p, state) -> np.ndarray:
        """First Piola stress of all laws together (3, 3, nq·ne), MPa, at a converged state."""
        F, at = self.deformation(u), self.points(None)
        P = sum(law.stress(F, p, state, at)[0] for law in self.laws)
        return P * self._stiffness(p).ravel() if self.skins else P

    def energies(self, u, p, state) -> dict[str, float]:
        """Work taken up so far by each law of whose F and state it is a function."""
        k, at = self._kinematics(u), self.points(None)
        w, whole, taken = self.weights(p).ravel(), None, {}
        for law in self.laws:
            if _by_density(law):
                taken[law.name] = law.density(k, p, at)
            else:
                whole = self._padded(k.F) if whole is None else whole
                taken[law.name] = law.work(whole, p, state, at)
        return {name: float(w @ density) for name, density in taken.items() if density is not None}

    def stored(self, u, p, state):
        return self.energies(u, p, state)

    def work(self, u, p, old, new, step):
        before = self.energies(step.u_old, p, old)
        after = self.energies(u, p, new)
        out = {name: after[name] - before[name] for name in after}
        if rest := [law for law in self.laws if law.name not in out]:
            at, w = self.points(None), self.weights(p).ravel()
            F_old, F = self.deformation(step.u_old), self.deformation(u)
            for law in rest:
                mean = (law.stress(F_old, p, old, at)[0] + law.stress(F, p, new, at)[0]) / 2
                out[law.name] = float(w @ (mean * (F - F_old)).sum(axis=(0, 1)))
        return out


def _factors(F, j, *given) -> list[np.ndarray]:
    k = Kinematics(F)
    vars(k)["j"] = j  # NumPy's powers are vectorized
    return _factors_of(k, *given)


def _factors_of(k: Kinematics, laws, p, at, w, tangent: bool) -> list[np.ndarray]:
    """Of stresses, or of their ``tangent``, of all ``laws`` together, times w (N,)."""
    every = [(law.tangent_factors if tangent else law.stress_factors)(k, p, at) for law in laws]
    return [np.multiply(sum(values), w) for values in zip(*every, strict=True)]


def _by_density(law) -> bool:
    """Whether the energy of a law is that of its family, and all the work that it takes up."""
    own = getattr(type(law), "energy", None) is Isotropic.energy
    return own and law.conservative and type(law).work is Bulk.work


def _by_factors(law) -> bool:
    """Whether a law is its factors, and no class below Isotropic has a stress or tangent of its own."""
    kind = type(law)
    return isinstance(law, Isotropic) and (kind.stress, kind.tangent) == (Isotropic.stress, Isotropic.tangent)
