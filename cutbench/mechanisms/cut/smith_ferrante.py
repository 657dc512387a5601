"""Smith–Ferrante cohesive law with irreversible damage (paper, eq. traction_separation).

T = G_c/δ_c² (1 − d) [⟦u⟧_n + β² ⟦u⟧_t],  d = max(1 − exp(−δ/δ_c)),  δ² = ⟨⟦u⟧_n⟩² + β² ⟦u⟧_t².

β² stands in both places (Ortiz & Pandolfi 1999, 10.1002/(SICI)1097-0207(19990330)44:9<1267), where
the paper has γ_t in one and γ_t² in the other; only then is T a gradient. Closing is resisted with
the undamaged stiffness: the two faces touch, whatever broke before.
"""

from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Cut, Estimate, Group

#: Points (5, 1) and weights (5,) on (0, 1) for means over a step.
_x, _w = np.polynomial.legendre.leggauss(5)
POINTS, WEIGHTS = (1 + _x[:, None]) / 2, _w / 2


def squared_opening(jump: np.ndarray, p) -> np.ndarray:
    """δ² (N,) in mm²: the normal part counts only where the faces part."""
    n2 = np.where(jump[0].real > 0, jump[0], 0) ** 2
    return n2 + p.beta**2 * (jump[1] ** 2 + jump[2] ** 2)


class SmithFerrante(Cut):
    """Exponential traction–separation law, peak σ_c = G_c/(e δ_c) at δ_c."""

    name = "smith_ferrante"
    title = "cohesive"
    family = "traction–separation"
    meant = {  # noqa: RUF012
        "toughness": "G_c, the work of separation, such as G_c = '5 J/m^2'",
        "fracture_energy": "G_c, the work of separation, such as G_c = '5 J/m^2'",
        "Gamma": "G_c, the work of separation, such as G_c = '5 J/m^2'",
    }
    role = "cohesive"
    alternatives = ("stiff_cohesion",)
    rank = -10  # before the laws that scale its traction, or fade with its damage
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.positive("G_c", "J/m^2", "G_c", "work of separation", typical=10.0, lever="toughness"),
        Parameter.positive("delta_c", "mm", "δ_c", "opening at peak traction", typical=0.07),
        Parameter("beta", "1", "β", "weight of sliding against opening", low=0, default=1.0, sought=False),
    )
    reads = ("G", "thickness")
    published = True
    settable = (
        Group(
            "opening", "delta_c/a", r"$\delta_\mathrm{c}/a$", "delta_c", ("thickness",),
            lambda p: p.delta_c / (p.thickness / 2), lambda p, x: x * p.thickness / 2,
        ),
        Group(
            "cohesion", "(G_c/delta_c)/G", r"$(G_\mathrm{c}/\delta_\mathrm{c})/G$", "G_c", ("G", "delta_c"),
            lambda p: p.G_c / p.delta_c / p.G, lambda p, x: x * p.G * p.delta_c,
        ),
    )  # fmt: skip

    def groups(self, p):
        return {
            "(G_c/delta_c)/G": p.G_c / p.delta_c / p.G,
            "G_c/(G a)": p.G_c / (p.G * p.thickness / 2),
            "delta_c/a": p.delta_c / (p.thickness / 2),
        }

    def estimate(self, p, rate, width):
        peak = self.stiffness(p) * p.delta_c * self.keep(np.ones(1), p)[0]
        return Estimate(strength=peak, opening=p.delta_c, work=p.G_c)

    def keep(self, s, p):
        """Stiffness left (N,), over the first, where the largest opening so far is s in units of δ_c."""
        return np.exp(-s)

    def whole(self, s, p):
        """1 − d (N,)."""
        return self.keep(s, p)

    def mean_whole(self, start, end, p):
        """Mean of 1 − d (N,) while the opening grows from ``start`` to ``end``, in units of δ_c."""
        kind = type(self)
        if (kind.whole, kind.keep) != (SmithFerrante.whole, SmithFerrante.keep):
            return WEIGHTS @ self.whole(start + POINTS * (end - start), p)
        # The law's own, of which the integral is known: it takes a third of the time.
        grown, first = end - start, self.whole(start, p)
        small = np.real(grown) < 0.01
        by = np.where(small, 1.0, grown)
        series = 1 - grown / 2 * (1 - grown / 3 * (1 - grown / 4 * (1 - grown / 5)))
        return np.where(small, first * series, (first - self.whole(end, p)) / by)

    def spent(self, s, keep, p):
        """Work of opening up to s, over G_c."""
        # expm1 and the small-s form keep the first steps free of cancellation.
        return -np.expm1(-s) - s * keep

    def stiffness(self, p):
        """Of the undamaged interface, MPa/mm; ∫ T dδ is G_c."""
        return p.G_c / p.delta_c**2

    def hardening(self, p, at):
        """By which the stiffness grows with the overlap of closed faces, MPa/mm²."""
        return at.closing * p.G / p.delta_c**2

    def start(self, n, p):
        return {"delta_max": np.zeros(n), "damage": np.zeros(n), "mean_damage": np.zeros(n)}

    def traction(self, jump, p, state, at):
        square = squared_opening(jump, p)
        # sqrt has no derivative at 0, where nothing grows anyway.
        grows = (square.real > state["delta_max"].real ** 2) & (not at.held)
        delta_max = np.where(grows, np.sqrt(np.where(grows, square, 1.0)), state["delta_max"])
        keep = self.keep(delta_max / p.delta_c, p)
        K = self.stiffness(p)
        # Closing: undamaged, and stiffening smoothly, so that the faces touch instead of sinking in.
        closed = jump[0] * (K - self.hardening(p, at) * jump[0])
        opening = np.where(jump[0].real > 0, K * keep * jump[0], closed)
        T = np.stack([opening, *(K * keep * p.beta**2 * jump[1:])])
        mean = self.mean_whole(state["delta_max"] / p.delta_c, delta_max / p.delta_c, p)
        damage = 1 - self.whole(delta_max / p.delta_c, p)
        return T, {"delta_max": delta_max, "damage": damage, "mean_damage": 1 - mean}

    def work(self, jump, p, state, at):
        """Stored and dissipated together: a function of the opening and its maximum."""
        s = state["delta_max"] / p.delta_c
        keep = self.keep(s, p)
        K = self.stiffness(p)
        unloaded = K / 2 * keep * (state["delta_max"] ** 2 - squared_opening(jump, p))
        shut = np.where(jump[0].real < 0, jump[0], 0)
        closing = shut**2 * (K / 2 - self.hardening(p, at) * shut / 3)
        return p.G_c * self.spent(s, keep, p) - unloaded + closing
