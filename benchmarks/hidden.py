"""Campaigns with a hidden effect, as a laboratory would have recorded them, for ``benchmarks.discovery``.

Computed, not measured: other steps (and, for cuts, another mesh) than the fit's, specimens that differ by a
factor, noise that is partly correlated along the curve, strength and shape of the effect drawn at random.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import CutbenchError
from cutbench.calibration.homogeneous import LoadingHistory, respond
from cutbench.calibration.homogeneous.stretching import nominal_stress
from cutbench.case.case import Case, load_case
from cutbench.data.campaign import Campaign, FitPlan, all_candidates, start_case
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.data.repetition import Repetition
from cutbench.discovery.synthetic import Test as Plain
from cutbench.discovery.synthetic import clean as computed

#: An effect counts as visible if it changes the curve by this many times the scatter.
VISIBLE = 2.0
SCATTER, NOISE, REPETITIONS, READINGS = 0.03, 0.01, 3, 120
#: Of a test in steps: the second speed over the first, and the pressures of its parts. Friction and
#: adhesion fit any two pressures, so there are more.
FASTER, PRESSED = 30.0, np.array([1.0, 4.0, 2.0, 0.5])
OUTSIDE = ("swing", "jump", "softening with time")
#: Effects of a speed or a pressure: a single test shows them if it is done at several, in steps. At one speed
#: and one pressure they are another strength, toughness or friction, and nothing is hidden.
STEPPED = ("rate_toughness", "adhesion_speed", "coulomb_saturating")


@dataclass(frozen=True)
class Test(Plain):
    """``program``: monotone, cycle (there and back), hold, or steps (four parts, slow and fast by turns,
    those of a sliding test each at its own pressure)."""

    readings: int = READINGS
    program: str = "monotone"
    pressure: float = 0.0


@dataclass(frozen=True)
class Hidden:
    """One case: what was done, and what was hidden in it; ``without`` has the same specimens and noise, and
    nothing hidden. ``clean``, ``plain``: the curves without specimens and noise, with the effect and
    without."""

    number: int
    effect: str
    family: str
    design: str
    change: float
    values: dict
    campaign: Campaign
    without: Campaign
    clean: dict
    plain: dict


def designs(effect: str, family: str, many: bool, rng) -> list[Test]:
    """The tests of a campaign: one condition, or several."""
    slow = 10 ** rng.uniform(-3, -2)
    alone = "steps" if not many and (rng.random() < 0.5 or effect in STEPPED) else "monotone"
    if family == "bulk":
        reach = rng.uniform(1.8, 3.0)
        first = Test(
            "tension", "uniaxial", slow, reach, program="cycle" if rng.random() < 0.5 else "monotone"
        )
        if not many:
            return [first]
        if rng.random() < 0.5:
            return [
                first,
                Test("fast", "uniaxial", 30 * slow, reach, program=first.program),
                Test("hold", "uniaxial", 10 * slow, reach, program="hold", role="test"),
            ]
        return [
            first,
            Test("shear", "pure_shear", slow, reach),
            Test("biaxial", "equibiaxial", slow, 1 + 0.6 * (reach - 1), role="test"),
        ]
    if family == "cut law":
        first = Test("slow", "separation", slow, 0.5)
        return (
            [
                first,
                Test("fast", "separation", 30 * slow, 0.5),
                Test("other", "separation", 10 ** rng.uniform(-0.5, 2) * slow, 0.5, role="test"),
            ]
            if many
            else [replace(first, program=alone)]
        )
    pressure = rng.uniform(0.01, 0.05)
    first = Test("slow", "sliding", slow, 10.0, pressure=pressure)
    if not many:
        return [replace(first, program=alone)]
    return [
        first,
        Test("fast", "sliding", 30 * slow, 10.0, pressure=pressure),
        Test("pressed", "sliding", slow, 10.0, pressure=4 * pressure),
        Test("pressed less", "sliding", slow, 10.0, pressure=0.3 * pressure),
        Test("other", "sliding", 10 ** rng.uniform(-0.5, 2) * slow, 20.0, pressure=2 * pressure, role="test"),
    ]


def cuts(many: bool, rng) -> list[Test]:
    sizes = {"width": 12.0, "length": 30.0, "height": 10.0}
    first = Test("slow", "cut", 0.021, 3.0, sizes=sizes)
    if not many:
        return [first]
    return [first, Test("fast", "cut", 0.21, 3.0, sizes=sizes), Test("wide", "cut", 0.021, 3.0, role="test",
            sizes={**sizes, "width": 20.0})]  # fmt: skip


def base_case(family: str, rng) -> Case:
    if family == "cut":
        # Viscous and sticky enough for a smooth transition, coarse enough for runs of seconds.
        coarse = {
            "h": "1 mm",
            "corner": 0.25,
            "shallow": 1,
            "step": "0.1 mm",
            "tip": "1.5 mm",
            "eta_v": "0.2 mm",
            "tau_W": "2 kPa",
        }
        coarse |= {"penalty": 1000, "stick": 400, "multiplier": "none", "normal": "material"}
        return load_case("gelatin", coarse)
    kinds = {"bulk": ("uniaxial",), "cut law": ("separation",), "blade law": ("sliding",)}[family]
    if family == "bulk":
        case, _ = start_case(None, baseline=["neo_hookean", "volumetric"], kinds=kinds,
                             parameters={"G": f"{rng.uniform(0.1, 0.6)} MPa", "nu": 0.49})  # fmt: skip
        return case
    if family == "cut law":
        case, _ = start_case(
            "elastomer", baseline=["neo_hookean", "volumetric", "stiff_cohesion"], kinds=kinds
        )
        return case
    laws = ["neo_hookean", "volumetric", "contact", "coulomb", "adhesion"]
    case, _ = start_case("elastomer", baseline=laws,
                         kinds=kinds, parameters={"mu": "0.3", "tau_W": "10 kPa"})  # fmt: skip
    return case


def way(test: Test) -> tuple[np.ndarray, np.ndarray]:
    """Abscissa and time of the readings (n,)."""
    rest = 1.0 if test.kind in HOMOGENEOUS else 0.0
    out = rest + (test.reach - rest) * np.arange(1, READINGS + 1) / READINGS
    time_s = np.abs(out - rest) / test.speed
    if test.program == "cycle":
        out = np.append(out[1::2], out[-3::-2])
        time_s = np.cumsum(np.abs(np.diff(np.append(rest, out)))) / test.speed
    if test.program == "hold":
        half = out[1::2]
        time_s = np.append(time_s[1::2], time_s[-1] * (1 + np.arange(1, READINGS // 2 + 1) / 6))
        out = np.append(half, np.full(READINGS // 2, half[-1]))
    if test.program == "steps":
        rate = test.speed * np.where(_quarter(out.size) % 2 == 0, 1.0, FASTER)
        time_s = np.cumsum(np.diff(out, prepend=rest) / rate)
    return out, time_s


def _quarter(n: int) -> np.ndarray:
    """In which quarter of a test each of its readings (n,) lies, from 0."""
    return 4 * np.arange(n) // n


def pressure(test: Test, n: int) -> np.ndarray:
    """Contact pressure (n,) in MPa."""
    pressed = test.program == "steps" and test.kind == "sliding"
    return test.pressure * (PRESSED[_quarter(n)] if pressed else np.ones(n))


def clean(case: Case, test: Test) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Abscissa, ordinate, time (n,) as the truth has them."""
    if test.kind == "cut":
        return computed(case, test)
    x, t = way(test)
    history = LoadingHistory.along(x, t, 1.0 if test.kind in HOMOGENEOUS else 0.0, pressure(test, x.size))
    if test.kind in HOMOGENEOUS:
        y = nominal_stress(test.kind, history, case.model, case.p, largest=0.01, fewest=7)[:, 0]
    else:
        y = respond(test.kind, history, case.model, case.p)
    return x, y, t


