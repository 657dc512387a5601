"""Compute the runs of the atlas, one file each.

    python -m benchmarks.atlas --blade wedge --runs 400 --out DIR
    python -m benchmarks.atlas --pack --out DIR
    python -m benchmarks.atlas --check 8 --out DIR
    python -m benchmarks.atlas --blade wedge --seed 90 --runs 50 --out DIR
    python -m benchmarks.atlas --test 90 --out DIR
    python -m benchmarks.atlas --against studies/transition.toml

Points of a box of dimensionless groups (``cutbench.emulator.design_space``), the first of Sobol's sequence.
It goes on from the runs that the package brings along; several at a time share the work. A run ends with its
transition, every third one where cutting has been steady for some windows; one that takes more than
``--limit`` seconds of one core is kept as far as it came. ``--pack`` puts those of the package and those of
the folder into the package, each once; ``--check`` says how far an atlas of seven eighths of the runs is off
at the others.
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
    MEASURES_WITH_PROCESS,
    Atlas,
    NotInAtlas,
    named,
    shipped,
    values_of,
)
from cutbench.emulator.design_space import BLADES, DesignSpace
from cutbench.emulator.gaussian_process import Kernel
from cutbench.emulator.groups import Groups
from cutbench.emulator.settings import SETTINGS
from cutbench.maps.dataset import load_map
from cutbench.maps.page import thinned
from cutbench.maps.study import load_study
from cutbench.run.measures import KNOWN, ONSET, SETTLED, measures
from cutbench.run.measures import label as regime
from cutbench.run.runner import run_case

#: Of the atlas; runs that it is tested by have another.
SEED = 2
#: Of so many runs one goes on until cutting is steady: what is steady changes little from place to place, and
#: takes most of the time.
STEADY_EVERY = 3
#: Windows beyond the onset at which runs end: as the transition is known, and where cutting has been steady
#: for three.
WINDOWS = KNOWN + 0.1, SETTLED + 3.1
FILE = ROOT / "cutbench" / "emulator" / "atlas.npz"
#: What is held against runs: names of an atlas and of measures.
ESTIMATED = {"onset": "onset_mm", "peak": "peak_N", "drop": "drop_rel", "steady": "steady_N"}
#: A curve is kept to this part of its largest force.
CURVE_TOLERANCE = 1e-3
#: Parts of the runs that are left out, one after the other, to see how far intervals hold.
FOLDS = 8


def cases(space: DesignSpace, count: int, seed: int = SEED) -> list[Case]:
    """The first ``count`` runs of the atlas."""
    return [space.case(parts) for parts in space.points(count, seed)]


def compute(case: Case, limit_s: float, windows: float) -> dict[str, object]:
    """A run, as it is kept: the case, how it ended, and its curve; so many ``windows`` beyond its onset, and
    no longer than ``limit_s`` of one core."""
    began, end = time.process_time(), math.inf
    window = case.p.thickness
    begun = case.p.precut + ONSET * window

    def watch(row: Mapping[str, float], snapshot: object) -> None:
        nonlocal end
        if math.isinf(end) and row["cut_length_mm"] >= begun:
            end = row["displacement_mm"] + windows * window
        if row["displacement_mm"] >= end or time.process_time() - began > limit_s:
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


def runs_in(folder: Path, seed: int = SEED, blade: str = "*") -> list[dict[str, Any]]:
    """The runs that a folder keeps, with arrays as arrays and measures by name, as they are defined now."""
    found = []
    for file in sorted(folder.glob(f"{blade}-{seed}-*.npz")):
        with np.load(file) as data:
            if "displacement_mm" not in data:
                continue
            record = {n: data[n] for n in data.files}
        p = (case := Case.from_dict(json.loads(str(record["case"])))).p
        # What blades of all kinds take is the work of contact.
        record["work_contact_mJ"] = record.pop(f"work_{case.model.tool.name}_mJ")
        measured = measures(record, window_mm=p.thickness, height_mm=p.height)
        found.append(record | {"name": file.stem, "case": case, "measures": measured})
    return found


def runs_of(atlas: Atlas) -> list[dict[str, Any]]:
    """The runs of an atlas, as ``runs_in`` has them."""
    found = []
    for i, (course, groups) in enumerate(zip(atlas.courses, atlas.groups, strict=True)):
        has = named(groups)
        space = next(each for each in BLADES.values() if {s.name for s in each.ranges} == {*has})
        case = space.case_of([float(f"{has[s.name]:.6g}") for s in space.ranges])
        half, force = units_of(case)
        peak, drop, steady, slope = (float(atlas.measured[name][i]) for name in MEASURES_WITH_PROCESS)
        found.append({
            "name": atlas.about["names"][i], "case": case,
            "displacement_mm": course.x * half, "force_N": course.force * force,
            **{f"work_{n}_mJ": each[i] * force * half for n, each in atlas.cumulative_work.items()},
            "measures": {
                "onset_mm": course.onset * half, "peak_N": peak * force, "drop_rel": drop,
                "steady_N": steady * force, "slope_N_per_mm": slope * force / half,
            },
        })  # fmt: skip
    return found


def atlas_of(
    runs: Sequence[Mapping[str, Any]], wider: Mapping[str, float] | None = None,
    kernels: Mapping[str, Kernel | None] | None = None,
) -> Atlas:  # fmt: skip
    """The atlas that runs make."""
    names = {n.removeprefix("work_").removesuffix("_mJ"): n for n in runs[0] if n.startswith("work_")}
    courses, works = [], {name: list[np.ndarray]() for name in names}
    measured = {name: list[float]() for name in MEASURES_WITH_PROCESS}
    for run in runs:
        half, force = units_of(run["case"])
        x, m = run["displacement_mm"], run["measures"]
        kept, _ = thinned(x, run["force_N"] / np.abs(run["force_N"]).max(), CURVE_TOLERANCE, x.size)
        none, x = np.zeros(x.size), x[kept] / half  # what a law takes that the run's model lacks
        courses.append(Course(x, run["force_N"][kept] / force, m["onset_mm"] / half))
        for name, key in names.items():
            works[name].append(run.get(key, none)[kept] / (force * half))
        # Of a run that was cut short the transition may be to come.
        known = x[-1] > m["onset_mm"] / half + KNOWN * DROP_WINDOW
        of_steady = m["steady_N"] / force, m["slope_N_per_mm"] * half / force
        # Into a slit a blade falls before it cuts, which is a peak of its own.
        peak = math.nan if run["case"].values["precut"] else m["peak_N"] / force
        values = peak, m["drop_rel"], *of_steady
        for name, value in zip(MEASURES_WITH_PROCESS, values, strict=True):
            measured[name].append(value if known else math.nan)
    groups = np.array([values_of(run["case"], checked=False) for run in runs])
    works_kept = {n: np.array(v, dtype=object) for n, v in works.items()}
    return Atlas(groups, courses, {n: np.array(v) for n, v in measured.items()}, works_kept, kernels, wider)


def units_of(case: Case) -> tuple[float, float]:
    """Half the blade's thickness, mm, and the unit of force, N."""
    units = Groups.of(case)
    assert units is not None
    return units.length(case.values), units.force(case.values)


