"""Viscoelasticity without a time of its own: relaxation as a power of the time, over three decades.

Maxwell branches (see ``_branch``) of moduli g_p G w_k, one at each of τ_k = τ_p 10^(k/2), k = 0 … 6, with
w_k ∝ (τ_k/τ_p)^(−α), Σ w_k = 1: between τ_p and 1000 τ_p what is left of the extra stress falls as t^(−α) to
within its ripple. α near 0: as much at each decade; large: one Maxwell branch at τ_p. After the broad
spectra of soft polymers, Winter & Chambon, J. Rheol. 30 (1986) 367, 10.1122/1.549853.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.bulk import _branch
from cutbench.mechanisms.bulk.maxwell import Maxwell

#: Relaxation times and their distance in decades.
TIMES, APART = 7, 0.5


class PowerLaw(Maxwell):
    """Relaxes as a power of the time."""

    name = "power_law"
    title = "power-law relaxation"
    family = "viscoelasticity"
    resembles = ("G",)
    parameters = (
        Parameter.effect("g_p", "1", "g_p", "modulus of all that relaxes, over G", high=50.0, typical=0.5),
        Parameter(
            "tau_p", "s", "τ_p", "shortest relaxation time of the power law", low=1e-4, high=1e6, default=1.0
        ),
        Parameter("alpha_p", "1", "α", "exponent of the relaxation", low=0.02, high=2.0, default=0.2),
    )

    def groups(self, p):
        return {"g_p": p.g_p, "tau_p v/a": p.tau_p * p.speed / (p.thickness / 2), "alpha_p": p.alpha_p}

    def start(self, n, p):
        return {f"metric_p{k}": _branch.start(n) for k in range(TIMES)}

    def _branches(self, F, p, state, at):
        parts = [10 ** (-APART * k * p.alpha_p) for k in range(TIMES)]
        for k, part in enumerate(parts):
            s = None if at.held else at.dt / (p.tau_p * 10 ** (APART * k))
            name = f"metric_p{k}"
            yield p.g_p * p.G * part / sum(parts), name, _branch.Branch(F, state[name], s)

    def energy(self, F, p, state, at):
        # The state is the new one, whether ``at`` says so or not.
        held = type(at)(**{**vars(at), "held": True})
        return sum(G * branch.energy for G, _, branch in self._branches(F, p, state, held))