def outside(effect: str, x, y, how) -> np.ndarray:
    """``y`` with an effect that no mechanism has, as strong as ``how`` says."""
    way_ = np.append(0.0, np.cumsum(np.abs(np.diff(x)))) / max(np.abs(np.diff(x)).sum(), 1e-300)
    if effect == "swing":
        return y * (1 + how["size"] * np.sin(2 * np.pi * how["waves"] * way_ + how["phase"]))
    if effect == "jump":
        return y * np.where(way_ > 0.5, 1 + how["size"], 1.0)
    return y * (1 - 2 * how["size"] / (1 + np.exp(-(way_ - 0.6) / 0.06)))


def readings(test: Test, curve, rng) -> Experiment:
    """What a laboratory would have recorded: specimens, noise half white and half correlated."""
    x, y, t = curve
    size = NOISE * np.abs(y).max() / math.sqrt(2)
    s = np.linspace(0, 1, x.size)
    kernel = np.exp(-np.abs(s[:, None] - s) / 0.08)
    root = np.linalg.cholesky(kernel + 1e-9 * np.eye(x.size))
    made = [
        Repetition(x, y * (1 + SCATTER * rng.standard_normal())
                   + size * (rng.standard_normal(x.size) + root @ rng.standard_normal(x.size)), t, f"{i + 1}",
                   pressure(test, x.size) if test.kind == "sliding" else None)
        for i in range(REPETITIONS)
    ]  # fmt: skip
    cut = test.kind == "cut"
    return Experiment(test.id, test.kind, tuple(made), test.role, dict(test.sizes) if cut else {},
                      {"thickness": 0.7} if cut else {}, test.speed, test.pressure)  # fmt: skip


def changed(one: dict, other: dict) -> float:
    """Root mean square change of all curves, each relative to its maximum."""
    parts = [((one[k][1] - other[k][1]) ** 2).mean() / np.abs(other[k][1]).max() ** 2 for k in one]
    return float(np.sqrt(np.mean(parts)))


