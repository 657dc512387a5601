"""Campaigns with known causes by formulas that the package has not; for ``benchmarks.discovery --outside``.

Nothing here imports the package: bars of other laws than its candidates', in closed form or integrated by
scipy, are pulled slowly, fast, to and fro and held, on machines that give way, with gauges that are misread.
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
}
EFFECTS = (
    "eight chains", "Fung", "van der Waals", "Zener", "stretched exponential", "Zuniga-Beatty",
    "Elias-Zuniga",
)  # fmt: skip
WRONG = ("compliance", "zero", "volume")
DOUBLE = (
    ("eight chains", "Zener"), ("Fung", "stretched exponential"), ("Zener", "Zuniga-Beatty"),
    ("van der Waals", "Elias-Zuniga"), ("compliance", "Zener"),
)  # fmt: skip
#: Effects change the fitted curves by so many times the noise, in the root mean square.
SHOWN = (2.0, 100.0)
#: Points of a ramp.
_POINTS = 120


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

    @property
    def classes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(CLASSES[e] for e in self.effects))


def plan(cases: int, seed: int) -> list[tuple[str, ...]]:
    """Half of them with one effect, a sixth each with none, with a rig or a value that is wrong, with two."""
    rng = np.random.default_rng(seed)
    sixth = round(cases / 6)
    made: list[tuple[str, ...]] = [(EFFECTS[k % len(EFFECTS)],) for k in range(cases - 3 * sixth)]
    made += [()] * sixth
    made += [(WRONG[k % len(WRONG)],) for k in range(sixth)]
    made += [DOUBLE[k % len(DOUBLE)] for k in range(sixth)]
    return [made[k] for k in rng.permutation(len(made))]


def make(number: int, effects: tuple[str, ...], seed: int, folder: Path) -> Truth:
    """Write one campaign into ``folder``."""
    rng = np.random.default_rng([seed, number])
    repetitions = int(rng.choice([1, 3, 5]))
    scatter, noise = float(rng.uniform(0.01, 0.1)), float(rng.choice([0.003, 0.01]))
    folder.mkdir(parents=True, exist_ok=True)
    far, length, area = rng.uniform(1.7, 2.6), 40.0, 25.0
    most = 1 + 0.8 * (far - 1)
    for _ in range(50):
        body = _Body(effects, rng)
        lost = body.misfit(_way(0.005, far, True, 0.0), _way(0.2, most, True, 0.0)) / noise
        if not effects or SHOWN[0] < lost < SHOWN[1]:
            break
    tests = [
        ("slow", 0.005, far, True, 0.0, "train"),
        ("fast", 0.2, most, True, 0.0, "train"),
        ("middle", 0.03, 1 + 0.9 * (far - 1), False, 0.0, "test"),
        ("hold", 0.3, 1 + 0.7 * (far - 1), False, 60.0, "test"),
    ]
    text = ['title = "one bar, pulled"', 'material = "elastomer"', 'baseline = ["neo_hookean", "volumetric"]']
    text += ["[parameters]", f'G = "{1e3 * body.G * rng.uniform(0.7, 1.4):.3g} kPa"', "nu = 0.4999"]
    clean = {}
    for name, rate, top, back, hold, role in tests:
        t, stretch = _way(rate, top, back, hold)
        force, way = body.force(t, stretch) * area, length * (stretch - 1)
        clean[name] = t, force + body.zero_N
        rows = []
        for r in range(repetitions):
            own = force * (1 + scatter * rng.standard_normal())
            u = way + own * body.give_mm_N
            F = own + body.zero_N + noise * np.abs(force).max() * rng.standard_normal(t.size)
            rows += [f"{r},{a:.7g},{b:.7g},{c:.7g}" for a, b, c in zip(t, u, F, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["rep,t [s],u [mm],F [N]", *rows]) + "\n")
        text += [
            "", "[[experiment]]", f'id = "{name}"', 'kind = "uniaxial"', f'data = "{name}.csv"',
            'columns = { time = "t", displacement = "u", force = "F", repetition = "rep" }',
            f'specimen = {{ length = "{length:g} mm", area = "{area:g} mm^2" }}', f'role = "{role}"',
        ]  # fmt: skip
    file = folder / "campaign.toml"
    file.write_text("\n".join(text) + "\n")
    return Truth(number, effects, file, clean, repetitions, scatter, noise, lost)


def _way(rate: float, top: float, back: bool, hold: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) and stretches (m,) of a ramp, back again, or held."""
    up = np.linspace(1, top, _POINTS + 1)[1:]
    t = (up - 1) / rate
    if back:
        # Not quite to where the bar would be slack.
        down = np.linspace(top, 1 + 0.25 * (top - 1), _POINTS)[1:]
        return np.r_[t, t[-1] + (top - down) / rate], np.r_[up, down]
    if hold:
        after = np.geomspace(0.02 * hold, hold, 60)
        return np.r_[t, t[-1] + after], np.r_[up, np.full(60, top)]
    return t, up


