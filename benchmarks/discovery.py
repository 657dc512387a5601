"""``python -m benchmarks.discovery --cases N --seed S [--kinds homogeneous,cut]``: blind discovery.

Campaigns with a hidden effect are made up: other steps (and, for cuts, another mesh) than the fit's,
specimens that differ by a factor, noise that is partly correlated along the curve, strength and shape drawn
at random. The search sees the campaign only; its answer is then held against what was hidden. Of N cases
about a sixth hide nothing and a tenth an effect that no candidate has (a force that swings, a jump half way,
a slow softening). Prints a confusion matrix; ``--json FILE`` keeps everything,
and goes on from there when called again.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cutbench.campaign import Campaign, FitPlan, all_candidates, start_case
from cutbench.case import Case, load_case
from cutbench.discover import Discovery, discover
from cutbench.errors import CutbenchError
from cutbench.experiment import HOMOGENEOUS, Experiment
from cutbench.homogeneous import History, respond
from cutbench.homogeneous.stretching import nominal_stress
from cutbench.repetition import Repetition
from cutbench.run import run_case

#: An effect counts as visible if it changes the curve by this many times the scatter.
VISIBLE = 2.0
SCATTER, NOISE, REPETITIONS, READINGS = 0.03, 0.01, 3, 120
OUTSIDE = ("swing", "jump", "softening with time")


@dataclass(frozen=True)
class Test:
    """``program``: monotone, cycle (there and back) or hold; ``speed`` in mm/s or 1/s; ``reach`` in mm or
    stretch."""

    id: str
    kind: str
    speed: float
    reach: float
    program: str = "monotone"
    pressure: float = 0.0
    role: str = "train"
    sizes: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Hidden:
    """One case: what was done, and what was hidden in it."""

    number: int
    effect: str
    family: str
    design: str
    change: float
    shape_change: float
    values: dict
    campaign: Campaign
    clean: dict


def designs(family: str, many: bool, rng) -> list[Test]:
    """The tests of a campaign: one condition, or several."""
    slow = 10 ** rng.uniform(-3, -2)
    if family == "bulk":
        reach = rng.uniform(1.8, 3.0)
        first = Test("tension", "uniaxial", slow, reach, "cycle" if rng.random() < 0.5 else "monotone")
        if not many:
            return [first]
        if rng.random() < 0.5:
            return [
                first,
                Test("fast", "uniaxial", 30 * slow, reach, first.program),
                Test("hold", "uniaxial", 10 * slow, reach, "hold", role="test"),
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
            else [first]
        )
    pressure = rng.uniform(0.01, 0.05)
    first = Test("slow", "sliding", slow, 10.0, pressure=pressure)
    if not many:
        return [first]
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
        coarse = {"h": "1 mm", "tip": "1.5 mm", "eta_v": "0.2 mm", "tau_W": "2 kPa"}
        return load_case("gelatin", coarse)
    kinds = {"bulk": ("uniaxial",), "cut law": ("separation",), "blade law": ("sliding",)}[family]
    if family == "bulk":
        case, _ = start_case(None, baseline=["neo_hookean", "volumetric"], kinds=kinds,
                             parameters={"G": f"{rng.uniform(0.1, 0.6)} MPa", "nu": 0.49})  # fmt: skip
        return case
    if family == "cut law":
        case, _ = start_case(
            "elastomer", baseline=["neo_hookean", "volumetric", "smith_ferrante"], kinds=kinds
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
    return out, time_s


def clean(case: Case, test: Test) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Abscissa, ordinate, time (n,) as the truth has them."""
    if test.kind == "cut":
        values = {**case.values, **test.sizes, "depth": test.reach, "speed": test.speed}
        result = run_case(Case(case.name, case.dim, case.mechanisms, values, case.numerics))
        c = result.curve
        d, F = case.model.record(c["displacement_mm"], c["force_N"], c["time_s"], result.case.p)
        x = np.linspace(0, d[-1], READINGS + 1)[1:]
        return x, np.interp(x, d, F), np.interp(x, d, c["time_s"])
    x, t = way(test)
    history = History.along(x, t, 1.0 if test.kind in HOMOGENEOUS else 0.0, test.pressure)
    if test.kind in HOMOGENEOUS:
        y = nominal_stress(test.kind, history, case.model, case.p, largest=0.01, fewest=7)[:, 0]
    else:
        y = respond(test.kind, history, case.model, case.p)
    return x, y, t


