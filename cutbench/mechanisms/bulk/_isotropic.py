"""Stress and tangent of Ψ = W(Ī₁) + U(J), shared by every law of that kind, and of Ψ = W(Ī₁, Ī₂).

A law gives one scalar derivative; the tensor algebra is here once. The second derivative of the
scalar is its complex step, exact to rounding. With C = dJ/dF the cofactor of F, each such law is

    P = s F + c C,
    dP/dF = ff F⊗F + fc (F⊗C + C⊗F) + cc C⊗C + swap C⊠C + one 1,   (C⊠C)_iJkL = C_iL C_kJ,

so the factors of several laws can be summed before the tensors are built, and the tensors can be
built from F and C in any frame of the material indices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np

from cutbench.mechanisms.base import STEP, Bulk


def det(F: np.ndarray) -> np.ndarray:
    """Determinant of F (3, 3, N)."""
    return (
        F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
        + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    )


def cofactor(F: np.ndarray) -> np.ndarray:
    """dJ/dF = J F⁻ᵀ (3, 3, N)."""
    C = np.empty_like(F)
    for i in range(3):
        for J in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (J + 1) % 3, (J + 2) % 3
            C[i, J] = F[a, c] * F[b, d] - F[a, d] * F[b, c]
    return C


def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A B (3, 3, N)."""
    return sum(A[:, k, None] * B[None, k] for k in range(3))


class Kinematics:
    """What the laws need of F, computed once for all of them.

    ``F`` (3, 3, N), or of a section, of which nothing depends on z, its first two columns: (2, 2, N) in plane
    strain, (3, 2, N) where it is sheared along z; F_33 = 1.
    ``C`` its cofactor in as many rows and columns, ``J`` (N,) its determinant, ``trace`` (N,) tr FᵀF.
    """

    def __init__(self, F: np.ndarray, J: np.ndarray | None = None, trace: np.ndarray | None = None):
        """``J`` and ``trace`` where they are known."""
        self.F = F
        if J is not None:
            self.J = J
        if trace is not None:
            self.trace = trace

    @cached_property
    def C(self) -> np.ndarray:
        F = self.F
        if F.shape[1] == 2:
            none = [0 * F[0, 0]] * (F.shape[0] - 2) * 2
            return np.stack([F[1, 1], -F[1, 0], -F[0, 1], F[0, 0], *none]).reshape(F.shape)
        return cofactor(F)

    @cached_property
    def J(self) -> np.ndarray:
        return sum(self.F[0, J] * self.C[0, J] for J in range(self.F.shape[1]))

    @cached_property
    def trace(self) -> np.ndarray:
        return np.einsum("ijn,ijn->n", self.F, self.F) + (3 - self.F.shape[1])

    @cached_property
    def j(self) -> np.ndarray:
        """J^(−2/3)."""
        return self.J ** (-2 / 3)

    @cached_property
    def I1(self) -> np.ndarray:
        """Ī₁ = J^(−2/3) tr FᵀF."""
        return self.j * self.trace

    @cached_property
    def I2(self) -> np.ndarray:
        """Ī₂ = J^(−4/3) |cof F|², of F in three dimensions."""
        return self.j**2 * (self.C * self.C).sum(axis=(0, 1))

    @cached_property
    def r(self) -> np.ndarray:
        """tr FᵀF/(3J): dĪ₁/dF = 2 J^(−2/3) (F − r C)."""
        return self.trace / (3 * self.J)


def tangent_blocks(
    factors: Sequence[np.ndarray], F: np.ndarray, C: np.ndarray, metric: np.ndarray
) -> Iterator[tuple[int, int, np.ndarray]]:
    """i, k ≥ i and dP_iJ/dF_kL (…, J, L, n); the blocks below the diagonal follow by symmetry.

    ``factors`` ff, fc, cc, swap, one (…, n); ``F``, ``C`` (dim, …, dim, n) with the material index last
    but one, in any frame; ``metric`` (dim, dim, n) is the unit tensor in that frame.
    """
    ff, fc, cc, swap, one = (factor[..., None, :] for factor in factors)
    by_F, by_C, swapped = ff * F + fc * C, fc * F + cc * C, swap * C
    for i in range(F.shape[0]):
        for k in range(i, F.shape[0]):
            A = F[i][..., :, None, :] * by_F[k][..., None, :, :]
            if i == k:
                A += C[i][..., :, None, :] * (by_C[i] + swapped[i])[..., None, :, :]
                A += one[..., None, :] * metric
            else:
                A += C[i][..., :, None, :] * by_C[k][..., None, :, :]
                A += C[k][..., :, None, :] * swapped[i][..., None, :, :]
            yield i, k, A


