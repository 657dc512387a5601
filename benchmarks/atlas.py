"""Compute the runs of the atlas, one file each.

    python -m benchmarks.atlas --runs 400 --out DIR
    python -m benchmarks.atlas --pack cutbench/emulator/blunt.npz --out DIR
    python -m benchmarks.atlas --check 8 --out DIR
    python -m benchmarks.atlas --against studies/transition.toml

Points of a box of dimensionless groups (``cutbench.emulator.design_space``), the first of Sobol's sequence.
It goes on from the runs that the package brings along; several at a time share the work. A run that takes
more than ``--limit`` seconds of one core is kept as far as it came. ``--pack`` puts those of the package and
those of the folder into one file, each once;
``--check`` says how far an atlas of seven eighths of the runs is off at the others.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from benchmarks.tools import ROOT, facts, here
from cutbench.base.errors import CutbenchError
from cutbench.base.files import replacing
from cutbench.case.case import Case
from cutbench.emulator.alignment import Course
from cutbench.emulator.atlas import (
    DROP_WINDOW,
    LEVEL,
    MEASURES_WITH_PROCESS,
    NORMAL_QUANTILE,
    Atlas,
    estimate,
    shipped,
    values_of,
)
from cutbench.emulator.design_space import BLUNT_BLADES
from cutbench.emulator.groups import Groups
from cutbench.maps.dataset import load_map
from cutbench.maps.page import thinned
from cutbench.maps.study import load_study
from cutbench.run.measures import KNOWN, measures
from cutbench.run.measures import label as regime
from cutbench.run.runner import run_case

#: Of the atlas; runs that it is tested by have another.
SEED = 1
#: A curve is kept to this part of its largest force.
CURVE_TOLERANCE = 1e-3
#: Parts of the runs that are left out, one after the other, to see how far intervals hold.
FOLDS = 8


def cases(count: int, seed: int = SEED) -> list[Case]:
    """The first ``count`` runs of the atlas."""
    return [BLUNT_BLADES.case(parts) for parts in BLUNT_BLADES.points(count, seed)]


def compute(case: Case, limit_s: float) -> dict[str, object]:
    """A run, as it is kept: the case, how it ended, and its curve; no longer than ``limit_s`` of one core."""
    began = time.process_time()

    def watch(row: Mapping[str, float], snapshot: object) -> None:
        if time.process_time() - began > limit_s:
            raise KeyboardInterrupt

    try:
        result = run_case(case, on_step=watch)
    except CutbenchError as error:
        return {"case": json.dumps(case.to_dict()), "outcome": "failed", "message": str(error)}
    keep = ("displacement_mm", "force_N", "cut_length_mm")
    curve = {n: v for n, v in result.curve.items() if n in keep or n.startswith("work_")}
    return {
        "case": json.dumps(case.to_dict()), "outcome": result.outcome.kind, "commit": here()["commit"] or "",
        "message": result.outcome.message, "seconds": time.process_time() - began, **curve,
    }  # fmt: skip


def runs_in(folder: Path, seed: int = SEED) -> list[dict[str, Any]]:
    """The runs that a folder keeps, with arrays as arrays and measures by name, as they are defined now."""
    found = []
    for file in sorted(folder.glob(f"{seed}-*.npz")):
        with np.load(file) as data:
            if "displacement_mm" not in data:
                continue
            record = {n: data[n] for n in data.files}
        p = (case := Case.from_dict(json.loads(str(record["case"])))).p
        measured = measures(record, window_mm=p.thickness, height_mm=p.height)
        found.append(record | {"number": int(file.stem.split("-")[1]), "case": case, "measures": measured})
    return found


def runs_of(atlas: Atlas) -> list[dict[str, Any]]:
    """The runs of an atlas, as ``runs_in`` has them."""
    found = []
    for i, (course, groups) in enumerate(zip(atlas.courses, atlas.groups, strict=True)):
        case = BLUNT_BLADES.case_of([float(f"{value:.6g}") for value in groups])
        half, force = units_of(case)
        peak, drop, steady = (float(atlas.measured[name][i]) for name in MEASURES_WITH_PROCESS)
        found.append({
            "number": atlas.about["numbers"][i], "case": case,
            "displacement_mm": course.x * half, "force_N": course.force * force,
            **{f"work_{n}_mJ": each[i] * force * half for n, each in atlas.cumulative_work.items()},
            "measures": {
                "onset_mm": course.onset * half, "peak_N": peak * force, "drop_rel": drop,
                "steady_N": steady * force,
            },
        })  # fmt: skip
    return found


def atlas_of(runs: Sequence[Mapping[str, Any]], wider: Mapping[str, float] | None = None) -> Atlas:
    """The atlas that runs make."""
    names = {n.removeprefix("work_").removesuffix("_mJ"): n for n in runs[0] if n.startswith("work_")}
    courses, works = [], {name: list[np.ndarray]() for name in names}
    measured = {name: list[float]() for name in MEASURES_WITH_PROCESS}
    for run in runs:
        half, force = units_of(run["case"])
        x, m = run["displacement_mm"], run["measures"]
        kept, _ = thinned(x, run["force_N"] / np.abs(run["force_N"]).max(), CURVE_TOLERANCE, x.size)
        x = x[kept] / half
        courses.append(Course(x, run["force_N"][kept] / force, m["onset_mm"] / half))
        for name, key in names.items():
            works[name].append(run[key][kept] / (force * half))
        # Of a run that was cut short the transition may be to come.
        known = x[-1] > m["onset_mm"] / half + KNOWN * DROP_WINDOW
        for name, value in zip(
            MEASURES_WITH_PROCESS, (m["peak_N"] / force, m["drop_rel"], m["steady_N"] / force), strict=True
        ):
            measured[name].append(value if known else math.nan)
    groups = np.array([values_of(BLUNT_BLADES, run["case"]) for run in runs])
    return Atlas(
        BLUNT_BLADES, groups, courses, {n: np.array(v) for n, v in measured.items()}, works, wider=wider
    )


def units_of(case: Case) -> tuple[float, float]:
    """Half the blade's thickness, mm, and the unit of force, N."""
    units = Groups.of(case)
    assert units is not None
    return units.length(case.values), units.force(case.values)