def outside(effect: str, x, y, t, rest, rng) -> np.ndarray:
    """``y`` with an effect that no mechanism has."""
    way_ = np.append(0.0, np.cumsum(np.abs(np.diff(x)))) / max(np.abs(np.diff(x)).sum(), 1e-300)
    if effect == "swing":
        return y * (1 + rng["size"] * np.sin(2 * np.pi * rng["waves"] * way_ + rng["phase"]))
    if effect == "jump":
        return y * np.where(way_ > 0.5, 1 + rng["size"], 1.0)
    return y * (1 - 2 * rng["size"] / (1 + np.exp(-(way_ - 0.6) / 0.06)))


def readings(test: Test, curve, rng) -> Experiment:
    """What a laboratory would have recorded: specimens, noise half white and half correlated."""
    x, y, t = curve
    size = NOISE * np.abs(y).max() / math.sqrt(2)
    s = np.linspace(0, 1, x.size)
    kernel = np.exp(-np.abs(s[:, None] - s) / 0.08)
    root = np.linalg.cholesky(kernel + 1e-9 * np.eye(x.size))
    made = [
        Repetition(x, y * (1 + SCATTER * rng.standard_normal())
                   + size * (rng.standard_normal(x.size) + root @ rng.standard_normal(x.size)), t, f"{i + 1}")
        for i in range(REPETITIONS)
    ]  # fmt: skip
    cut = test.kind == "cut"
    return Experiment(test.id, test.kind, tuple(made), test.role, test.sizes if cut else {},
                      {"thickness": 0.7} if cut else {}, test.speed, test.pressure)  # fmt: skip


def changed(one: dict, other: dict) -> float:
    """Root mean square change of all curves, each relative to its maximum."""
    parts = [((one[k][1] - other[k][1]) ** 2).mean() / np.abs(other[k][1]).max() ** 2 for k in one]
    return float(np.sqrt(np.mean(parts)))


def scaled_out(one: dict, other: dict) -> float:
    """The same, with the best common factor taken out."""
    top = sum((one[k][1] * other[k][1]).mean() / np.abs(other[k][1]).max() ** 2 for k in one)
    low = sum((other[k][1] ** 2).mean() / np.abs(other[k][1]).max() ** 2 for k in one)
    return changed(one, {k: (v[0], v[1] * top / low, v[2]) for k, v in other.items()})


FAMILIES = {
    "bulk": ("gent", "yeoh", "compressible", "maxwell", "maxwell2", "mullins"),
    "cut law": ("compact_cohesion", "rate_toughness"),
    "blade law": ("adhesion_speed", "adhesion_wear", "coulomb_saturating"),
    "cut": ("machine_compliance", "contact_offset", "force_drift", "stiff_skin", "blunt_tip", "gent"),
}


