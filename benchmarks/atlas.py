"""Compute the runs of the atlas, one file each.

    python -m benchmarks.atlas --runs 400 --out DIR
    python -m benchmarks.atlas --pack cutbench/emulator/blunt.npz --out DIR
    python -m benchmarks.atlas --check 8 --out DIR

Points of a box of dimensionless groups (``cutbench.emulator.box``), the first of Sobol's sequence. Started
again it computes what is missing; several at a time share the work. A run that takes more than ``--limit`` seconds
of one core is kept as far as it came. ``--pack`` puts what there is into one file; ``--check`` says how far
an atlas of seven eighths of the runs is off at the others.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools import ROOT, facts, here
from cutbench.base.errors import CutbenchError
from cutbench.base.files import replacing
from cutbench.case.case import Case, load_case
from cutbench.emulator.alignment import Course
from cutbench.emulator.atlas import Atlas, values_of
from cutbench.emulator.box import BLUNT, WEDGE, Box
from cutbench.emulator.groups import Groups
from cutbench.run.measures import label as regime
from cutbench.run.runner import run_case

BOXES = {"blunt": BLUNT, "wedge": WEDGE}
#: Of the atlas; runs that it is tested by have another.
SEED = 1


def base_of(box: Box) -> Case:
    """The case whose groups are set: gelatin's units, with all laws of the box's model."""
    base = load_case("gelatin")
    return base if box is BLUNT else base.set(with_=box.blade)


def cases(box: Box, count: int, seed: int = SEED) -> list[Case]:
    """The first ``count`` runs of the atlas."""
    base = base_of(box)
    return [box.case(base, parts) for parts in box.points(count, seed)]


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
        "message": result.outcome.message, "seconds": time.process_time() - began,
        "measures": json.dumps(result.measures), **curve,
    }  # fmt: skip


def runs_in(folder: Path, box: Box, seed: int = SEED) -> list[dict[str, Any]]:
    """The runs that are kept, with arrays as arrays and measures by name."""
    found = []
    for file in sorted(folder.glob(f"*-{seed}-*.npz")):
        with np.load(file) as data:
            if "displacement_mm" not in data:
                continue
            case = Case.from_dict(json.loads(str(data["case"])))
            if (box.blade in case.mechanisms) and case.dim == 2:
                measures = json.loads(str(data["measures"]))
                found.append({**{n: data[n] for n in data.files}, "case": case, "measures": measures})
    return found


def atlas_of(box: Box, runs: Sequence[Mapping[str, Any]]) -> Atlas:
    """The atlas that runs make."""
    names = [n for n in runs[0] if n.startswith("work_")]
    courses, works = [], {n.removeprefix("work_").removesuffix("_mJ"): [] for n in names}
    for run in runs:
        units, values = Groups.of(run["case"]), run["case"].values
        assert units is not None
        half, force = units.length(values), units.force(values)
        kept = thinned(run["displacement_mm"], run["force_N"])
        onset = run["measures"]["onset_mm"] / half
        courses.append(Course(run["displacement_mm"][kept] / half, run["force_N"][kept] / force, onset))
        for name in names:
            key = name.removeprefix("work_").removesuffix("_mJ")
            works[key].append(run[name][kept] / (force * half))
    groups = np.array([values_of(box, run["case"]) for run in runs])
    return Atlas(box, groups, courses, works)


def thinned(x: np.ndarray, y: np.ndarray, part: float = 1e-3) -> np.ndarray:
    """Numbers of the points of a polygon from which the others are less than a part of its largest value
    (Ramer 1972, 10.1016/S0146-664X(72)80017-0)."""
    keep, todo, most = {0, x.size - 1}, [(0, x.size - 1)], part * np.abs(y).max()
    while todo:
        i, j = todo.pop()
        if j - i < 2:
            continue
        off = np.abs(y[i + 1 : j] - np.interp(x[i + 1 : j], x[[i, j]], y[[i, j]]))
        k = i + 1 + int(off.argmax())
        if off.max() > most:
            keep.add(k)
            todo += [(i, k), (k, j)]
    return np.array(sorted(keep))


def check(box: Box, runs: Sequence[Mapping[str, Any]], folds: int) -> dict[str, dict[str, float]]:
    """How far an atlas without a part of the runs is off at these, part by part, and how often its intervals
    hold."""
    of = np.random.default_rng(0).permutation(len(runs)) % folds
    found: dict[str, list[tuple[float, ...]]] = {n: [] for n in ("onset", "peak", "drop", "steady")}
    right = []
    for fold in range(folds):
        made = atlas_of(box, [r for r, f in zip(runs, of, strict=True) if f != fold])
        for run in (r for r, f in zip(runs, of, strict=True) if f == fold):
            said, true = made.estimate(run["case"]), run["measures"]
            label = regime(true["drop_rel"])
            right.append((said.verdict == label, said.chance > 0.95))
            for name, key in (
                ("onset", "onset_mm"), ("peak", "peak_N"), ("drop", "drop_rel"), ("steady", "steady_N")
            ):  # fmt: skip
                interval = vars(said)["drop" if name == "drop" else key]
                if math.isfinite(true[key]) and math.isfinite(interval.value):
                    off = abs(interval.value - true[key]) / (1.0 if name == "drop" else abs(true[key]))
                    found[name].append((off, interval.low <= true[key] <= interval.high))
    table = {}
    for name, rows in found.items():
        off, held = np.array(rows, dtype=float).T
        ends = {"median": np.median(off), "in nine of ten below": np.quantile(off, 0.9)}
        table[name] = {"points": off.size, **ends, "held": held.mean()}
    is_right, is_sure = np.array(right, dtype=bool)[:, :2].T
    table["regime"] = {
        "points": len(right), "right": is_right.mean(), "right or undecided": (is_right | ~is_sure).mean(),
        "decided": is_sure.mean(),
    }  # fmt: skip
    return table


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.atlas", description=__doc__.split("\n")[0])
    parser.add_argument("--box", choices=BOXES, default="blunt")
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="leave so many of them to others")
    parser.add_argument("--seed", type=int, default=SEED, help="another than the atlas's: runs to test it by")
    parser.add_argument("--limit", type=float, default=240.0, help="seconds of one core for a run")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "atlas", metavar="DIR")
    parser.add_argument("--pack", type=Path, metavar="FILE", help="write the atlas of what there is")
    parser.add_argument("--check", type=int, metavar="FOLDS", help="say how far it is off")
    asked = parser.parse_args(argv)
    asked.out.mkdir(parents=True, exist_ok=True)
    box = BOXES[asked.box]
    if asked.pack or asked.check:
        runs = runs_in(asked.out, box)
        if asked.check:
            for name, row in check(box, runs, asked.check).items():
                print(name, ", ".join(f"{key} {value:.3g}" for key, value in row.items()))
        if asked.pack:
            commits = sorted({str(run["commit"]) for run in runs})
            numerics = runs[0]["case"].to_dict()["numerics"]
            about = {"commits": commits, "numerics": numerics, "machine": facts(), "runs": len(runs)}
            atlas_of(box, runs).write(asked.pack, about)
        return 0
    for number, case in enumerate(cases(box, asked.runs, asked.seed)[asked.first :], asked.first):
        file = asked.out / f"{asked.box}-{asked.seed}-{number:04d}.npz"
        claim = file.with_suffix(".claimed")
        if file.exists():
            continue
        try:
            claim.touch(exist_ok=False)
        except FileExistsError:
            continue
        try:
            found = compute(case, asked.limit)
            with replacing(file) as draft, open(draft, "wb") as to:
                np.savez_compressed(to, **found)
        finally:
            claim.unlink()
        print(number, found["outcome"], f"{found.get('seconds', 0):.0f} s", found["message"], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