FAMILIES = {
    "bulk": ("gent", "yeoh", "compressible", "maxwell", "maxwell2", "mullins"),
    "cut law": ("compact_cohesion", "rate_toughness", "viscous_degraded"),
    "blade law": ("adhesion_speed", "adhesion_wear", "coulomb_saturating"),
    "cut": ("machine_compliance", "contact_offset", "force_drift", "stiff_skin", "blunt_tip", "gent"),
}


def make(number: int, effect: str, family: str, many: bool, seed: int) -> Hidden:
    """A campaign with a hidden effect whose strength is drawn so that the curves change by 2 to 8
    scatters."""
    rng = np.random.default_rng([seed, number])
    tests = cuts(many, rng) if family == "cut" else designs(effect, family, many, rng)
    if effect == "mullins":
        tests = [replace(t, program="cycle") if t.kind == "uniaxial" else t for t in tests]
    start = base_case(family, rng)
    true = start
    if family == "cut":
        true = start.set(h=f"{rng.uniform(0.75, 0.9)} mm", step_mm=start.numerics.step_mm * 0.8)
    plain = {t.id: clean(true, t) for t in tests}
    wanted = SCATTER * rng.uniform(VISIBLE, 8)
    values, curves = {}, plain
    if effect in OUTSIDE:
        how = {"size": 1.0, "waves": rng.uniform(2, 5), "phase": rng.uniform(0, 6)}

        def swung() -> dict:
            return {k: (x, outside(effect, x, y, how), t) for k, (x, y, t) in plain.items()}

        how["size"] = wanted / changed(swung(), plain)  # all are linear in it
        curves = swung()
        values = how
    elif effect != "none":
        curves, values = _with(true, effect, tests, plain, wanted, rng)
    same = deepcopy(rng)
    experiments = tuple(readings(t, curves[t.id], rng) for t in tests)
    uneventful = tuple(readings(t, plain[t.id], same) for t in tests)
    # The fit starts elsewhere than the truth.
    off = {n: v * rng.uniform(0.8, 1.25) for n, v in start.values.items() if n in ("G", "G_c", "tau_W", "mu")}
    begin = replace(start, name="start", values={**start.values, **off})
    kinds = [t.kind for t in tests]
    plan_ = FitPlan(free=("G", "G_c", "tau_W")) if family == "cut" else FitPlan()
    campaign = Campaign(f"case {number}", begin, experiments, all_candidates(begin.model, kinds), plan_)
    shown = _beside(curves, plain)
    return Hidden(number, effect, family, "several conditions" if many else "one condition",
                  changed(curves, shown), values, campaign, replace(campaign, experiments=uneventful), curves,
                  plain)  # fmt: skip


def _beside(curves: dict, plain: dict) -> dict:
    """``plain`` at the abscissas of ``curves``: a rig shifts those of cuts."""
    return {
        k: (x, np.interp(x, plain[k][0], plain[k][1]), t) if np.all(np.diff(x) > 0) else plain[k]
        for k, (x, _, t) in curves.items()
    }


def _with(true: Case, effect: str, tests, plain, wanted, rng) -> tuple[dict, dict]:
    """Curves with the effect, as strong as wanted or as its bounds allow."""
    model, new = true.model.extended(effect)
    known = model.parameters()
    total = max(p[2][-1] for p in plain.values())
    shapes = {}
    for name in new:
        q = known[name]
        if q.off is None:
            if q.unit == "s":
                shapes[name] = total * 10 ** rng.uniform(-1.2, 0) * (8 if name.endswith("2") else 1)
            elif q.unit == "mm/s":
                shapes[name] = min(t.speed for t in tests) * 10 ** rng.uniform(-0.7, 0.7)
            else:
                shapes[name] = q.typical * q.factor * 10 ** rng.uniform(-0.3, 0.3)
    sign = rng.choice([-1, 1])

    def at(size: float):
        strong = {}
        for name in new:
            q = known[name]
            if q.off is not None:
                low_, high_ = (v if v is None else v * q.factor for v in (q.low, q.high))
                both = low_ is not None and high_ is not None and low_ == -high_
                value = q.typical * q.factor * size * (sign if both else 1)
                strong[name] = float(np.clip(value, low_, high_))
        values = {**shapes, **strong}
        case = replace(true, mechanisms=model.mechanisms, values={**true.values, **new, **values})
        return {t.id: clean(case, t) for t in tests}, values

    def size_of(curves: dict) -> float:
        return changed(curves, _beside(curves, plain))

    size, low, high, found = 1.0, 0.0, None, None
    for _ in range(12 if tests[0].kind != "cut" else 4):
        try:
            found = at(size)
        except CutbenchError:
            high = size
            size = (low + high) / 2
            continue
        got = size_of(found[0])
        if abs(got / wanted - 1) < 0.1:
            break
        if got < wanted:
            low = size
            size = size * min(max(wanted / max(got, 1e-6), 1.2), 4) if high is None else (low + high) / 2
        else:
            high = size
            size = (low + high) / 2
    return found if found is not None else at(low)
