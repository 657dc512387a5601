"""Viscoelasticity: a Maxwell branch of modulus g₁ G and relaxation time τ₁ beside the elastic law.

Finite strain, isochoric, objective, dissipation ≥ 0 (see ``_branch``); Reese & Govindjee, Int. J.
Solids Struct. 35 (1998) 3455, 10.1016/S0020-7683(97)00217-5. G is the modulus of slow loading.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Bulk
from cutbench.mechanisms.bulk import _branch


def branch_parameters(number: str, time: float, ratio: float) -> tuple[Parameter, ...]:
    """Modulus over G and relaxation time of a branch; it is off where its modulus is 0."""
    sub = "₀₁₂₃"[int(number)]
    return (
        Parameter.effect(
            f"g_{number}", "1", f"g{sub}", "modulus of the Maxwell branch over G", high=50.0, typical=ratio
        ),
        Parameter(
            f"tau_{number}", "s", f"τ{sub}", "relaxation time of the branch", low=1e-4, high=1e6, default=time
        ),
    )


class Maxwell(Bulk):
    """Stress of branches that relax; the ledger's entry is what they store and dissipate."""

    name = "maxwell"
    title = "viscoelasticity"
    family = "viscoelasticity"
    resembles = ("G",)
    role = "viscoelastic"
    conservative = False
    reads = ("G", "speed", "thickness")
    parameters = branch_parameters("1", 20.0, 0.5)

    def groups(self, p):
        rate = p.speed / (p.thickness / 2)
        return {
            text: value
            for g, tau in self._pairs()
            for text, value in ((g, getattr(p, g)), (f"{tau} v/a", getattr(p, tau) * rate))
        }

    def _pairs(self):
        names = [q.name for q in self.parameters]
        return list(zip(names[::2], names[1::2], strict=True))

    def start(self, n, p):
        return {f"metric_{g}": _branch.start(n) for g, _ in self._pairs()}

    def _branches(self, F, p, state, at):
        """Modulus, name of the state and branch, of each."""
        for g, tau in self._pairs():
            s = None if at.held else at.dt / getattr(p, tau)
            yield getattr(p, g) * p.G, f"metric_{g}", _branch.Branch(F, state[f"metric_{g}"], s)

    def stress(self, F, p, state, at):
        P, new = 0.0, {}
        for G, name, branch in self._branches(F, p, state, at):
            P = P + G * branch.stress
            new[name] = branch.metric
        return P, new

    def energy(self, F, p, state, at):
        return sum(
            getattr(p, g) * p.G * _branch.Branch(F, state[f"metric_{g}"], None).energy
            for g, _ in self._pairs()
        )

    def tangent(self, F, p, state, at, dim):
        return sum(G * branch.tangent(dim) for G, _, branch in self._branches(F, p, state, at))