def make(number: int, effect: str, family: str, many: bool, seed: int) -> Hidden:
    """A campaign with a hidden effect whose strength is drawn so that the curves change by 2 to 8
    scatters."""
    rng = np.random.default_rng([seed, number])
    tests = cuts(many, rng) if family == "cut" else designs(family, many, rng)
    if effect == "mullins":
        tests = [Test(**{**vars(t), "program": "cycle"}) if t.kind == "uniaxial" else t for t in tests]
    start = base_case(family, rng)
    true = start
    if family == "cut":
        true = start.set(h=f"{rng.uniform(0.75, 0.9)} mm", step_mm=start.numerics.step_mm * 0.8)
    plain = {t.id: clean(true, t) for t in tests}
    wanted = SCATTER * rng.uniform(VISIBLE, 8)
    values, curves = {}, plain
    if effect in OUTSIDE:
        how = {"size": wanted * (1.6 if effect != "jump" else 1.8), "waves": rng.uniform(2, 5),
               "phase": rng.uniform(0, 6)}  # fmt: skip
        curves = {k: (x, outside(effect, x, y, t, 0, how), t) for k, (x, y, t) in plain.items()}
        values = how
    elif effect != "none":
        curves, values = _with(true, effect, tests, plain, wanted, rng)
    experiments = tuple(readings(t, curves[t.id], rng) for t in tests)
    # The fit starts elsewhere than the truth.
    off = {n: v * rng.uniform(0.8, 1.25) for n, v in start.values.items() if n in ("G", "G_c", "tau_W", "mu")}
    begin = Case("start", start.dim, start.mechanisms, {**start.values, **off}, start.numerics)
    kinds = [t.kind for t in tests]
    plan_ = FitPlan(free=("G", "G_c", "tau_W")) if family == "cut" else FitPlan()
    campaign = Campaign(f"case {number}", begin, experiments, all_candidates(begin.model, kinds), plan_)
    shown = _beside(curves, plain)
    return Hidden(number, effect, family, "several conditions" if many else "one condition",
                  changed(curves, shown), scaled_out(curves, shown), values, campaign, curves)  # fmt: skip


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
        case = Case(true.name, true.dim, model.mechanisms, {**true.values, **new, **values}, true.numerics)
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


def judge(hidden: Hidden, d: Discovery) -> dict:
    """What the search said, beside what was hidden."""
    first = d.rounds[0]
    named = d.found[0] if d.found else (first.tried[0].name if first.tried else None)
    group = list(first.group)
    right = hidden.effect in (d.found[:1] or ()) or (bool(d.found) and hidden.effect in group)
    cut = None
    tests = [e for e in d.campaign.experiments if e.id in d.final.tests]
    if d.found:

        def error(point):
            total = 0.0
            for e in d.campaign.experiments:
                y = point.tests.get(e.id, point.y.get(e.id))
                if y is None or (tests and e.role != "test"):
                    continue
                grid, (x, true, t) = point.inverse.grids[e.id], hidden.clean[e.id]
                along = grid.time_s if not e.monotone else grid.x
                truth = np.interp(along, t if not e.monotone else x, true)
                total += ((y - truth) ** 2).mean() / np.abs(true).max() ** 2
            return total

        cut = 1 - error(d.final) / max(error(d.first), 1e-30)
    return {
        "case": hidden.number, "effect": hidden.effect, "family": hidden.family, "design": hidden.design,
        "change": hidden.change, "shape_change": hidden.shape_change, "values": hidden.values,
        "verdict": d.verdict, "found": list(d.found), "named_first": named, "group": group, "right": right,
        "seconds": d.seconds, "heldout_error_cut": cut,
        "p_residual": first.scores.p_residual,
        "best": [{"name": t.name, "p_any": t.p_any, "share": t.share, "behind": t.behind, "se": t.behind_se,
                  "better": t.heldout.better, "better_se": t.heldout.better_se, "gain": t.heldout.gain}
                 for t in first.tried[:4]],
    }  # fmt: skip


