"""How many points of a map's box, and around it, reach their depth.

    python -m benchmarks.robustness --points 200 --workers 2 --json FILE

A Latin hypercube over the axes of a study, each widened by half (a quarter of its length, in logarithms
where the axis is logarithmic, beyond either end), and over the length of the blade's tip, 0.5 to 4 mm;
with ``--wide`` over the length of the surfaces, friction and a cut made beforehand, too.
Runs are kept in a store: started again with the same points and seed, it computes what is missing.
Exit status 1 if fewer than 99 % reach their depth, 2 for bad input.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tools import ROOT, check_json
from cutbench.base.errors import CutbenchError
from cutbench.base.files import write_json
from cutbench.case.case import Case
from cutbench.maps.axes import Axis
from cutbench.maps.study import Study, load_study
from cutbench.run.pool.pool import Job, TaskPool
from cutbench.run.pool.worker import WorkerLost, work
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

STUDY = ROOT / "studies" / "transition.toml"
#: An axis is made longer by this part of its length.
WIDEN = 0.5
#: Length of the blade's tip, mm: from blunt to slender.
TIP_MM = (0.5, 4.0)
#: What ``--wide`` adds: a quarter to twice the default's length, no friction to a dry blade's, up to 3 mm.
WIDE = (
    ("surface_length", "mm", 0.0175, 0.14, True),
    ("mu", "1", 0.0, 0.5, False),
    ("precut", "mm", 0.0, 3.0, False),
)
#: Part of the points that has to reach its depth.
WANTED = 0.99


@dataclass(frozen=True)
class Side:
    """One side of the box, from ``low`` to ``high`` in ``unit``."""

    name: str
    unit: str
    low: float
    high: float
    log: bool

    def at(self, part: float) -> float | str:
        """The value at ``part`` (0 to 1) of the side, as ``Case.set`` takes it; six digits."""
        if self.log:
            value = self.low * (self.high / self.low) ** part
        else:
            value = self.low + part * (self.high - self.low)
        value = float(f"{value:.6g}")
        return value if self.unit == "1" else f"{value!r} {self.unit}"


def side_of(axis: Axis, widen: float = WIDEN) -> Side:
    """The axis, longer by a part of its length; nothing that was 0 or above falls below 0."""
    low, high = axis.values[0], axis.values[-1]
    if axis.scale == "log":
        factor = (high / low) ** (widen / 2)
        return Side(axis.name, axis.unit, low / factor, high * factor, True)
    more = widen / 2 * (high - low)
    return Side(axis.name, axis.unit, max(low - more, 0.0) if low >= 0 else low - more, high + more, False)


def box(study: Study, wide: bool = False) -> list[Side]:
    """The study's axes and, unless one of them sets it, the length of the tip; with ``wide`` more."""
    more = [Side("tip", "mm", *TIP_MM, True), *(Side(*side) for side in WIDE if wide)]
    taken = {axis.sets for axis in study.axes}
    return [*map(side_of, study.axes), *(side for side in more if side.name not in taken)]


def points(study: Study, count: int, *, seed: int = 1, wide: bool = False, **changes: object) -> list[Case]:
    """``count`` cases of a Latin hypercube over the study's box; ``changes`` as ``Case.set`` takes them.

    The blade goes down to the bottom, wherever the study's runs end, unless ``changes`` say otherwise.
    """
    down = {"depth": f"{study.base.p.height!r} mm", "until": "depth"}
    return drawn(study.base.set(**{**down, **changes}), box(study, wide), count, seed)


def drawn(base: Case, sides: Sequence[Side], count: int, seed: int) -> list[Case]:
    """``base`` at ``count`` points of a Latin hypercube between ``sides``."""
    rng = np.random.default_rng(seed)
    # One point in each of ``count`` slices of every side, at random within it.
    slices = np.stack([rng.permutation(count) for _ in sides], axis=1)
    parts = (slices + rng.random(slices.shape)) / count
    return [
        base.set(**{side.name: side.at(float(part)) for side, part in zip(sides, row, strict=True)})
        for row in parts
    ]


def run_all(cases: Sequence[Case], store: Store, workers: int) -> Iterable[Result]:
    """Results as they come: first those that the store has, then the rest on ``workers`` processes."""
    missing = []
    for case in {case.id: case for case in cases}.values():
        if (result := store.get(case.id)) is not None:
            yield result
        else:
            missing.append(case)
    by_id = {case.id: case for case in missing}
    root, mark = store.root.resolve(), store.mark()
    with TaskPool(workers) as pool:
        for done in pool.run(Job(id, work, (None, case, root, mark, False)) for id, case in by_id.items()):
            done.result()
            yield from _kept(store, by_id[done.key])


