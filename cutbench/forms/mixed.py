"""Mixed bulk form for nearly incompressible solids: quadratic displacements, linear pressures.

The volumetric law U(J) leaves the bulk form and comes in through its Legendre transform (Taylor–Hood):

    Π = ∫ p̂ (J − J̄(p̂)) + U(J̄(p̂)) dV,   dU/dJ(J̄) = p̂,

    δu:  ∫ p̂ cof F : ∇₀δu dV,            δp̂:  ∫ δp̂ (J − J̄(p̂)) dV.

For U = κ/2 (J−1)² that is J̄ = 1 + p̂/κ and the classical perturbed Lagrangian with its block −M/κ. Both
residuals come from one potential, so the tangent is symmetric for every U. p̂ is positive in tension.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from cutbench.forms.base import Local, Packed
from cutbench.forms.bulk import BulkForm
from cutbench.forms.space import Space
from cutbench.mechanisms.base import STEP
from cutbench.mechanisms.bulk._isotropic import Volumetric, cofactor, det

#: Newton iterations for J̄; more mean that no volume carries the pressure.
ITERATIONS = 60


class MixedVolumetric(BulkForm):
    """One volumetric law with a continuous pressure, one unknown in MPa a vertex.

    The vector of unknowns has the displacements first: vertex v's pressure is number ``space.ndof + v``,
    ``ndof`` unknowns in all. Local order: displacements component-major, then pressures.
    Raises ValueError for a space that is not quadratic: equal orders are unstable.
    """

    name = "pressure"

    def __init__(self, law: Volumetric, space: Space, degree: int, height: float, skins=()):
        if space.order != 2:
            raise ValueError(f"a linear pressure needs quadratic displacements, not order {space.order}")
        super().__init__((law,), space.volume(degree), height, skins)
        linear = space.volume(degree, order=1)
        self._press(linear.phi, space.ndof + linear.nodes)
        self.ndof = space.ndof + space.mesh.p.shape[1]

    def _press(self, phi: np.ndarray, dofs: np.ndarray) -> None:
        """Shape functions (nq, nv) and numbers (nv, ne) of the pressures."""
        self.phi, self.pressure_dofs = phi, dofs
        self.dofs = np.concatenate([self.dofs, dofs])

    def part(self, columns):
        some = copy(self)
        BulkForm.__init__(some, self.laws, self.volume.some(columns), self._height, self.skins)
        some._press(self.phi, self.pressure_dofs[:, columns])
        return some

    def pressure(self, u: np.ndarray) -> np.ndarray:
        """p̂ (nq·ne,) in MPa at the quadrature points."""
        return (self.phi @ u[self.pressure_dofs]).ravel()

    def stress(self, u: np.ndarray, p=None, state=None) -> np.ndarray:
        """The pressure's part of the first Piola stress, p̂ cof F (3, 3, nq·ne), MPa."""
        return self.pressure(u) * cofactor(self.deformation(u))

    def evaluate(self, u, p, state, step):
        F, pressure = self.deformation(u), self.pressure(u)
        C = cofactor(F)
        # A skin scales U, so its derivative at J̄ is p̂ over the factor.
        factor = self._stiffness(p).ravel() if self.skins else 1.0
        volume, slope = self._volume_at(pressure / factor, p)
        (nq, ne), w = self.volume.w.shape, self.volume.w
        gap = (det(F) - volume).reshape(nq, ne)
        vector = np.concatenate([self._vector(pressure * C, w), self.phi.T @ (gap * w)])

        def slopes() -> np.ndarray:
            nu, nd = self._vector_size, self.dofs.shape[0]
            matrix = np.empty((nd, nd, ne))
            entries = self._entries(pressure * _cofactor_slope(F, self.dim), w)
            matrix[:nu, :nu] = Packed(self.dim, self.volume.nodes.shape[0], entries).whole()
            for v in range(self.phi.shape[1]):
                column = self._vector(np.repeat(self.phi[:, v], ne) * C, w)
                matrix[:nu, nu + v] = matrix[nu + v, :nu] = column
            compliance = w / (factor * slope).reshape(nq, ne)  # dJ̄/dp̂ = 1/U''
            matrix[nu:, nu:] = -np.einsum("qv,qe,qx->vxe", self.phi, compliance, self.phi)
            return matrix

        return Local(vector, slopes, state)

    def energies(self, u, p, state) -> dict[str, float]:
        """∫ p̂ (J − J̄) + U(J̄) dV under the law's name.

        Not ∫ U(J): the work of the nodal forces is ∫ p̂ dJ, and p̂ knows only the part of J that linear
        functions see. Where the pressure's equations hold, this is ∫ U(J̄), and its change is that work.
        """
        (law,) = self.laws
        pressure = self.pressure(u)
        factor = self._stiffness(p).ravel() if self.skins else 1.0
        volume, _ = self._volume_at(pressure / factor, p)
        density = pressure * (det(self.deformation(u)) - volume) + factor * law.U(volume, p)
        return {law.name: float(self.volume.w.ravel() @ density)}

    @property
    def _vector_size(self) -> int:
        return self.dim * self.volume.nodes.shape[0]

    def _volume_at(self, pressure: np.ndarray, p) -> tuple[np.ndarray, np.ndarray]:
        """J̄ > 0 with dU/dJ(J̄) = p̂, and U''(J̄), both (N,); NaN where there is none.

        The slope is a difference of two complex steps, so that parameters may be complex themselves, and it
        is real: the last iteration then leaves the exact imaginary part.
        """
        (law,) = self.laws
        J = np.ones_like(pressure) + 0 * law.dU_dJ(np.ones(1), p)
        for _ in range(ITERATIONS):
            force = law.dU_dJ(J, p)
            slope = (law.dU_dJ(J.real + 1j * STEP, p) - law.dU_dJ(J.real + 0j, p)).imag / STEP
            new = J - (force - pressure) / slope
            new = np.where(new.real > 0, new, J / 2)
            change = np.abs((new - J).real)
            J = new
            # Quadratic convergence: after a change this small the next one is below rounding.
            if np.all(change <= 1e-9 * J.real):
                break
        lost = ~(change <= 1e-9 * J.real)
        force = law.dU_dJ(J, p)
        slope = (law.dU_dJ(J.real + 1j * STEP, p) - law.dU_dJ(J.real + 0j, p)).imag / STEP
        J = J - (force - pressure) / slope
        return np.where(lost, np.nan, J), slope


def _cofactor_slope(F: np.ndarray, dim: int) -> np.ndarray:
    """d(cof F)_iJ/dF_kL = ε_ikm ε_JLN F_mN (dim, dim, dim, dim, N): linear in F, no division by J."""
    A = np.zeros((dim, dim, dim, dim, F.shape[-1]))
    sign = {(0, 1): 1, (1, 2): 1, (2, 0): 1, (1, 0): -1, (2, 1): -1, (0, 2): -1}
    for (i, k), s in sign.items():
        for (J, L), t in sign.items():
            if max(i, k, J, L) < dim:
                A[i, J, k, L] = s * t * F[3 - i - k, 3 - J - L]
    return A
