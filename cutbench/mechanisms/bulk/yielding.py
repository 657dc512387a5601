"""A branch that yields: its stress follows an elastic law until it is worth σ_Y, and no further, at any rate.

The branch (see ``_branch``) has the modulus G_Y = g_Y G. Its inelastic metric stands still while its
equivalent Kirchhoff stress √(3/2) |dev τ| is below σ_Y, von Mises' criterion, and else flows so far that in a
step

    Ψ(C̄, C_i) + k √φ,  φ = (tr(C_i,old C_i⁻¹) − 3)/2,  k = √(2/3) σ_Y,

is least: √φ is the length of the step, and k √φ what it dissipates (the variational update of Ortiz &
Stainier, Comput. Methods Appl. Mech. Eng. 171 (1999) 419, 10.1016/S0045-7825(98)00219-9). That is a step of
the creeping branch, of just the s with s k = 2 G_Y √φ, and P is the derivative of that sum by F. Beside an
elastic law, which hardens it: cheese, dough, butter.
"""

import numpy as np

from cutbench.base.symbols import iterated
from cutbench.base.units import Parameter
from cutbench.mechanisms.base import STEP, Bulk
from cutbench.mechanisms.bulk import _branch
from cutbench.mechanisms.bulk._isotropic import cofactor, det, product

#: Newton's steps at the most, and the relative change at which they end; digits double.
STEPS, ENOUGH = 60, 1e-10


def _drive(s, I1, I2):
    """2 √φ/s, from the invariants of C̄ C_i,old⁻¹, free of cancellation."""
    volume, sides = 1 + s * (I1 + s * (I2 + s)), 3 + s * (2 * I1 + s * I2)
    D = volume ** (1 / 3)
    slope, rest = 2 * I1 + s * I2, I1 + s * (I2 + s)
    ahead = 9 * slope * slope - 27 * rest * rest - 27 * (I2 + 2 * s) + s * slope * slope * slope
    # At rest it is a difference of equal numbers, and nothing flows.
    ahead = np.where(np.real(ahead) > 1e-12, ahead, 1e-12)
    return np.sqrt(2 * ahead / (D * D * (sides * sides + 3 * sides * D * D + 9 * D**4)))


def _flow(I1, I2, limit):
    """s (N,) at which the drive is the ``limit``, 0 where it does not get there."""
    real = np.real(I1), np.real(I2)
    at_rest = _drive(0.0, *real)
    flows = at_rest > np.real(limit)
    # Elsewhere 0 is where it is to stay.
    limit = np.where(flows, limit, at_rest)

    def towards(s, I1, I2, limit):
        """The next s: 1/drive is nearly a straight line."""
        drive = _drive(s, I1, I2)
        slope = _drive(np.real(s) + 1j * STEP, *real).imag / STEP
        return s + (drive - drive * drive / limit) / slope

    def advance(s):
        new = np.maximum(towards(s, *real, np.real(limit)), s / 10)
        return new, (new - s) * (new - s) < (ENOUGH * (1 + s)) ** 2

    s = iterated(advance, np.where(flows, 1e-8, 0.0), STEPS)
    return np.where(flows, towards(s, I1, I2, limit), 0.0)


class Yielding(Bulk):
    """Stress of a branch that saturates; the ledger's entry is what it stores and dissipates."""

    name = "yielding"
    title = "yielding"
    family = "yielding"
    resembles = ("G",)
    role = "yielding"
    conservative = False
    reads = ("G",)
    parameters = (
        Parameter.effect(
            "g_Y", "1", "g_Y", "modulus of the branch that yields, over G", high=50.0, typical=2.0
        ),
        Parameter.positive("sigma_Y", "kPa", "σ_Y", "stress at which the branch yields", default=10.0),
    )

    def groups(self, p):
        return {"g_Y": p.g_Y, "sigma_Y/G": p.sigma_Y / p.G}

    def start(self, n, p):
        return {"metric_Y": _branch.start(n)}

    def _invariants(self, F, state):
        """Those of C̄ C_i,old⁻¹ (N,)."""
        C, metric = det(F) ** (-2 / 3) * product(F.transpose(1, 0, 2), F), state["metric_Y"]
        return (C * cofactor(metric)).sum(axis=(0, 1)), (cofactor(C) * metric).sum(axis=(0, 1))

    def _branch(self, F, p, state, at):
        metric = state["metric_Y"]
        if at.held:
            return _branch.Branch(F, metric, None)
        modulus = p.G * np.where(np.real(p.g_Y) > 0, p.g_Y, 1e-12)
        I1, I2 = self._invariants(F, state)
        s = _flow(I1, I2, np.sqrt(2 / 3) * p.sigma_Y / modulus)
        return _branch.Branch(F, metric, s)

    def stress(self, F, p, state, at):
        branch = self._branch(F, p, state, at)
        return p.g_Y * p.G * branch.stress, {"metric_Y": branch.metric}

    def tangent(self, F, p, state, at, dim):
        branch = self._branch(F, p, state, at)
        A = branch.tangent(dim)
        if not at.held:
            # s changes as the drive stays: with it P by its slope along s, which is the drive's by F.
            s = branch.s
            drive = _drive(s + 1j * STEP, *self._invariants(F, state))
            along = _branch.Branch(F, state["metric_Y"], s + 1j * STEP).stress[:dim, :dim].imag / STEP
            lost = np.where(s > 0, 2 / (drive.real * drive.imag / STEP), 0.0)
            A = A + lost * along[:, :, None, None] * along[None, None]
        return p.g_Y * p.G * A

    def energy(self, F, p, state, at):
        return p.g_Y * p.G * _branch.Branch(F, state["metric_Y"], None).energy