class _Body:
    """One material on one machine: nominal stress over time of a bar that is pulled."""

    def __init__(self, effects: tuple[str, ...], rng: np.random.Generator):
        self.effects = effects
        self.G = float(np.exp(rng.uniform(np.log(0.01), np.log(0.5))))  # MPa
        self.locking = rng.uniform(8, 30)  # chains' segments; van der Waals' largest stretch squared
        self.b = rng.uniform(0.04, 0.3)
        self.part, self.tau = rng.uniform(0.2, 0.6), float(np.exp(rng.uniform(np.log(2), np.log(20))))
        self.spread = rng.uniform(0.45, 0.8)
        self.softer = rng.uniform(0.3, 0.9)
        self.nu = rng.uniform(0.40, 0.46)
        stiff_N_mm = 25 * 3 * self.G / 40  # of the bar itself at first
        self.give_mm_N = rng.uniform(0.08, 0.35) / stiff_N_mm if "compliance" in effects else 0.0
        self.zero_N = rng.uniform(0.04, 0.12) * 25 * self.G if "zero" in effects else 0.0

    def force(self, t: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """Nominal stress (m,), MPa."""
        P = self._equilibrium(stretch)
        if "stretched exponential" in self.effects:
            P = self._convolved(t, P)
        if "Zener" in self.effects:
            P = (1 - self.part) * P + self._zener(t, stretch)
        return P * self._softened(stretch)

    def misfit(self, *ways: tuple[np.ndarray, np.ndarray]) -> float:
        """What the best neo-Hookean bar misses of all ``ways`` together, over the largest force."""
        seen = [(np.maximum(x, 1.0), self.force(t, x) + self.zero_N / 25) for t, x in ways]
        # With what the machine gives, the stretch that is recorded is larger.
        seen = [(x + 25 * P * self.give_mm_N / 40, P) for x, P in seen]
        neo, P = (np.concatenate(parts) for parts in zip(*((x - x**-2, P) for x, P in seen), strict=True))
        left = P - neo * (neo @ P) / (neo @ neo)
        return float(np.sqrt((left**2).mean()) / np.abs(P).max())

    def _equilibrium(self, x: np.ndarray) -> np.ndarray:
        I1, G = x**2 + 2 / x, self.G
        neo = x - x**-2
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
            return np.array([self._compressible(one) for one in x])
        return G * neo

    def _compressible(self, x: float) -> float:
        """Blatz and Ko's rubber (1962), f = 1, whose sides are free."""
        power = 2 * self.nu / (1 - 2 * self.nu)

        def side(y: float) -> float:
            return y - (x * y * y) ** (-power) / y

        y = brentq(side, 0.3, 1.5)
        return self.G * (x - (x * y * y) ** (-power) / x)

    def _convolved(self, t: np.ndarray, P: np.ndarray) -> np.ndarray:
        """∫ g(t − s) dP(s), g = 1 − part (1 − exp(−(t/τ)^spread)), a sum over the steps of P."""
        steps = np.diff(np.r_[0.0, P])
        middle = np.r_[t[0] / 2, (t[1:] + t[:-1]) / 2]
        lag = np.maximum(t[:, None] - middle[None, :], 0.0)
        kernel = 1 - self.part * (1 - np.exp(-((lag / self.tau) ** self.spread)))
        return (np.tril(kernel) * steps[None, :]).sum(axis=1)

    def _zener(self, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        """A neo-Hookean spring in series with a Newtonian dashpot, at constant volume; nominal stress."""
        G1 = self.part * self.G
        times, ways = np.r_[0.0, t], np.r_[1.0, x]

        def rate(s: float, v: np.ndarray) -> np.ndarray:
            elastic = np.interp(s, times, ways) / v
            return v * (elastic**2 - 1 / elastic) / (3 * self.tau)

        found = solve_ivp(
            rate, (0.0, times[-1]), [1.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=t[-1] / 200
        )
        elastic = x / found.y[0]
        return G1 * (elastic**2 - 1 / elastic) / x

    def _softened(self, x: np.ndarray) -> np.ndarray:
        m = np.sqrt((x**4 + 2 / x**2) / 3)  # magnitude of B over that of 1
        most = np.maximum.accumulate(m)
        if "Zuniga-Beatty" in self.effects:
            return np.exp(-self.softer * np.sqrt(most - m))
        if "Elias-Zuniga" in self.effects:
            return np.exp(-self.softer * np.sqrt((most - m) * m / most))
        return np.ones_like(x)
