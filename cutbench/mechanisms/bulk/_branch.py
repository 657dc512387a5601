"""One Maxwell branch at finite strain: a neo-Hookean spring on an element that flows.

The spring stores Ψ = G_v/2 (tr C̄ C_i⁻¹ − 3), C̄ = J^(−2/3) FᵀF; the inelastic metric C_i (det C_i = 1)
creeps towards C̄ with τ Ċ_i = C̄ − tr(C̄ C_i⁻¹)/3 C_i, which dissipates whatever happens and needs no frame.
An implicit Euler step has a closed form (Shutov, Landgraf & Ihlemann, Comput. Methods Appl. Mech. Eng.
265 (2013) 213, 10.1016/j.cma.2013.07.004): with s = Δt/τ,

    C_i = A/D,  A = C_i,old + s C̄,  D = det(A)^(1/3),

and then P is the derivative of 3 G_v D/(2 s) by F: the tangent is symmetric.
"""

from __future__ import annotations

import numpy as np

from cutbench.mechanisms.bulk._isotropic import cofactor, det, product


def start(n: int) -> np.ndarray:
    """C_i (3, 3, n) of a material at rest."""
    return np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n)).copy()


class Branch:
    """One branch at F (3, 3, N), with C_i ``metric`` (3, 3, N) after the step.

    ``s`` is Δt/τ, a number or one for each point; ``None`` leaves C_i as it is given.
    """

    def __init__(self, F: np.ndarray, metric: np.ndarray, s: float | np.ndarray | None):
        self.F, J = F, det(F)
        self.j = J ** (-2 / 3)
        self.f = cofactor(F) / J  # F⁻ᵀ
        self.metric, self.s, self.D = metric, 0.0 if s is None else s, np.ones_like(J)
        if s is not None:
            A = metric + s * self.j * product(F.transpose(1, 0, 2), F)
            self.D = det(A) ** (1 / 3)
            self.metric = A / self.D
        self.inverse = cofactor(self.metric)  # symmetric, of determinant 1
        self.H = product(F, self.inverse)
        self.K = product(self.H, F.transpose(1, 0, 2))
        self.trace = self.K[0, 0] + self.K[1, 1] + self.K[2, 2]  # C : C_i⁻¹

    @property
    def energy(self) -> np.ndarray:
        """Stored energy (N,) over G_v."""
        return (self.j * self.trace - 3) / 2

    @property
    def stress(self) -> np.ndarray:
        """P (3, 3, N) over G_v."""
        return self.j * (self.H - self.trace / 3 * self.f)

    def tangent(self, dim: int) -> np.ndarray:
        """dP/dF over G_v (dim, dim, dim, dim, N), C_i moving with F unless it is held."""
        j, trace = self.j, self.trace
        L = product(self.K, self.H)
        flow = self.s * j / self.D
        by = 2 * self.H - 2 / 3 * trace * self.f  # d(J^(−2/3) C : C_i⁻¹)/dF at fixed C_i, over J^(−2/3)
        square = (self.K * self.K).sum(axis=(0, 1))
        pull = j * by + flow * j * (trace / 3 * by - 2 * L + 2 / 3 * square * self.f)
        along_H = j * (flow / 3 * by - 2 / 3 * self.f)
        H, f, B, K, L = (T[:dim, :dim] for T in (self.H, self.f, self.inverse, self.K, L))
        along_H, pull = along_H[:dim, :dim], pull[:dim, :dim]

        def outer(S, T):  # S_iJ T_kL
            return S[:, :, None, None] * T[None, None]

        def crossed(S, T):  # S_iL T_kJ
            return S[:, None, None] * T.transpose(1, 0, 2)[None, :, :, None]

        A = outer(H, along_H) + outer(L, 2 / 3 * flow * j * f) - outer(f, pull / 3)
        A += crossed(j * trace / 3 * f, f) - crossed(flow * j * H, H)
        spring = j * np.eye(dim)[:, :, None] - flow * j * K
        A += spring[:, None, :, None] * B[None, :, None]
        return A