def folds_of(
    atlas: Atlas, runs: Sequence[Mapping[str, Any]], folds: int
) -> Iterator[tuple[Atlas, list[Mapping[str, Any]]]]:
    """Atlases that each lack a part of the runs, and these; with the lengths of the whole."""
    of = np.random.default_rng(0).permutation(len(runs)) % folds
    for fold in range(folds):
        kept = [r for r, f in zip(runs, of, strict=True) if f != fold]
        made = atlas_of(kept, atlas.wider, atlas.kernels)
        yield made, [r for r, f in zip(runs, of, strict=True) if f == fold]


def wider_of(atlas: Atlas, runs: Sequence[Mapping[str, Any]], folds: int) -> dict[str, float]:
    """By what each interval is wider than the processes say, blade by blade, so that it holds nine in ten of
    the runs that an atlas lacks."""
    z: dict[str, list[float]] = {}
    inside: dict[str, dict[float, list[float]]] = {}
    for made, others in folds_of(atlas, runs, folds):
        for run in others:
            half, force = units_of(run["case"])
            blade, m = run["case"].model.tool.name, run["measures"]
            values = np.array([values_of(run["case"], checked=False)])
            end = run["displacement_mm"][-1] / half
            said = made.measures(values, np.array([end]))
            with np.errstate(invalid="ignore"):
                true = {
                    "onset": np.log(m["onset_mm"] / half), "drop": np.sqrt(m["drop_rel"]),
                    "steady": np.log(max(m["steady_N"], 1e-9) / force),
                    "slope": m["slope_N_per_mm"] * half / force,
                }  # fmt: skip
            if not run["case"].values["precut"]:
                true["peak"] = np.log(m["peak_N"] / force)
            for name, value in true.items():
                mean, sd = getattr(said, name)[0]
                if np.isfinite(value):
                    z.setdefault(f"{blade} {name}", []).append(abs(value - mean) / sd)
            x = np.linspace(0, end, 60)[1:]
            F = np.interp(x * half, run["displacement_mm"], run["force_N"]) / force
            parts = inside.setdefault(f"{blade} curve", {})
            for factor in (1.0, 1.2, 1.4, 1.7, 2.0, 2.4):
                made.wider = {f"{blade} curve": factor}
                low, _, high = made.band(values, said, x)
                parts.setdefault(factor, []).append(float(np.mean((low <= F) & (high >= F))))
            made.wider = {}
    found = {
        name: max(1.0, float(np.quantile(each, SETTINGS.level)) / SETTINGS.quantile)
        for name, each in z.items()
    }
    for name, parts in inside.items():
        enough = [factor for factor, held in parts.items() if np.mean(held) >= SETTINGS.level]
        found[name] = min(enough, default=max(parts))
    return found


