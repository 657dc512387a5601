"""What a bulk form does at its points: deformation, and stresses and tangents pushed to reference elements.

Its loops are compiled, of a section's points, which may have a displacement along z, and of a solid's.
Complex numbers go through NumPy.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

from cutbench.base.compiled import COMPILED, compiled
from cutbench.base.threads import shared_out
from cutbench.mechanisms.bulk._isotropic import Kinematics, tangent_blocks

#: Indices i ≤ k of tangent blocks, by dimension.
_BLOCKS = {dim: tuple((i, k) for i in range(dim) for k in range(i, dim)) for dim in (2, 3)}


def deformed(G: np.ndarray, jinv: np.ndarray) -> Kinematics:
    """From gradients by reference coordinates G (dim, nq, m, ne), and ``jinv`` (m, m, ne) of these: m is 3 in
    a solid, else 2."""
    if COMPILED and G.dtype.kind == "f":
        if len(jinv) == 3:
            return Kinematics(*_deformed_solid(G, jinv))
        F, J, trace = _deformed(G, jinv)
        if len(G) == 3:
            _sheared(G[2], jinv, F, trace)
        return Kinematics(F, J, trace)
    F = np.einsum("iqme,mje->ijqe", G, jinv)
    for i in range(len(jinv)):
        F[i, i] += 1.0
    return Kinematics(F.reshape(*F.shape[:2], -1))


def pushed(T: np.ndarray, jinv: np.ndarray) -> np.ndarray:
    """The material index pushed to the reference element: (dim, m, nq·ne) to (dim, nq, m, ne)."""
    return np.einsum("ijqe,mje->iqme", T.reshape(*T.shape[:2], -1, jinv.shape[-1]), jinv)


def stresses(k: Kinematics, factors: Iterable[np.ndarray], jinv: np.ndarray) -> np.ndarray:
    """P = s F + c cof F, pushed (dim, nq, m, ne), of factors s and c (nq, ne)."""
    s, c = factors
    if COMPILED and k.F.dtype.kind == s.dtype.kind == c.dtype.kind == "f":
        return (_stresses if len(jinv) == 2 else _stresses_solid)(k.F, s, c, jinv)
    return s[:, None] * pushed(k.F, jinv) + c[:, None] * pushed(k.C, jinv)


def tangents(
    k: Kinematics, factors: Iterable[np.ndarray], jinv: np.ndarray
) -> Iterable[tuple[int, int, np.ndarray]]:
    """i, k ≥ i and dP_iJ/dF_kL, pushed, of factors ff, fc, cc, swap, one (nq, ne): (nq, m², ne) by J and L,
    where i = k (nq, m (m + 1)/2, ne) of J ≤ L alone."""
    if COMPILED:
        ff, fc, *rest = factors
        if len(jinv) == 3:
            nq, ne = ff.shape
            own, other = np.empty((3, nq, 6, ne)), np.empty((3, nq, 9, ne))
            shared_out(partial(_tangents_solid, k.F, ff, fc, *rest, jinv, own, other), nq, 2 * other.size)
            blocks: tuple = own[0], other[0], other[1], own[1], other[2], own[2]
        else:
            blocks = _tangents(k.F, ff, fc, *rest, jinv)
        if len(k.F) > len(jinv):
            A, B, C = blocks
            A_z, B_z, C_z = _tangents_along(k.F, ff, fc, rest[-1], jinv)
            blocks = A, B, A_z, C, B_z, C_z
        yield from ((i, j, A) for (i, j), A in zip(_BLOCKS[len(k.F)], blocks, strict=True))
        return
    metric = np.einsum("mje,nje->mne", jinv, jinv)
    yield from flattened(tangent_blocks(tuple(factors), pushed(k.F, jinv), pushed(k.C, jinv), metric))


def flattened(blocks: Iterable) -> Iterable[tuple[int, int, np.ndarray]]:
    """Blocks i, k ≥ i, (nq, dim, dim, ne) as those of ``tangents``."""
    for i, k, A in blocks:
        J, L = np.triu_indices(A.shape[1]) if i == k else np.indices(A.shape[1:3]).reshape(2, -1)
        yield i, k, A[:, J, L]


@compiled()
def _deformed(G, jinv):
    """F (dim, 2, nq·ne), of whose third row nothing is said; its determinant, and tr FᵀF in plane strain."""
    dim, nq, _, ne = G.shape
    F, J, trace = np.empty((dim, 2, nq * ne)), np.empty(nq * ne), np.empty(nq * ne)
    for q in range(nq):
        for e in range(ne):
            n = q * ne + e
            a = 1 + G[0, q, 0, e] * jinv[0, 0, e] + G[0, q, 1, e] * jinv[1, 0, e]
            b = G[0, q, 0, e] * jinv[0, 1, e] + G[0, q, 1, e] * jinv[1, 1, e]
            c = G[1, q, 0, e] * jinv[0, 0, e] + G[1, q, 1, e] * jinv[1, 0, e]
            d = 1 + G[1, q, 0, e] * jinv[0, 1, e] + G[1, q, 1, e] * jinv[1, 1, e]
            F[0, 0, n], F[0, 1, n], F[1, 0, n], F[1, 1, n] = a, b, c, d
            J[n] = a * d - b * c
            trace[n] = a * a + b * b + c * c + d * d + 1
    return F, J, trace


@compiled()
def _sheared(G, jinv, F, trace):
    """Fills the row F_3J of a section in and adds its square to the ``trace``: G (nq, 2, ne) of u_z."""
    nq, _, ne = G.shape
    for q in range(nq):
        for e in range(ne):
            a = G[q, 0, e] * jinv[0, 0, e] + G[q, 1, e] * jinv[1, 0, e]
            b = G[q, 0, e] * jinv[0, 1, e] + G[q, 1, e] * jinv[1, 1, e]
            F[2, 0, q * ne + e], F[2, 1, q * ne + e] = a, b
            trace[q * ne + e] += a * a + b * b


@compiled()
def _stresses(F, s, c, jinv):
    dim, (nq, ne) = len(F), s.shape
    P = np.empty((dim, nq, 2, ne))
    for q in range(nq):
        for e in range(ne):
            n, by_F, by_C = q * ne + e, s[q, e], c[q, e]
            p00 = by_F * F[0, 0, n] + by_C * F[1, 1, n]
            p01 = by_F * F[0, 1, n] - by_C * F[1, 0, n]
            p10 = by_F * F[1, 0, n] - by_C * F[0, 1, n]
            p11 = by_F * F[1, 1, n] + by_C * F[0, 0, n]
            for m in range(2):
                P[0, q, m, e] = p00 * jinv[m, 0, e] + p01 * jinv[m, 1, e]
                P[1, q, m, e] = p10 * jinv[m, 0, e] + p11 * jinv[m, 1, e]
                if dim == 3:  # no cofactor stands there
                    P[2, q, m, e] = by_F * (F[2, 0, n] * jinv[m, 0, e] + F[2, 1, n] * jinv[m, 1, e])
    return P


@compiled()
def _tangents(F, ff, fc, cc, swap, one, jinv):
    nq, ne = ff.shape
    A, B, C = np.empty((nq, 3, ne)), np.empty((nq, 4, ne)), np.empty((nq, 3, ne))
    for q in range(nq):
        for e in range(ne):
            n = q * ne + e
            h00, h01, h10, h11 = jinv[0, 0, e], jinv[0, 1, e], jinv[1, 0, e], jinv[1, 1, e]
            m00, m01, m11 = h00 * h00 + h01 * h01, h00 * h10 + h01 * h11, h10 * h10 + h11 * h11
            F00, F01, F10, F11 = F[0, 0, n], F[0, 1, n], F[1, 0, n], F[1, 1, n]
            f00, f01 = F00 * h00 + F01 * h01, F00 * h10 + F01 * h11
            f10, f11 = F10 * h00 + F11 * h01, F10 * h10 + F11 * h11
            c00, c01 = F11 * h00 - F10 * h01, F11 * h10 - F10 * h11
            c10, c11 = F00 * h01 - F01 * h00, F00 * h11 - F01 * h10
            by_ff, by_fc, by_cc, by_swap, by_one = ff[q, e], fc[q, e], cc[q, e], swap[q, e], one[q, e]
            x00, x01 = by_ff * f00 + by_fc * c00, by_ff * f01 + by_fc * c01
            x10, x11 = by_ff * f10 + by_fc * c10, by_ff * f11 + by_fc * c11
            y00, y01 = by_fc * f00 + by_cc * c00, by_fc * f01 + by_cc * c01
            y10, y11 = by_fc * f10 + by_cc * c10, by_fc * f11 + by_cc * c11
            z00, z01, z10, z11 = by_swap * c00, by_swap * c01, by_swap * c10, by_swap * c11
            A[q, 0, e] = f00 * x00 + c00 * (y00 + z00) + by_one * m00
            A[q, 1, e] = f00 * x01 + c00 * (y01 + z01) + by_one * m01
            A[q, 2, e] = f01 * x01 + c01 * (y01 + z01) + by_one * m11
            B[q, 0, e] = f00 * x10 + c00 * y10 + c10 * z00
            B[q, 1, e] = f00 * x11 + c00 * y11 + c10 * z01
            B[q, 2, e] = f01 * x10 + c01 * y10 + c11 * z00
            B[q, 3, e] = f01 * x11 + c01 * y11 + c11 * z01
            C[q, 0, e] = f10 * x10 + c10 * (y10 + z10) + by_one * m00
            C[q, 1, e] = f10 * x11 + c10 * (y11 + z11) + by_one * m01
            C[q, 2, e] = f11 * x11 + c11 * (y11 + z11) + by_one * m11
    return A, B, C


@compiled()
def _tangents_along(F, ff, fc, one, jinv):
    """Of a section the blocks of u_z, with u_x, u_y and itself."""
    nq, ne = ff.shape
    A, B, C = np.empty((nq, 4, ne)), np.empty((nq, 4, ne)), np.empty((nq, 3, ne))
    for q in range(nq):
        for e in range(ne):
            n, by_ff, by_fc, by_one = q * ne + e, ff[q, e], fc[q, e], one[q, e]
            h00, h01, h10, h11 = jinv[0, 0, e], jinv[0, 1, e], jinv[1, 0, e], jinv[1, 1, e]
            f0, f1 = F[2, 0, n] * h00 + F[2, 1, n] * h01, F[2, 0, n] * h10 + F[2, 1, n] * h11
            a0, a1 = by_ff * F[0, 0, n] + by_fc * F[1, 1, n], by_ff * F[0, 1, n] - by_fc * F[1, 0, n]
            b0, b1 = by_ff * F[1, 0, n] - by_fc * F[0, 1, n], by_ff * F[1, 1, n] + by_fc * F[0, 0, n]
            for m in range(2):
                x, y = a0 * jinv[m, 0, e] + a1 * jinv[m, 1, e], b0 * jinv[m, 0, e] + b1 * jinv[m, 1, e]
                A[q, 2 * m, e], A[q, 2 * m + 1, e] = x * f0, x * f1
                B[q, 2 * m, e], B[q, 2 * m + 1, e] = y * f0, y * f1
            C[q, 0, e] = by_ff * f0 * f0 + by_one * (h00 * h00 + h01 * h01)
            C[q, 1, e] = by_ff * f0 * f1 + by_one * (h00 * h10 + h01 * h11)
            C[q, 2, e] = by_ff * f1 * f1 + by_one * (h10 * h10 + h11 * h11)
    return A, B, C


@compiled()
def _deformed_solid(G, jinv):
    """F (3, 3, nq·ne), its determinant, and tr FᵀF."""
    nq, ne = G.shape[1], G.shape[3]
    F, J, trace = np.empty((3, 3, nq * ne)), np.empty(nq * ne), np.zeros(nq * ne)
    for q in range(nq):
        for i in range(3):
            for j in range(3):
                own = 1.0 if i == j else 0.0
                for e in range(ne):
                    part = own + G[i, q, 0, e] * jinv[0, j, e] + G[i, q, 1, e] * jinv[1, j, e]
                    part += G[i, q, 2, e] * jinv[2, j, e]
                    F[i, j, q * ne + e] = part
                    trace[q * ne + e] += part * part
    for n in range(nq * ne):
        J[n] = F[0, 0, n] * (F[1, 1, n] * F[2, 2, n] - F[1, 2, n] * F[2, 1, n])
        J[n] += F[0, 1, n] * (F[1, 2, n] * F[2, 0, n] - F[1, 0, n] * F[2, 2, n])
        J[n] += F[0, 2, n] * (F[1, 0, n] * F[2, 1, n] - F[1, 1, n] * F[2, 0, n])
    return F, J, trace


@compiled()
def _stresses_solid(F, s, c, jinv):
    nq, ne = s.shape
    P = np.empty((3, nq, 3, ne))
    for q in range(nq):
        for i in range(3):
            k, m = (i + 1) % 3, (i + 2) % 3
            for e in range(ne):
                n, by_F, by_C = q * ne + e, s[q, e], c[q, e]
                x = by_F * F[i, 0, n] + by_C * (F[k, 1, n] * F[m, 2, n] - F[k, 2, n] * F[m, 1, n])
                y = by_F * F[i, 1, n] + by_C * (F[k, 2, n] * F[m, 0, n] - F[k, 0, n] * F[m, 2, n])
                z = by_F * F[i, 2, n] + by_C * (F[k, 0, n] * F[m, 1, n] - F[k, 1, n] * F[m, 0, n])
                for M in range(3):
                    P[i, q, M, e] = x * jinv[M, 0, e] + y * jinv[M, 1, e] + z * jinv[M, 2, e]
    return P


@compiled()
def _tangents_solid(F, ff, fc, cc, swap, one, jinv, own, other, begin, end):
    """Of some points: blocks i = k, and those of i < k."""
    ne = ff.shape[1]
    f, c = np.empty((3, 3)), np.empty((3, 3))
    for q in range(begin, end):
        for e in range(ne):
            n = q * ne + e
            for i in range(3):
                k, m = (i + 1) % 3, (i + 2) % 3
                x = F[k, 1, n] * F[m, 2, n] - F[k, 2, n] * F[m, 1, n]
                y = F[k, 2, n] * F[m, 0, n] - F[k, 0, n] * F[m, 2, n]
                z = F[k, 0, n] * F[m, 1, n] - F[k, 1, n] * F[m, 0, n]
                for M in range(3):
                    h0, h1, h2 = jinv[M, 0, e], jinv[M, 1, e], jinv[M, 2, e]
                    f[i, M] = F[i, 0, n] * h0 + F[i, 1, n] * h1 + F[i, 2, n] * h2
                    c[i, M] = x * h0 + y * h1 + z * h2
            by_ff, by_fc, by_cc, by_swap, by_one = ff[q, e], fc[q, e], cc[q, e], swap[q, e], one[q, e]
            block = 0
            for i in range(3):
                for k in range(i, 3):
                    at = 0
                    for M in range(3):
                        for N in range(M if i == k else 0, 3):
                            by_f = by_ff * f[k, N] + by_fc * c[k, N]
                            by_c = by_fc * f[k, N] + by_cc * c[k, N]
                            part = f[i, M] * by_f + c[i, M] * by_c + by_swap * c[k, M] * c[i, N]
                            if i == k:
                                metric = jinv[M, 0, e] * jinv[N, 0, e] + jinv[M, 1, e] * jinv[N, 1, e]
                                part += by_one * (metric + jinv[M, 2, e] * jinv[N, 2, e])
                                own[i, q, at, e] = part
                            else:
                                other[block, q, at, e] = part
                            at += 1
                    block += i != k