def whole_tangent(factors: Sequence, k: Kinematics, dim: int) -> np.ndarray:
    """dP/dF (dim, dim, dim, dim, N) of the factors ff, fc, cc, swap, one, from kinematics in 3D."""
    factors = np.broadcast_arrays(*factors, k.J)[:-1]
    A = np.empty((dim, dim, dim, dim, k.J.size), k.J.dtype)
    for i, m, block in tangent_blocks(factors, k.F[:dim, :dim], k.C[:dim, :dim], np.eye(dim)[:, :, None]):
        A[i, :, m] = block
        A[m, :, i] = block.transpose(1, 0, 2)
    return A


class Isotropic(Bulk):
    """A law given by the factors above, and its energy by ``density(k, p, at)`` (N,), of kinematics that may
    be in the plane."""

    density: Callable[..., np.ndarray]

    def stress_factors(self, k: Kinematics, p, at) -> tuple:
        """s and c, each (N,) or a number."""
        raise NotImplementedError(self.name)

    def tangent_factors(self, k: Kinematics, p, at) -> tuple:
        """ff, fc, cc, swap and one, each (N,) or a number."""
        raise NotImplementedError(self.name)

    def energy(self, F, p, state, at):
        return self.density(Kinematics(F), p, at)

    def stress(self, F, p, state, at):
        k = Kinematics(F)
        s, c = self.stress_factors(k, p, at)
        return s * F + c * k.C, {}

    def tangent(self, F, p, state, at, dim):
        k = Kinematics(F)
        return whole_tangent(self.tangent_factors(k, p, at), k, dim)


class Isochoric(Isotropic):
    """Ψ = W(Ī₁), Ī₁ = J^(−2/3) tr FᵀF."""

    def dW_dI1(self, I1, p, at):
        """dW/dĪ₁ (N,), MPa; must accept complex Ī₁."""
        raise NotImplementedError(self.name)

    def shear_modulus(self, p):
        return np.ravel(2 * self.dW_dI1(np.array([3.0]), p, None))[0]

    def W(self, I1, p, at):
        """Energy (N,), mJ/mm³."""
        raise NotImplementedError(self.name)

    def density(self, k, p, at):
        return self.W(k.I1, p, at)

    def stress_factors(self, k, p, at):
        s = 2 * self.dW_dI1(k.I1, p, at) * k.j
        return s, -s * k.r

    def tangent_factors(self, k, p, at):
        probe = self.dW_dI1(k.I1 + 1j * STEP, p, at)
        s = 2 * probe.real * k.j
        bend = 4 / STEP * probe.imag * k.j**2
        by_J = s / k.J
        slope = 2 / 3 * by_J
        return bend, -k.r * bend - slope, k.r * (k.r * bend + slope), k.r * by_J, s


class TwoInvariants(Bulk):
    """Ψ = W(Ī₁, Ī₂), Ī₁ = J^(−2/3) tr FᵀF and Ī₂ = J^(−4/3) tr cof(FᵀF)."""

    def dW_dI1(self, I1, I2, p, at):
        """∂W/∂Ī₁ (N,), MPa; must accept complex Ī₁ and Ī₂."""
        raise NotImplementedError(self.name)

    def dW_dI2(self, I1, I2, p, at):
        """∂W/∂Ī₂ (N,), MPa, likewise."""
        raise NotImplementedError(self.name)

    def W(self, I1, I2, p, at):
        """Energy (N,), mJ/mm³."""
        raise NotImplementedError(self.name)

    def shear_modulus(self, p):
        rest = np.array([3.0]), np.array([3.0]), p, None
        return np.ravel(2 * (self.dW_dI1(*rest) + self.dW_dI2(*rest)))[0]

    def energy(self, F, p, state, at):
        k = Kinematics(F)
        return self.W(k.I1, k.I2, p, at)

    def stress(self, F, p, state, at):
        k = Kinematics(F)
        invariants = k.I1, k.I2, p, at
        by_I1, by_I2 = 2 * self.dW_dI1(*invariants), 2 * self.dW_dI2(*invariants)
        # dI₂/dF is 2 (I₁ F − F FᵀF).
        bent = k.j**2 * (k.trace * F - product(F, product(F.transpose(1, 0, 2), F)))
        return by_I1 * k.j * (F - k.r * k.C) + by_I2 * (bent - 2 / 3 * k.I2 / k.J * k.C), {}


class Volumetric(Isotropic):
    """Ψ = U(J). In the mixed formulation the pressure is an unknown of its own."""

    adds_stiffness = False

    def U(self, J, p):
        raise NotImplementedError(self.name)

    def dU_dJ(self, J, p):
        raise NotImplementedError(self.name)

    def density(self, k, p, at):
        return self.U(k.J, p)

    def stress_factors(self, k, p, at):
        return 0.0, self.dU_dJ(k.J, p)

    def tangent_factors(self, k, p, at):
        # d²J/dF² = (C⊗C − C⊠C)/J.
        probe = self.dU_dJ(k.J + 1j * STEP, p)
        u = probe.real / k.J
        return 0.0, 0.0, probe.imag / STEP + u, -u, 0.0