def folds_of(
    runs: Sequence[Mapping[str, Any]], folds: int, wider: Mapping[str, float] | None = None
) -> Iterator[tuple[Atlas, list[Mapping[str, Any]]]]:
    """Atlases that each lack a part of the runs, and these."""
    of = np.random.default_rng(0).permutation(len(runs)) % folds
    for fold in range(folds):
        made = atlas_of([r for r, f in zip(runs, of, strict=True) if f != fold], wider)
        yield made, [r for r, f in zip(runs, of, strict=True) if f == fold]


def wider_of(runs: Sequence[Mapping[str, Any]], folds: int) -> dict[str, float]:
    """By what each interval is wider than the processes say, so that it holds nine in ten of the runs that
    an atlas lacks."""
    z: dict[str, list[float]] = {name: [] for name in ("onset", *MEASURES_WITH_PROCESS)}
    inside: dict[float, list[float]] = {factor: [] for factor in (1.0, 1.2, 1.4, 1.7, 2.0, 2.4)}
    for made, others in folds_of(runs, folds):
        for run in others:
            half, force = units_of(run["case"])
            values, m = np.array([values_of(BLUNT_BLADES, run["case"])]), run["measures"]
            end = run["displacement_mm"][-1] / half
            said = made.measures(values, np.array([end]))
            true = {
                "onset": np.log(m["onset_mm"] / half), "peak": np.log(m["peak_N"] / force),
                "drop": np.sqrt(m["drop_rel"]), "steady": np.log(max(m["steady_N"], 1e-9) / force),
            }  # fmt: skip
            for name, value in true.items():
                mean, sd = getattr(said, name)[0]
                if np.isfinite(value):
                    z[name].append(abs(value - mean) / sd)
            x = np.linspace(0, end, 60)[1:]
            F = np.interp(x * half, run["displacement_mm"], run["force_N"]) / force
            for factor, parts in inside.items():
                made.wider = {"curve": factor}
                low, _, high = made.band(values, x)
                parts.append(float(np.mean((low <= F) & (high >= F))))
            made.wider = {}
    found = {name: max(1.0, float(np.quantile(each, LEVEL)) / NORMAL_QUANTILE) for name, each in z.items()}
    enough = [factor for factor, parts in inside.items() if np.mean(parts) >= LEVEL]
    return {**found, "curve": min(enough, default=max(inside))}


