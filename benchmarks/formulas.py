"""Specimens by formulas that the package has not, for ``benchmarks.blind``.

Nothing here imports the package. A ``Body`` is one material on one machine, in closed form or integrated by
scipy. Its laws are eight chains (Arruda and Boyce 1993, five terms), Fung (1967) and Kilian's van der Waals
(1981) for stiffening; a Zener body at finite strain and a stretched exponential (Kohlrausch 1854) for
relaxation; Zúñiga and Beatty (2002) and Elías-Zúñiga (2005) for softening; Blatz and Ko (1962) for a change
of volume. A ``FibredBody`` has fibres by Qiu and Pence (1997), Humphrey and Yin (1987) or spread in the plane
as Lanir (1983) has them, and is sheared as it is pulled until its energy is least. Machines give way, gauges
are longer than stated, records begin late or drift.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, minimize

LENGTH, AREA = 40.0, 25.0  # mm, mm²
#: What no candidate has: a force that swings, one that jumps half way, one that softens with the way gone.
ALIEN = ("swing", "jump", "fade")
#: Fibres of a ``FibredBody``.
FIBRED = ("Qiu-Pence", "Humphrey-Yin", "Lanir")
#: Points of a ramp.
POINTS = 120


def alien(effect: str, way: np.ndarray, how: dict[str, float]) -> np.ndarray:
    """Factors (m,) of the force along ``way`` (m,), the part of the whole way that has been gone."""
    if effect == "swing":
        return 1 + how["size"] * np.sin(2 * np.pi * how["waves"] * way + how["phase"])
    if effect == "jump":
        return np.where(way > 0.5, 1 + how["size"], 1.0)
    return 1 - 2 * how["size"] / (1 + np.exp(-(way - 0.6) / 0.06))


def ramp(rate: float, top: float, back: bool = False, hold: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) in s and stretches (m,) of a ramp to ``top`` at ``rate`` (1/s), and ``back`` again or held
    for ``hold`` seconds."""
    up = np.linspace(1, top, POINTS + 1)[1:]
    t = np.abs(up - 1) / rate
    if back:
        # Not quite to where the bar would be slack.
        down = np.linspace(top, 1 + 0.25 * (top - 1), POINTS)[1:]
        return np.r_[t, t[-1] + np.abs(top - down) / rate], np.r_[up, down]
    if hold:
        after = np.geomspace(0.02 * hold, hold, 60)
        return np.r_[t, t[-1] + after], np.r_[up, np.full(60, top)]
    return t, up


