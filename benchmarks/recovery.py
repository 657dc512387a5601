"""Whether a fit finds the parameters that made its data, and says rightly how well it knows them.

    python -m benchmarks.recovery --cases 20 --json FILE

Each case: a soft solid with parameters drawn at random is cut at two speeds on a fine mesh (computed, not
measured), three specimens each that differ by a factor with a standard deviation of 3 %, readings with
noise of 1 % of the largest. A fit with larger elements, larger steps and a softer blade surface starts from
other random values and looks for five parameters. Counted: true values inside their 95 % intervals.
With ``--json`` the file is written after each case. Exit status 1 if a fit fails or fewer than 90 % or more
than 99 % of the values are inside, 2 for bad input.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.tools import facts
from cutbench.base.errors import ComputationFailed
from cutbench.base.files import write_json
from cutbench.calibration.fitting import fit
from cutbench.case.case import Case, load_case
from cutbench.data.campaign import FitPlan
from cutbench.discovery.synthetic import Noise, Test, campaign

NAMES = ("G", "G_c", "delta_c", "eta_reg", "tau_W")
#: Gelatin with a slender blade and a weak cut plane, which is cut from the first millimetre on.
SOLID = {"tip": "3 mm", "cohesion": 2.0, "tau_W": "2 kPa", "eta_reg": "5 s"}
#: In both, so that the normal is no part of what the coarse model gets wrong.
_BOTH = {"multiplier": "none", "normal": "material", "corner": 0.0625, "shallow": 1}
FINE = {**_BOTH, "h": "0.35 mm", "step": "0.05 mm", "penalty": 800, "stick": 320}
COARSE = {**_BOTH, "h": "0.8 mm", "step": "0.1 mm", "penalty": 200, "stick": 80}
TESTS = (Test("slow", speed=0.021, reach=2.0), Test("fast", speed=0.1, reach=2.0))
NOISE = Noise(repetitions=3, scatter=0.03, reading=0.01)
#: Standard deviations of the logarithms of the true values about the solid's, and of the starts about those.
SPREAD, START = 0.2, 0.3
WANTED = (0.90, 0.99)


def scattered(case: Case, spread: float, rng: np.random.Generator) -> Case:
    """The case with other values of the parameters that are looked for."""
    factors = np.exp(spread * rng.standard_normal(len(NAMES)))
    values = {**case.values, **{n: case.values[n] * f for n, f in zip(NAMES, factors, strict=True)}}
    return replace(case, values=values)


def recover(seed: int) -> dict:
    """One case. Raises ComputationFailed."""
    rng = np.random.default_rng(seed)
    truth = scattered(load_case("gelatin").set(**SOLID, **FINE), SPREAD, rng)
    start = scattered(truth, START, rng).set(**COARSE)
    began = time.perf_counter()
    made = campaign(truth, TESTS, start, noise=NOISE, seed=seed, plan=FitPlan(free=NAMES))
    generated, cpu = time.perf_counter() - began, time.process_time()
    found = fit(made, workers=0)
    values = {}
    for e in found.estimates:
        true = truth.values[e.label]
        values[e.label] = {
            "true": true, "value": e.value, "low": e.low, "high": e.high, "start": e.unknown.start,
            "inside": bool(e.low <= true <= e.high), "relative_error": e.value / true - 1,
            "relative_sd": e.sd / e.value, "degrees_of_freedom": e.dof,
        }  # fmt: skip
    return {
        "seed": seed, "status": found.status, "reduced_chi2": found.reduced_chi2, "parameters": values,
        "evaluations": found.evaluations, "generated_s": generated, "fit_s": found.seconds,
        "fit_cpu_s": time.process_time() - cpu,
    }  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    what = "Fits of synthetic cutting campaigns: how often the true values lie in the intervals."
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recovery", description=what)
    parser.add_argument("--cases", type=int, default=20, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the first case")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    if asked.cases < 1:
        parser.error(f"--cases = {asked.cases} cannot be used; expected 1 or more")
    found, failed = [], []
    for seed in range(asked.seed, asked.seed + asked.cases):
        try:
            found.append(recover(seed))
        except ComputationFailed as error:
            failed.append({"seed": seed, "message": str(error)})
            print(f"{seed}: {error}", flush=True)
        else:
            print(_line(found[-1]), flush=True)
        if asked.json is not None:
            report = {"machine": facts(), "cases": found, "failed": failed, **summary(found)}
            write_json(report, asked.json)
    if not found:
        return 1
    total = summary(found)
    print(f"{len(found)} fits, {100 * total['inside']:.0f} % of the true values inside their 95 % intervals")
    for name, part in total["inside_by_parameter"].items():
        print(f"  {name:<8} {100 * part:.0f} %, median error {100 * total['median_error'][name]:.1f} %")
    print(f"a fit took {total['median_fit_s']:.0f} s (median), {total['longest_fit_s']:.0f} s at the most")
    return 0 if not failed and WANTED[0] <= total["inside"] <= WANTED[1] else 1


def summary(found: Sequence[dict]) -> dict:
    """Shares of true values inside, errors, times."""
    if not found:
        return {}
    inside = {n: float(np.mean([f["parameters"][n]["inside"] for f in found])) for n in NAMES}
    error = {n: float(np.median([abs(f["parameters"][n]["relative_error"]) for f in found])) for n in NAMES}
    seconds = [f["fit_s"] for f in found]
    return {
        "inside": float(np.mean(list(inside.values()))), "inside_by_parameter": inside,
        "median_error": error, "median_fit_s": float(np.median(seconds)), "longest_fit_s": max(seconds),
    }  # fmt: skip


def _line(f: dict) -> str:
    values = "  ".join(
        f"{n} {100 * v['relative_error']:+.0f} ± {100 * v['relative_sd']:.0f} %" + " OUT" * (not v["inside"])
        for n, v in f["parameters"].items()
    )
    return f"{f['seed']:>3} {f['status']}, {f['evaluations']} evaluations, {f['fit_s']:.0f} s: {values}"


if __name__ == "__main__":
    sys.exit(main())
