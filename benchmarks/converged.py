"""``python -m benchmarks.converged [--points 40] [--seed N] [--limit S] --out DIR``: do the defaults hold?

Points drawn at random from all that may be cut: moduli from 1 to 1000 kPa, G_c/E from 0.02 to 2 mm, cohesions
from 1 to 50, ellipses, wedges and wires from 0.2 to 5 mm, friction, adhesion and viscosity. Each is computed
with the defaults, with elements half as large, and with steps half as long and a third of the damage that one
may do. What moves by more than ``TOLERANCE``, work that falls, energy that is left open, and runs that do not
end within ``--limit`` seconds of one core are counted by kind. Points are kept one a file.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType

import numpy as np

from benchmarks.tools import facts, table
from cutbench.base.errors import BadInput
from cutbench.base.files import write_json
from cutbench.case.case import Case, load_case
from cutbench.run.result import TRANSFER
from cutbench.run.runner import run_case

#: What results are taken from; development has others.
SEED, POINTS, LIMIT = 20261129, 40, 240.0
#: Relative changes of onset, peak and steady force, change of the drop, and energy left open, at the most.
TOLERANCE = MappingProxyType(
    {"onset_mm": 0.03, "peak_N": 0.03, "steady_N": 0.03, "drop_rel": 0.03, "closure": 0.01}
)
#: How far the blade goes, in its thicknesses.
DEPTH = 12.0
#: Part of the blade's work by which a mechanism's may fall: a cut plane that is still closed stores some.
FALL = 1e-3
DISSIPATIVE = ("cohesion", "viscous", "adhesion", "coulomb")


def drawn(seed: int, number: int) -> Case:
    """A point: the material and the blade, in a specimen that is large against it."""
    rng = np.random.default_rng([seed, number])

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    blade = rng.choice(["contact", "wedge", "wire"])
    G, ratio, cohesion = log(1e-3, 1.0), log(0.02, 2.0), log(1.0, 50.0)
    thickness = log(0.1, 2.0) if blade == "wire" else log(0.2, 5.0)
    mu = float(rng.choice([0.0, rng.uniform(0.0, 0.3)]))
    values: dict[str, object] = {
        "G": f"{G} MPa", "nu": 0.49, "G_c": f"{3 * G * ratio} N/mm", "delta_c": f"{3 * ratio / cohesion} mm",
        "thickness": f"{thickness} mm", "mu": mu, "adhesion": float(rng.choice([0.0, log(0.003, 0.3)])),
        "speed": "1 mm/s", "viscosity": log(0.01, 5.0), "surface_length": f"{0.1 * thickness} mm",
        "width": f"{40 * thickness} mm", "height": f"{30 * thickness} mm", "length": f"{40 * thickness} mm",
        "depth": f"{DEPTH * thickness} mm", "precut": f"{(2 if blade == 'wire' else 0) * thickness} mm",
    }  # fmt: skip
    radius = log(0.01, 0.2)
    if blade == "contact":
        values["tip"] = f"{rng.uniform(1.0, 5.0) * thickness} mm"
    elif blade == "wedge":
        # An edge as round as the blade is thick is none.
        values |= {"angle": f"{rng.uniform(15, 35)} deg", "edge_radius": f"{min(radius, 0.3 * thickness)} mm"}
    return load_case("gelatin", {"with": [str(blade), "coulomb"], "name": f"{blade} {number}", **values})


def variants(case: Case) -> Iterator[tuple[str, Case]]:
    """The case as it is, with smaller elements, and with shorter steps."""
    n = case.numerics
    yield "defaults", case
    tuning = n.tuning.mesh.corner
    corner = max(tuning[0], tuning[1] * case.p.thickness / case.sizes.h_mm)
    yield "elements / 2", case.set(h=n.h / 2, corner=min(corner, 1.0))
    yield "steps / 2", case.set(step=n.step / 2, damage_step=n.damage_step / 3, energy_step=n.energy_step / 2)


def record(case: Case, limit: float) -> dict:
    """Measures of a run that ends at its ``limit``, s of one core."""
    began = time.process_time()

    def watch(*_: object) -> None:
        if time.process_time() - began > limit:
            raise KeyboardInterrupt

    result = run_case(case, on_progress=watch)
    curve, m = result.curve, result.measures
    falls = {}
    for name in result.ledger:
        taken = curve[f"work_{name}_mJ"]
        if any(word in name for word in DISSIPATIVE) and taken.max() > 0:
            falls[name] = float((np.maximum.accumulate(taken) - taken).max() / m["energy_mJ"])
    keys = ("onset_mm", "peak_N", "max_N", "steady_N", "drop_rel", "closure", "snap_rel", "jumps_rel")
    return {
        "outcome": result.outcome.kind, "reached_mm": result.outcome.reached_mm,
        "cpu_s": time.process_time() - began, "steps": result.counts["steps"],
        "iterations": result.counts["iterations"], "unknowns": result.counts["degrees_of_freedom"],
        "falls": falls, "transfer": float(curve.get(f"work_{TRANSFER}_mJ", np.zeros(1))[-1]),
        **{key: m.get(key, math.nan) for key in keys}, "doubts": list(case.doubts),
        "note": str(result.outcome),
    }  # fmt: skip


def moved(base: dict, other: dict) -> dict[str, float]:
    """By how much measures differ, relative but for the drop; infinite where one alone has it."""
    if base["outcome"] != "done" or other["outcome"] != "done":
        return {}
    out = {}
    for key in ("onset_mm", "peak_N", "steady_N", "drop_rel"):
        a, b = base[key], other[key]
        if math.isnan(a) or math.isnan(b):
            # A peak is one only where the force falls by a twentieth behind it.
            out[key] = 0.0 if math.isnan(a) == math.isnan(b) or key in ("peak_N", "steady_N") else math.inf
        else:
            out[key] = abs(b - a) / (1.0 if key == "drop_rel" else abs(a))
    return out


def kinds(point: dict) -> list[str]:
    """What does not hold at a point."""
    runs, out = point["runs"], []
    base = runs["defaults"]
    if base["outcome"] != "done":
        out.append(f"defaults {base['outcome']}")
    if abs(base["closure"]) > TOLERANCE["closure"]:
        out.append("closure")
    out += [f"work falls: {name}" for name, part in base["falls"].items() if part > FALL]
    for name, other in runs.items():
        out += [f"{name}: {key}" for key, change in moved(base, other).items() if change > TOLERANCE[key]]
        if name != "defaults" and other["outcome"] != "done":
            out.append(f"{name}: {other['outcome']}")
    return out


def _numbers(record: dict) -> dict:
    """With nan for what is not known."""
    return {key: math.nan if value is None else value for key, value in record.items()}


def main(argv: list[str] | None = None) -> int:
    """Compute what is missing, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.converged", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the points")
    parser.add_argument("--points", type=int, default=POINTS, help="how many")
    parser.add_argument("--seed", type=int, default=SEED, help="of the points")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds of one core a run")
    parser.add_argument("--defaults-only", action="store_true", help="without the finer runs")
    asked = parser.parse_args(argv)
    asked.out.mkdir(parents=True, exist_ok=True)
    points = []
    for number in range(asked.points):
        file = asked.out / f"{asked.seed}-{number}.json"
        point = json.loads(file.read_text()) if file.exists() else {"runs": {}}
        try:
            case = drawn(asked.seed, number)
        except BadInput as error:
            point = {"runs": {}, "refused": str(error)}
            write_json(point, file)
            continue
        point["case"] = {
            "name": case.name,
            **case.shown(),
            "groups": case.groups(),
            "sizes": vars(case.sizes),
        }
        for name, each in variants(case):
            if name not in point["runs"] and (name == "defaults" or not asked.defaults_only):
                # What defaults cost many times as much would end at the limit.
                point["runs"][name] = record(each, asked.limit if name == "defaults" else 3 * asked.limit)
                write_json(point, file)
                print(
                    case.name, name, {k: v for k, v in point["runs"][name].items() if k != "note"}, flush=True
                )
        points.append(json.loads(file.read_text(), object_hook=_numbers))
    rows = [
        [
            p["case"]["name"],
            "; ".join(kinds(p)) or "holds",
            *(f"{r['cpu_s']:.0f}" for r in p["runs"].values()),
        ]
        for p in points
    ]
    print(table(rows, ("point", "what does not hold", *next(iter(points))["runs"])))
    count = Counter(kind for p in points for kind in kinds(p))
    cost = [p["runs"]["defaults"]["cpu_s"] for p in points]
    print(facts(), *(f"{number} x {kind}" for kind, number in count.most_common()), sep="\n")
    print(f"{sum(not kinds(p) for p in points)} of {len(points)} hold")
    print(f"CPU s: median {np.median(cost):.0f}, nine in ten {np.quantile(cost, 0.9):.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