def check(
    runs: Sequence[Mapping[str, Any]], folds: int, wider: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """How far an atlas without a part of the runs is off at these, part by part, and how often its intervals
    hold."""
    found: dict[str, list[tuple[float, float]]] = {n: [] for n in ("onset", "peak", "drop", "steady")}
    right, curves = [], []
    for made, others in folds_of(runs, folds, wider):
        for run in others:
            said, true = made.estimate(run["case"]), run["measures"]
            # Of a run that was cut short the regime may be to come.
            whole = run["displacement_mm"][-1] >= run["case"].values["depth"] * (1 - 1e-6)
            if math.isfinite(true["drop_rel"]) or (math.isnan(true["onset_mm"]) and whole):
                right.append((said.verdict == regime(true["drop_rel"]), said.chance > 0.95))
            F = np.interp(said.x_mm, run["displacement_mm"], run["force_N"])
            there = said.x_mm <= run["displacement_mm"][-1]
            curves.append((
                np.sqrt(np.mean((F - said.force_N)[there] ** 2)) / F.max(),
                np.mean(((said.low_N <= F) & (said.high_N >= F))[there]),
            ))  # fmt: skip
            for name, key in (
                ("onset", "onset_mm"), ("peak", "peak_N"), ("drop", "drop_rel"), ("steady", "steady_N")
            ):  # fmt: skip
                interval = vars(said)["drop" if name == "drop" else key]
                if math.isfinite(true[key]) and math.isfinite(interval.value):
                    off = abs(interval.value - true[key]) / (1.0 if name == "drop" else abs(true[key]))
                    found[name].append((off, interval.low <= true[key] <= interval.high))
    table = {}
    for name, rows in {**found, "curve": curves}.items():
        off, held = np.array(rows, dtype=float).T
        ends = {"median": np.median(off), "in nine of ten below": np.quantile(off, 0.9)}
        table[name] = {"points": off.size, **ends, "held": held.mean()}
    is_right, is_sure = np.array(right, dtype=bool).T
    table["regime"] = {
        "points": len(right), "right": is_right.mean(), "right or undecided": (is_right | ~is_sure).mean(),
        "decided": is_sure.mean(),
    }  # fmt: skip
    return table


def against(study_file: Path) -> dict[str, dict[str, float]]:
    """How far the atlas of the package is off at the runs of a shipped map, and how often intervals hold."""
    study = load_study(study_file)
    data = load_map(study_file.parent / "results" / study_file.stem / "map.nc")
    rows: dict[str, list[tuple[float, float]]] = {name: [] for name in ("onset_mm", "peak_N", "drop")}
    for index in np.argwhere(data["run_id"].values != ""):
        said = estimate(study.case_at([float(a.values[i]) for a, i in zip(study.axes, index, strict=True)]))
        for name, found in rows.items():
            true = float(data["drop_rel" if name == "drop" else name].values[tuple(index)])
            interval = getattr(said, name)
            if math.isfinite(true) and math.isfinite(interval.value):
                off = abs(interval.value - true) / (1.0 if name == "drop" else true)
                found.append((off, interval.low <= true <= interval.high))
    return {
        name: {"points": len(found), "median": np.median([o for o, _ in found]),
               "held": np.mean([h for _, h in found])}
        for name, found in rows.items()
    }  # fmt: skip


def say(table: Mapping[str, Mapping[str, float]]) -> None:
    """A line a row."""
    for name, row in table.items():
        print(name, ", ".join(f"{key} {value:.3g}" for key, value in row.items()))


def pack(runs: Sequence[Mapping[str, Any]], folds: int | None, file: Path | None) -> None:
    """Say how far the atlas of the runs is off, or write it into ``file``."""
    wider = wider_of(runs, folds or FOLDS)
    print(len(runs), "runs; intervals wider by", {n: round(v, 2) for n, v in wider.items()})
    if folds:
        say(check(runs, folds, wider))
    if file is not None:
        commits = {*shipped().about["commits"], *(str(run["commit"]) for run in runs if "commit" in run)}
        about = {
            "commits": sorted(commits), "numerics": BLUNT_BLADES.base.to_dict()["numerics"],
            "machine": facts(), "runs": len(runs), "numbers": [run["number"] for run in runs],
        }  # fmt: skip
        atlas_of(runs, wider).write(file, about)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.atlas", description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=SEED, help="another than the atlas's: runs to test it by")
    parser.add_argument("--limit", type=float, default=240.0, help="seconds of one core for a run")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "atlas", metavar="DIR")
    parser.add_argument("--pack", type=Path, metavar="FILE", help="write the atlas of what there is")
    parser.add_argument("--check", type=int, metavar="FOLDS", help="say how far it is off")
    parser.add_argument("--against", type=Path, metavar="STUDY.toml", help="hold it against a shipped map")
    asked = parser.parse_args(argv)
    if asked.against:
        say(against(asked.against))
        return 0
    if asked.pack or asked.check:
        runs = {run["number"]: run for run in [*runs_of(shipped()), *runs_in(asked.out)]}
        pack([runs[number] for number in sorted(runs)], asked.check, asked.pack)
        return 0
    asked.out.mkdir(parents=True, exist_ok=True)
    there = set(shipped().about["numbers"]) if asked.seed == SEED else set()
    for number, case in enumerate(cases(asked.runs, asked.seed)):
        if number in there:
            continue
        file = asked.out / f"{asked.seed}-{number:04d}.npz"
        lock = FileLock(file.with_suffix(".lock"))
        try:
            with lock.acquire(timeout=0):
                if file.exists():
                    continue
                found = compute(case, asked.limit)
                with replacing(file) as draft, open(draft, "wb") as to:
                    np.savez_compressed(to, **found)
        except Timeout:  # another process computes it
            continue
        print(number, found["outcome"], f"{found.get('seconds', 0):.0f} s", found["message"], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