def plan(cases: int, seed: int, kinds: Sequence[str]) -> list[tuple[str, str, bool]]:
    """Effect, family and whether several conditions, of each case."""
    rng = np.random.default_rng(seed)
    nothing, alien = max(1, round(cases * 12 / 80)), max(1, round(cases * 8 / 80))
    pools = {
        "homogeneous": [(e, f) for f in ("bulk", "cut law", "blade law") for e in FAMILIES[f]],
        "cut": [(e, "cut") for e in FAMILIES["cut"]],
    }
    pool = [pair for kind in kinds for pair in pools[kind]]
    families = [f for f in ("bulk", "cut law", "blade law") if "homogeneous" in kinds]
    families += ["cut"] if "cut" in kinds else []
    made = [
        (*pool[i % len(pool)], bool((i // len(pool) + i % len(pool)) % 2))
        for i in range(cases - nothing - alien)
    ]
    made += [("none", families[i % len(families)], bool((i // 2) % 2)) for i in range(nothing)]
    made += [(OUTSIDE[i % 3], families[i % len(families)], bool((i // 2) % 2)) for i in range(alien)]
    return [made[i] for i in rng.permutation(len(made))]


def confusion(rows: Sequence[dict]) -> str:
    truths = sorted({r["effect"] for r in rows})
    said = sorted({_said(r) for r in rows})
    table = Counter((r["effect"], _said(r)) for r in rows)
    width = max(map(len, truths)) + 2
    lines = [" " * width + "  ".join(said)]
    for t in truths:
        lines.append(t.ljust(width) + "  ".join(str(table[t, s] or ".").rjust(len(s)) for s in said))
    return "\n".join(lines)


def _said(r: dict) -> str:
    return r["found"][0] if r["found"] and r["verdict"] == "mechanism" else r["verdict"]


def summary(rows: Sequence[dict]) -> dict:
    hidden = [r for r in rows if r["effect"] not in (*OUTSIDE, "none")]
    seen = [r for r in hidden if r["change"] > VISIBLE * SCATTER]
    shaped = [r for r in hidden if r["shape_change"] > VISIBLE * SCATTER]
    nothing = [r for r in rows if r["effect"] == "none"]
    alien = [r for r in rows if r["effect"] in OUTSIDE]
    right = [r for r in seen if r["right"]]

    def part(some, test) -> str:
        return f"{sum(map(test, some))} of {len(some)}"

    return {
        "true cause first or in the first group, of changes by more than twice the scatter":
            part(seen, lambda r: r["right"]),
        "the same, of those that no common factor can hide": part(shaped, lambda r: r["right"]),
        "another cause named": part(hidden, lambda r: bool(r["found"]) and not r["right"]),
        "a cause named where there is none": part(nothing, lambda r: bool(r["found"])),
        "'none' where there is none": part(nothing, lambda r: r["verdict"] == "none"),
        "'unexplained' for outside effects": part(alien, lambda r: r["verdict"] == "unexplained"),
        "held-out error cut by 80 % or more where the cause was found":
            part(right, lambda r: (r["heldout_error_cut"] or 0) >= 0.8),
        "seconds a case, median and largest": f"{np.median([r['seconds'] for r in rows]):.1f},"
            f" {max(r['seconds'] for r in rows):.1f}",
    }  # fmt: skip


def _asked(args) -> dict:
    return {"cases": args.cases, "seed": args.seed, "kinds": args.kinds}


def _known(args) -> list[dict]:
    """Cases that an earlier call with the same plan has done."""
    if args.json is None or not args.json.exists():
        return []
    data = json.loads(args.json.read_text())
    return data["rows"] if {k: data[k] for k in _asked(args)} == _asked(args) else []


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.discovery", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default="homogeneous")
    parser.add_argument("--only", help="one effect")
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds after which no case begins")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    rows, began = _known(args), time.perf_counter()
    for number, (effect, family, many) in enumerate(plan(args.cases, args.seed, args.kinds.split(","))):
        if (args.only and effect != args.only) or number in [r["case"] for r in rows]:
            continue
        if time.perf_counter() - began > args.limit:
            break
        hidden = make(number, effect, family, many, args.seed)
        try:
            rows.append(judge(hidden, discover(hidden.campaign, workers=0)))
        except CutbenchError as error:
            print(f"{number} {effect}: {error}", flush=True)
            continue
        r = rows[-1]
        print(
            f"{number:3d} {effect:20s} {family:9s} {hidden.design:18s} change {hidden.change:.2f}"
            f" ({hidden.shape_change:.2f})  {r['verdict']:11s} {','.join(r['found']):22s} group {r['group']}"
            f" {'right' if r['right'] else ''} cut {r['heldout_error_cut']} {r['seconds']:.0f} s",
            flush=True,
        )
        if args.json:
            args.json.write_text(json.dumps({**_asked(args), "rows": rows}, default=float, indent=1))
    print(confusion(rows))
    figures = summary(rows)
    for key, value in figures.items():
        print(f"{key}: {value}")
    if args.json:
        text = json.dumps({**_asked(args), "summary": figures, "rows": rows}, default=float, indent=1)
        args.json.write_text(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
