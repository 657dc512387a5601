"""Campaigns with known causes by formulas that the package has not; for ``benchmarks.discovery --outside``.

Nothing here imports the package: specimens of other laws than its candidates', in closed form or
integrated by scipy, are pulled slowly, fast, to and fro and held, on machines that give way, with gauges that
are misread.
``wider``: they are also compressed and sheared, in one kind of test or in two, and more can be wrong.
Laws: eight chains (Arruda, Boyce 1993, five terms), Fung (1967), Kilian's van der Waals (1981) for
stiffening; a Zener body at finite strain and a stretched exponential (Kohlrausch 1854) for relaxation;
Zúñiga and Beatty (2002) and Elías-Zúñiga (2005) for softening; compression that changes the volume.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

#: What each effect is an instance of; the answer is right if it names one of the class.
CLASSES = {
    "eight chains": "stiffening",
    "Fung": "stiffening",
    "van der Waals": "stiffening",
    "Zener": "viscoelasticity",
    "stretched exponential": "viscoelasticity",
    "Zuniga-Beatty": "softening",
    "Elias-Zuniga": "softening",
    "compliance": "rig",
    "zero": "reading",
    "volume": "volume",
    "stated nu": "volume",
    "gauge": "rig",
    "slack": "reading",
    "drift": "reading",
}
EFFECTS = (
    "eight chains", "Fung", "van der Waals", "Zener", "stretched exponential", "Zuniga-Beatty",
    "Elias-Zuniga",
)  # fmt: skip
WRONG = ("compliance", "zero", "volume")
#: More of them, and the kinds of test that are fitted first and second, of the wider benchmark.
MORE = ("compliance", "zero", "stated nu", "gauge", "slack", "drift")
MODES = (
    ("uniaxial", "uniaxial"), ("pure_shear", "pure_shear"), ("press", "press"), ("uniaxial", "pure_shear"),
)  # fmt: skip
DOUBLE = (
    ("eight chains", "Zener"), ("Fung", "stretched exponential"), ("Zener", "Zuniga-Beatty"),
    ("van der Waals", "Elias-Zuniga"), ("compliance", "Zener"),
)  # fmt: skip
#: Effects change the fitted curves by so many times the noise, in the root mean square.
SHOWN = (2.0, 100.0)
#: Points of a ramp.
_POINTS = 120
LENGTH, AREA = 40.0, 25.0  # mm, mm²


@dataclass(frozen=True)
class Truth:
    """One campaign: its file, what is hidden in it, and the clean force (m,) by test."""

    number: int
    effects: tuple[str, ...]
    file: Path
    clean: dict[str, tuple[np.ndarray, np.ndarray]]
    repetitions: int
    scatter: float
    noise: float
    misfit: float
    modes: tuple[str, str]

    @property
    def classes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(CLASSES[e] for e in self.effects))


def plan(cases: int, seed: int, wider: bool = False) -> list[tuple[str, ...]]:
    """Half of them with one effect, a sixth each with none, with a rig or a value that is wrong, with two."""
    wrong = MORE if wider else WRONG
    rng = np.random.default_rng(seed)
    sixth = round(cases / 6)
    made: list[tuple[str, ...]] = [(EFFECTS[k % len(EFFECTS)],) for k in range(cases - 3 * sixth)]
    made += [()] * sixth
    made += [(wrong[k % len(wrong)],) for k in range(sixth)]
    made += [DOUBLE[k % len(DOUBLE)] for k in range(sixth)]
    return [made[k] for k in rng.permutation(len(made))]


def make(number: int, effects: tuple[str, ...], seed: int, folder: Path, wider: bool = False) -> Truth:
    """Write one campaign into ``folder``."""
    rng = np.random.default_rng([seed, number])
    repetitions = int(rng.choice([1, 3, 5]))
    scatter, noise = float(rng.uniform(0.01, 0.1)), float(rng.choice([0.003, 0.01]))
    folder.mkdir(parents=True, exist_ok=True)
    far = rng.uniform(1.7, 2.6)
    modes = MODES[int(np.random.default_rng([seed, number, 1]).integers(len(MODES)))] if wider else MODES[0]
    if "press" in modes:
        far = 1 / (0.6 + 0.5 * far)  # to between 0.7 and 0.5 of the height
    most = 1 + 0.8 * (far - 1)
    for _ in range(50):
        body = Body(effects, rng)
        ways = _way(0.005, far, True, 0.0), _way(0.2, most, True, 0.0)
        lost = body.misfit(*zip(modes, ways, strict=True)) / noise
        if not effects or SHOWN[0] < lost < SHOWN[1]:
            break
    tests = [
        ("slow", modes[0], 0.005, far, True, 0.0, "train"),
        ("fast", modes[1], 0.2, most, True, 0.0, "train"),
        ("middle", modes[0], 0.03, 1 + 0.9 * (far - 1), False, 0.0, "test"),
        ("hold", modes[1], 0.3, 1 + 0.7 * (far - 1), False, 60.0, "test"),
    ]
    text = ['title = "one specimen"', 'material = "elastomer"', 'baseline = ["neo_hookean", "volumetric"]']
    text += [
        "[parameters]",
        f'G = "{1e3 * body.G * rng.uniform(0.7, 1.4):.3g} kPa"',
        f"nu = {body.stated_nu:.4f}",
    ]
    clean = {}
    for name, mode, rate, top, back, hold, role in tests:
        t, stretch = _way(rate, top, back, hold)
        force, way = body.force(mode, t, stretch) * AREA, LENGTH * (1 + body.longer) * (stretch - 1)
        zero = body.sign(mode) * (body.zero_N + body.drift_N_s * t)
        clean[name] = t, force + zero
        rows = []
        for r in range(repetitions):
            own = force * (1 + scatter * rng.standard_normal())
            u = way + own * body.give_mm_N + body.sign(mode) * body.slack_mm
            F = own + zero + noise * np.abs(force).max() * rng.standard_normal(t.size)
            rows += [f"{r},{a:.7g},{b:.7g},{c:.7g}" for a, b, c in zip(t, u, F, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["rep,t [s],u [mm],F [N]", *rows]) + "\n")
        text += [
            "", "[[experiment]]", f'id = "{name}"', f'kind = "{mode.replace("press", "uniaxial")}"',
            f'data = "{name}.csv"', f'role = "{role}"',
            'columns = { time = "t", displacement = "u", force = "F", repetition = "rep" }',
            f'specimen = {{ length = "{LENGTH:g} mm", area = "{AREA:g} mm^2" }}',
        ]  # fmt: skip
    file = folder / "campaign.toml"
    file.write_text("\n".join(text) + "\n")
    return Truth(number, effects, file, clean, repetitions, scatter, noise, lost, modes)


def _way(rate: float, top: float, back: bool, hold: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) and stretches (m,) of a ramp up or down, back again, or held."""
    up = np.linspace(1, top, _POINTS + 1)[1:]
    t = np.abs(up - 1) / rate
    if back:
        # Not quite to where the bar would be slack.
        down = np.linspace(top, 1 + 0.25 * (top - 1), _POINTS)[1:]
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

    def misfit(self, *ways: tuple[str, tuple[np.ndarray, np.ndarray]]) -> float:
        """What the best neo-Hookean body misses of all ``ways`` together, over the largest force."""
        models, forces = [], []
        for mode, (t, x) in ways:
            P, sign = self.force(mode, t, x), self.sign(mode)
            P += sign * (self.zero_N + self.drift_N_s * t) / AREA
            # What the machine gives, and what is longer, is recorded as stretch.
            u = (1 + self.longer) * (x - 1) + (P * AREA * self.give_mm_N + sign * self.slack_mm) / LENGTH
            models.append(self._stated(mode, 1 + u))
            forces.append(P)
        neo, P = np.concatenate(models), np.concatenate(forces)
        left = P - neo * (neo @ P) / (neo @ neo)
        return float(np.sqrt((left**2).mean()) / np.abs(P).max())

    def _stated(self, mode: str, x: np.ndarray) -> np.ndarray:
        """What a person who knows of no effect expects, for G = 1."""
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


def _power(mode: str) -> int:
    """k of a neo-Hookean body's nominal stress G (x − x⁻ᵏ)."""
    return 3 if mode == "pure_shear" else 2


def _square(mode: str, x: np.ndarray, n: int) -> np.ndarray:
    """Trace of the n-th power of B at constant volume."""
    return x ** (2 * n) + (1 + x ** (-2 * n) if mode == "pure_shear" else 2 * x**-n)