class Body:
    """One material on one machine: nominal stress over time. Modes: ``uniaxial``, ``press`` (the same, but
    shorter) and ``pure_shear``, whose second side keeps its length."""

    def __init__(self, effects: tuple[str, ...], rng: np.random.Generator):
        self.effects = effects
        self.G = float(np.exp(rng.uniform(np.log(0.01), np.log(0.5))))  # MPa
        self.locking = rng.uniform(8, 30)  # chains' segments; van der Waals' largest stretch squared
        self.b = rng.uniform(0.04, 0.3)
        self.part, self.tau = rng.uniform(0.2, 0.6), float(np.exp(rng.uniform(np.log(2), np.log(20))))
        self.spread = rng.uniform(0.45, 0.8)
        self.softer = rng.uniform(0.3, 0.9)
        self.nu = rng.uniform(0.40, 0.46)
        bar_N_mm = 3 * self.G * AREA / LENGTH  # of the specimen itself at first
        self.give_mm_N = rng.uniform(0.08, 0.35) / bar_N_mm if "compliance" in effects else 0.0
        self.zero_N = rng.uniform(0.04, 0.12) * AREA * self.G if "zero" in effects else 0.0
        self.stated_nu = rng.uniform(0.3, 0.45) if "stated nu" in effects else 0.4999
        self.longer = rng.uniform(0.08, 0.2) if "gauge" in effects else 0.0
        self.slack_mm = rng.uniform(0.5, 3.0) if "slack" in effects else 0.0
        self.drift_N_s = rng.uniform(0.1, 0.4) * AREA * self.G / 400 if "drift" in effects else 0.0

    def sign(self, mode: str) -> int:
        return -1 if mode == "press" else 1

    def force(self, mode: str, t: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """Nominal stress (m,), MPa."""
        P = self._equilibrium(mode, stretch)
        if "stretched exponential" in self.effects:
            P = self._convolved(t, P)
        if "Zener" in self.effects:
            P = (1 - self.part) * P + self._zener(mode, t, stretch)
        return P * self._softened(mode, stretch)

    def recorded(
        self, mode: str, t: np.ndarray, stretch: np.ndarray, P: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (m,) in mm and force (m,) in N that a machine writes down where the specimen has the
        ``stretch`` and the nominal stress ``P``."""
        sign, F = self.sign(mode), P * AREA
        u = LENGTH * (1 + self.longer) * (stretch - 1) + F * self.give_mm_N + sign * self.slack_mm
        return u, F + sign * (self.zero_N + self.drift_N_s * t)

    def stated(self, mode: str, x: np.ndarray) -> np.ndarray:
        """Nominal stress (m,) that a person who knows of no effect expects at a stretch ``x``, for G = 1."""
        if "stated nu" in self.effects:
            return self._compressible(mode, x, self.stated_nu)
        return x - x ** -_power(mode)

    def _equilibrium(self, mode: str, x: np.ndarray) -> np.ndarray:
        I1, G = _square(mode, x, 1), self.G
        neo = x - x ** -_power(mode)
        if "eight chains" in self.effects:
            n = self.locking
            c = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
            series = sum(2 * (i + 1) * a * I1**i / n**i for i, a in enumerate(c))
            return G * neo * series / sum(2 * (i + 1) * a * 3**i / n**i for i, a in enumerate(c))
        if "Fung" in self.effects:
            return G * neo * np.exp(self.b * (I1 - 3))
        if "van der Waals" in self.effects:
            eta = np.sqrt((I1 - 3) / (1.5 * self.locking))
            return G * neo * (1 / (1 - eta) - 0.25 * np.sqrt((I1 - 3) / 2))
        if "volume" in self.effects:
            return G * self._compressible(mode, x, self.nu)
        return G * neo

    def _compressible(self, mode: str, x: np.ndarray, nu: float) -> np.ndarray:
        """Blatz and Ko's rubber (1962), f = 1, whose free sides are free, for G = 1."""
        power, free = 2 * nu / (1 - 2 * nu), 4 - _power(mode)  # so many sides carry nothing

        def one(x: float) -> float:
            y = brentq(lambda y: y - (x * y**free) ** (-power) / y, 0.2, 3.0)
            return x - (x * y**free) ** (-power) / x

        return np.array([one(each) for each in x])

    def _convolved(self, t: np.ndarray, P: np.ndarray) -> np.ndarray:
        """∫ g(t − s) dP(s), g = 1 − part (1 − exp(−(t/τ)^spread)), a sum over the steps of P."""
        steps = np.diff(np.r_[0.0, P])
        middle = np.r_[t[0] / 2, (t[1:] + t[:-1]) / 2]
        lag = np.maximum(t[:, None] - middle[None, :], 0.0)
        kernel = 1 - self.part * (1 - np.exp(-((lag / self.tau) ** self.spread)))
        return (np.tril(kernel) * steps[None, :]).sum(axis=1)

    def _zener(self, mode: str, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        """A neo-Hookean spring in series with a Newtonian dashpot, at constant volume; nominal stress."""
        times, ways = np.r_[0.0, t], np.r_[1.0, x]

        def springs(one: np.ndarray, flowed: np.ndarray) -> np.ndarray:
            """Squares (3, m) of what the spring is stretched by along each side."""
            second = one ** (0.0 if mode == "pure_shear" else -0.5)
            all_flowed = np.stack([*flowed, -flowed.sum(axis=0)])
            return np.stack([one, second, 1 / (one * second)]) ** 2 / np.exp(2 * all_flowed)

        def rate(s: float, flowed: np.ndarray) -> np.ndarray:
            B = springs(np.interp(s, times, ways), flowed)
            return (B - B.mean(axis=0))[:2] / (2 * self.tau)

        found = solve_ivp(
            rate, (0.0, times[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=t[-1] / 200
        )
        B = springs(x, found.y)
        return self.part * self.G * (B[0] - B[2]) / x

    def _softened(self, mode: str, x: np.ndarray) -> np.ndarray:
        m = np.sqrt(_square(mode, x, 2) / 3)  # magnitude of B over that of 1
        most = np.maximum.accumulate(m)
        if "Zuniga-Beatty" in self.effects:
            return np.exp(-self.softer * np.sqrt(most - m))
        if "Elias-Zuniga" in self.effects:
            return np.exp(-self.softer * np.sqrt((most - m) * m / most))
        return np.ones_like(x)


class FibredBody(Body):
    """A sheet of one material, of which specimens are cut out at an ``angle`` (rad) and pulled."""

    def __init__(self, effects: tuple[str, ...], rng: np.random.Generator):
        super().__init__(effects, rng)
        self.stiff = float(np.exp(rng.uniform(np.log(0.15), np.log(1.5))))  # over G
        self.steep = rng.uniform(0.5, 4)
        self.spread_rad = rng.uniform(0.15, 0.5)
        #: Where they lie: whoever cut specimens took them to lie at 0.
        self.lie = np.radians(rng.uniform(-15, 15))
        self.angle = 0.0

    def _equilibrium(self, mode: str, x: np.ndarray) -> np.ndarray:
        if self.effects[:1] not in [(each,) for each in FIBRED]:
            return super()._equilibrium(mode, x)
        to, free, P = np.linspace(1, x[np.argmax(np.abs(x - 1))], 33), np.array([0.0, 1.0]), []
        for one in to:
            if mode == "uniaxial":
                free = minimize(lambda free, one=one: self._stored(one, *free) / self.G, free, tol=1e-10).x
            P.append((self._stored(one + 1e-5, *free) - self._stored(one - 1e-5, *free)) / 2e-5)
        return CubicSpline(to, P)(x)

    def _stored(self, x: float, s: float, m: float) -> float:
        """Of F = [[x, s, 0], [0, m, 0], [0, 0, 1/(x m)]]."""

        def stretch(angle):
            """Squared, along ``angle`` in the body."""
            a, b = np.cos(angle - self.angle), np.sin(angle - self.angle)
            return (x * a + s * b) ** 2 + (m * b) ** 2

        I4, k = stretch(self.lie), self.stiff * self.G
        fibres = {
            "Qiu-Pence": lambda: k * (I4 - 1) ** 2 / 2,
            "Humphrey-Yin": lambda: k * (np.exp(self.steep * max(I4**0.5 - 1, 0) ** 2) - 1),
            "Lanir": lambda: 2 * k * self._spread(stretch),
        }[self.effects[0]]()
        return self.G / 2 * (x**2 + s**2 + m**2 + (x * m) ** -2 - 3) + fibres

    def _spread(self, stretch) -> float:
        """Straight fibres in all directions of the plane, most about where they lie: each resists its
        stretch, and no compression."""
        off = np.linspace(-np.pi / 2, np.pi / 2, 60, endpoint=False)
        weight = np.exp((np.cos(2 * off) - 1) / (4 * self.spread_rad**2))
        pulled = np.maximum(np.sqrt(stretch(self.lie + off)) - 1, 0) ** 2
        return float(weight @ pulled / weight.sum())


def _power(mode: str) -> int:
    """k of a neo-Hookean body's nominal stress G (x − x⁻ᵏ)."""
    return 3 if mode == "pure_shear" else 2


def _square(mode: str, x: np.ndarray, n: int) -> np.ndarray:
    """Trace of the n-th power of B at constant volume."""
    return x ** (2 * n) + (1 + x ** (-2 * n) if mode == "pure_shear" else 2 * x**-n)