def _kept(store: Store, case: Case) -> Iterable[Result]:
    result = store.get(case.id)
    return [] if result is None else [result]


def record(result: Result) -> dict:
    """What is kept of a run in the JSON file."""
    case = result.case
    return {
        "id": case.id,
        "outcome": result.outcome.kind,
        "message": result.outcome.message,
        "reached_mm": result.outcome.reached_mm,
        "groups": case.groups(),
        "tip_mm": case.values["tip"],
        "seconds": result.timings.get("total"),
        "closure": result.measures.get("closure"),
        "reaction_error": result.measures.get("reaction_error"),
        **{name: result.counts.get(name) for name in ("steps", "iterations", "rejected_steps")},
    }


def summary(records: Sequence[dict], asked: int) -> dict:
    """How many reached their depth, and why the rest did not."""
    done = [r for r in records if r["outcome"] == "done"]
    seconds = [r["seconds"] for r in records if r["seconds"]]
    closures = [abs(r["closure"]) for r in done if r["closure"] is not None]
    return {
        "points": asked,
        "computed": len(records),
        "reached": len(done),
        "part": len(done) / len(records) if records else 0.0,
        "median_seconds": float(np.median(seconds)) if seconds else None,
        "largest_closure": max(closures, default=None),
        "short": [r for r in records if r["outcome"] != "done"],
    }


def say(found: dict) -> None:
    """The summary, for people."""
    share = f"{100 * found['part']:.4g} %"
    print(f"{found['reached']} of {found['computed']} points reached their depth ({share}).")
    if found["computed"] < found["points"]:
        print(f"{found['points'] - found['computed']} of {found['points']} points are not computed yet.")
    if found["median_seconds"] is not None:
        print(f"A run took {found['median_seconds']:.1f} s (median).")
    if found["largest_closure"] is not None:
        print(f"The energy ledger closes within {100 * found['largest_closure']:.2g} % of the blade's work.")
    for r in sorted(found["short"], key=lambda r: r["reached_mm"]):
        where = ", ".join(f"{name} = {value:.3g}" for name, value in r["groups"].items())
        print(f"  {r['id']} {r['outcome']} at {r['reached_mm']:.3f} mm: {r['message']}\n    {where}")


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m benchmarks.robustness", description=__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=200, help="how many (default 200)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes; 0: in this one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--study", type=Path, default=STUDY, help="default studies/transition.toml")
    parser.add_argument("--depth", help="blade travel with its unit (default: the specimen's height)")
    parser.add_argument(
        "--until", choices=("depth", "transition"), help="where runs end (default: at the depth)"
    )
    parser.add_argument("--wide", action="store_true", help="other surfaces, friction and pre-cuts, too")
    parser.add_argument("--h", help="element size at the cut plane with its unit")
    parser.add_argument("--store", type=Path, default=ROOT / "runs" / "robustness", metavar="DIR")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    for name, low in (("points", 1), ("workers", 0), ("seed", 0)):
        if getattr(asked, name) < low:
            parser.error(f"--{name} = {getattr(asked, name)} cannot be used; expected {low} or more")
    check_json(parser, asked.json)
    return asked


def main(argv: Sequence[str] | None = None) -> int:
    asked = arguments(argv)
    try:
        study, store = load_study(asked.study), Store(asked.store)
        changes = {
            key: getattr(asked, key) for key in ("depth", "h", "until") if getattr(asked, key) is not None
        }
        cases = points(study, asked.points, seed=asked.seed, wide=asked.wide, **changes)
        records: list[dict] = []
        stopped = None
        began = time.monotonic()
        try:
            for result in run_all(cases, store, asked.workers):
                records.append(record(result))
                head = f"{len(records)}/{len(cases)} {time.monotonic() - began:6.0f} s"
                print(head, result.outcome, file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            stopped = "Interrupted; the same command goes on from here."
        except WorkerLost as error:
            stopped = f"{error}; the same command goes on from here."
        found = summary(records, len(cases))
        say(found)
        if asked.json is not None:
            runs = sorted(records, key=lambda r: r["id"])
            write_json({**found, "seed": asked.seed, "runs": runs}, asked.json)
    except CutbenchError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    if stopped is not None:
        print(stopped, file=sys.stderr)
        return 1
    return 0 if found["part"] >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
