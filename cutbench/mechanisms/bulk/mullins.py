"""Mullins softening: below its largest energy so far, the isochoric stress is scaled by η ≤ 1,

    η = 1 − ς tanh((W_max − W)/(m G)),

W the energy of the isochoric laws. Ogden & Roxburgh, Proc. R. Soc. Lond. A 455 (1999) 2861,
10.1098/rspa.1999.0431, with tanh in place of erf. The law adds (η − 1) ∂W/∂F to the others. The work
of its stress on any path is ς m G ln cosh((W_max − W)/(m G)), of which only a part comes back.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Bulk


class Mullins(Bulk):
    """Stress softening after the first loading; 1/r of the reference is ς."""

    name = "mullins"
    title = "Mullins softening"
    family = "softening on unloading"
    role = "softening"
    rank = 10
    conservative = False
    reads = ("G",)
    parameters = (
        Parameter.effect(
            "softening", "1", "ς", "largest part of the stress that is lost", high=0.95, typical=0.3
        ),
        Parameter(
            "softening_energy",
            "1",
            "m",
            "energy below the largest one at which the softening is under way, over G",
            low=1e-3,
            high=1e3,
            default=0.1,
        ),
    )

    def groups(self, p):
        return {"softening": p.softening, "softening m": p.softening_energy}

    def start(self, n, p):
        return {"largest_energy": np.zeros(n)}

    # Of z = (W_max − W)/(m G): the part of ς that is lost, its slope, its integral from 0.

    def lost(self, z):
        return np.tanh(z)

    def fades(self, z):
        return 1 - np.tanh(z) ** 2

    def spent(self, z):
        return z + np.log1p(np.exp(-2 * z)) - np.log(2.0)  # ln cosh z, without overflow

    def _sum(self, which, F, p, at, *more):
        """Of the laws whose energy counts: their ``stress``, ``tangent`` or ``energy`` together."""
        parts = (getattr(law, which)(F, p, {}, at, *more) for law in at.laws if law.adds_stiffness)
        return sum(part[0] if which == "stress" else part for part in parts)

    def _below(self, F, p, state, at):
        """(W_max − W)/(m G), W_max, and where W grows beyond it."""
        W = self._sum("energy", F, p, at)
        old = state["largest_energy"]
        grows = (W.real > old.real) & (not at.held)
        largest = np.where(grows, W, old)
        # The state given for this very F differs from W by rounding at the most.
        below = np.where(largest.real > W.real, largest - W, 0 * W)
        return below / (p.softening_energy * p.G), largest, grows

    def stress(self, F, p, state, at):
        z, largest, _ = self._below(F, p, state, at)
        return -p.softening * self.lost(z) * self._sum("stress", F, p, at), {"largest_energy": largest}

    def tangent(self, F, p, state, at, dim):
        z, _, grows = self._below(F, p, state, at)
        P = self._sum("stress", F, p, at)[:dim, :dim]
        # While W grows the largest energy grows with it and nothing is lost.
        slope = np.where(grows, 0.0, p.softening * self.fades(z) / (p.softening_energy * p.G))
        lost = -p.softening * self.lost(z)
        return lost * self._sum("tangent", F, p, at, dim) + slope * P[:, :, None, None] * P[None, None]

    def energy(self, F, p, state, at):
        z, largest, _ = self._below(F, p, state, at)
        scale = p.softening_energy * p.G
        return p.softening * scale * (self.spent(z) - self.spent(largest / scale))

    def work(self, F, p, state, at):
        z = self._below(F, p, state, at)[0]
        return p.softening * p.softening_energy * p.G * self.spent(z)
