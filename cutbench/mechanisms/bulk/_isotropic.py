"""Stress and tangent of Ψ = W(Ī₁) + U(J), shared by every law of that kind.

A law gives one scalar derivative; the tensor algebra is here once. The second derivative of the
scalar is its complex step, exact to rounding.
"""

from __future__ import annotations

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


def _flat(T: np.ndarray, dim: int) -> np.ndarray:
    return T[:dim, :dim].reshape(dim * dim, -1)


class Isochoric(Bulk):
    """Ψ = W(Ī₁), Ī₁ = J^(−2/3) tr FᵀF."""

    def dW_dI1(self, I1, p, at):
        """dW/dĪ₁ (N,), MPa; must accept complex Ī₁."""
        raise NotImplementedError(self.name)

    def W(self, I1, p, at):
        """Energy (N,), mJ/mm³."""
        raise NotImplementedError(self.name)

    @staticmethod
    def _invariant(F):
        J = det(F)
        j = J ** (-2 / 3)
        trace = np.einsum("ijn,ijn->n", F, F)
        return J, j, trace

    def energy(self, F, p, state, at):
        J, j, trace = self._invariant(F)
        return self.W(j * trace, p, at)

    def stress(self, F, p, state, at):
        J, j, trace = self._invariant(F)
        w = self.dW_dI1(j * trace, p, at)
        return (2 * w * j) * (F - (trace / (3 * J)) * cofactor(F)), {}

    def tangent(self, F, p, state, at, dim):
        J, j, trace = self._invariant(F)
        I1 = j * trace
        w = self.dW_dI1(I1, p, at)
        w2 = self.dW_dI1(I1 + 1j * STEP, p, at).imag / STEP
        f = _flat(F, dim)
        m = _flat(cofactor(F), dim) / J  # F⁻ᵀ
        d = f - (trace / 3) * m  # dĪ₁/dF = 2 j d
        c = 2 * w * j
        n = f.shape[-1]
        A = (4 * w2 * j * j) * d[:, None] * d[None]
        fm = f[:, None] * m[None]
        A -= (2 / 3 * c) * (fm + fm.transpose(1, 0, 2))
        A += (2 / 9 * c * trace) * m[:, None] * m[None]
        A = A.reshape(dim, dim, dim, dim, n)
        M = m.reshape(dim, dim, n)
        A += (c * trace / 3) * (M[:, None, None, :] * M.transpose(1, 0, 2)[None, :, :, None])
        for i in range(dim):
            for J_ in range(dim):
                A[i, J_, i, J_] += c
        return A


class Volumetric(Bulk):
    """Ψ = U(J). In the mixed formulation the pressure is an unknown of its own."""

    def U(self, J, p):
        raise NotImplementedError(self.name)

    def dU_dJ(self, J, p):
        raise NotImplementedError(self.name)

    def energy(self, F, p, state, at):
        return self.U(det(F), p)

    def stress(self, F, p, state, at):
        return self.dU_dJ(det(F), p) * cofactor(F), {}

    def tangent(self, F, p, state, at, dim):
        J = det(F)
        u1 = self.dU_dJ(J, p)
        u2 = self.dU_dJ(J + 1j * STEP, p).imag / STEP
        C = cofactor(F)
        m = _flat(C, dim)
        n = m.shape[-1]
        # d²J/dF² = (C⊗C − C⊠C)/J, with C the cofactor.
        A = (u2 + u1 / J) * m[:, None] * m[None]
        A = A.reshape(dim, dim, dim, dim, n)
        M = m.reshape(dim, dim, n)
        A -= (u1 / J) * (M[:, None, None, :] * M.transpose(1, 0, 2)[None, :, :, None])
        return A