def tested(made: Atlas, runs: Sequence[Mapping[str, Any]]) -> dict[str, list[tuple[Any, ...]]]:
    """By measure how far an atlas is off at runs that it lacks, and whether its interval holds them."""
    rows: dict[str, list[tuple[Any, ...]]] = {n: [] for n in (*ESTIMATED, "curve", "own", "regime")}
    for run in runs:
        try:
            said, true = made.estimate(run["case"].set(until="depth")), run["measures"]
        except NotInAtlas:
            continue
        x = run["displacement_mm"]
        # Of a run that was cut short the regime may be to come.
        whole = x[-1] >= run["case"].values["depth"] * (1 - 1e-6)
        if math.isfinite(true["drop_rel"]) or (math.isnan(true["onset_mm"]) and whole):
            rows["regime"].append((said.verdict == regime(true["drop_rel"]), said.chance > 0.95))
        there = said.x_mm <= x[-1]
        F = np.interp(said.x_mm, x, run["force_N"])
        held = (said.low_N <= F) & (said.high_N >= F)
        rows["curve"].append((np.sqrt(np.mean((F - said.force_N)[there] ** 2)) / F.max(), held[there].mean()))
        # What is steady is so over the last travel of a run, which may have ended early.
        until_there = made.estimate(run["case"].set(until="depth", depth=f"{x[-1]:.9g} mm"))
        for name, key in ESTIMATED.items():
            source = until_there if name == "steady" else said
            interval = vars(source)["drop" if name == "drop" else key]
            if math.isfinite(true[key]) and math.isfinite(interval.value):
                off = abs(interval.value - true[key]) / (1.0 if name == "drop" else abs(true[key]))
                rows[name].append((off, interval.low <= true[key] <= interval.high))
        # Whether the drawn curve has the numbers beside it.
        if math.isfinite(said.onset_mm.value):
            window = run["case"].p.thickness
            cut = np.maximum(said.x_mm - said.onset_mm.value + ONSET * window, 0.0)
            curve = {"displacement_mm": said.x_mm, "force_N": said.force_N, "cut_length_mm": cut}
            drawn = measures(curve, window_mm=window, height_mm=run["case"].p.height)
            own = [(drawn["drop_rel"], said.drop), (drawn["steady_N"], said.steady_N)]
            rows["own"] += [(abs(v - i.value), i.low <= v <= i.high) for v, i in own
                            if math.isfinite(v) and math.isfinite(i.value)]  # fmt: skip
    return rows


def table_of(rows: Mapping[str, Sequence[tuple[Any, ...]]]) -> dict[str, dict[str, float]]:
    """What ``tested`` found, in numbers."""
    table = {}
    for name, each in rows.items():
        if not each:
            continue
        off, held = np.array(each, dtype=float).T
        if name == "regime":
            right = {"right": off.mean(), "right or undecided": np.maximum(off, 1 - held).mean()}
            table[name] = {"points": len(each), **right, "decided": held.mean()}
            continue
        ends = {"median": np.median(off), "in nine of ten below": np.quantile(off, 0.9)}
        table[name] = {"points": off.size, **ends, "held": held.mean()}
    return table


def against(study_file: Path) -> dict[str, dict[str, float]]:
    """How far the atlas of the package is off at the runs of a shipped map, and how often intervals hold."""
    study = load_study(study_file)
    data = load_map(study_file.parent / "results" / study_file.stem / "map.nc")
    rows: dict[str, list[tuple[Any, ...]]] = {name: [] for name in ("onset_mm", "peak_N", "drop")}
    for index in np.argwhere(data["run_id"].values != ""):
        at = [float(a.values[i]) for a, i in zip(study.axes, index, strict=True)]
        said = shipped().estimate(study.case_at(at))
        for name, found in rows.items():
            true = float(data["drop_rel" if name == "drop" else name].values[tuple(index)])
            interval = getattr(said, name)
            if math.isfinite(true) and math.isfinite(interval.value):
                off = abs(interval.value - true) / (1.0 if name == "drop" else true)
                found.append((off, interval.low <= true <= interval.high))
    return table_of(rows)


def say(title: str, table: Mapping[str, Mapping[str, float]]) -> None:
    """A line a row."""
    print(title)
    for name, row in table.items():
        print(name, ", ".join(f"{key} {value:.3g}" for key, value in row.items()))


def pack(runs: Sequence[Mapping[str, Any]], folds: int | None, file: Path | None) -> None:
    """Say how far the atlas of the runs is off, or write it into ``file``."""
    atlas = atlas_of(runs)
    atlas.wider = wider_of(atlas, runs, folds or FOLDS)
    print(len(runs), "runs; intervals wider by", {n: round(v, 2) for n, v in atlas.wider.items()})
    if folds:
        rows: dict[str, dict[str, list[tuple[Any, ...]]]] = {blade: {} for blade in BLADES}
        for made, others in folds_of(atlas, runs, folds):
            for blade, of_blade in rows.items():
                some = [run for run in others if run["case"].model.tool.name == blade]
                for name, each in tested(made, some).items():
                    of_blade.setdefault(name, []).extend(each)
        for blade, of_blade in rows.items():
            say(f"{blade}, {folds} folds", table_of(of_blade))
    if file is not None:
        about = {
            "commits": sorted({str(run["commit"]) for run in runs if "commit" in run}),
            "machine": facts(), "runs": len(runs),
            "numerics": BLADES["contact"].base.to_dict()["numerics"], "names": [run["name"] for run in runs],
        }  # fmt: skip
        atlas.write(file, about)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.atlas", description=__doc__.split("\n")[0])
    parser.add_argument("--blade", choices=[*BLADES], default="contact")
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=SEED, help="another than the atlas's: runs to test it by")
    parser.add_argument("--limit", type=float, default=240.0, help="seconds of one core for a run")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "atlas", metavar="DIR")
    parser.add_argument("--pack", action="store_true", help="write the atlas of what there is")
    parser.add_argument("--check", type=int, metavar="FOLDS", help="say how far it is off")
    parser.add_argument("--test", type=int, metavar="SEED", help="hold it against runs of another seed")
    parser.add_argument("--against", type=Path, metavar="STUDY.toml", help="hold it against a shipped map")
    asked = parser.parse_args(argv)
    if asked.against:
        say(asked.against.stem, against(asked.against))
        return 0
    # Its kernels are of its coordinates, which may be others now.
    known = runs_of(Atlas.read(FILE, fitted=False)) if FILE.exists() else []
    if asked.pack or asked.check:
        runs = {run["name"]: run for run in [*known, *runs_in(asked.out)]}
        pack([runs[name] for name in sorted(runs)], asked.check, FILE if asked.pack else None)
        return 0
    if asked.test:
        for blade in BLADES:
            say(blade, table_of(tested(shipped(), runs_in(asked.out, asked.test, blade))))
        return 0
    asked.out.mkdir(parents=True, exist_ok=True)
    space, there = BLADES[asked.blade], {run["name"] for run in known}
    for number, case in enumerate(cases(space, asked.runs, asked.seed)):
        file = asked.out / f"{space.blade}-{asked.seed}-{number:04d}.npz"
        if file.stem in there:
            continue
        lock = FileLock(file.with_suffix(".lock"))
        try:
            with lock.acquire(timeout=0):
                if file.exists():
                    continue
                found = compute(case, asked.limit, WINDOWS[number % STEADY_EVERY == 0])
                with replacing(file) as draft, open(draft, "wb") as to:
                    np.savez_compressed(to, **found)
        except Timeout:  # another process computes it
            continue
        print(number, found["outcome"], f"{found.get('seconds', 0):.0f} s", found["message"], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
