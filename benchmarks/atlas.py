"""Compute the runs of the atlas, one file each.

    python -m benchmarks.atlas --runs 400 --out DIR

Points of a box of dimensionless groups (``cutbench.atlas.box``), the first of Sobol's sequence. Started again
it computes what is missing; several at a time share the work. A run that takes more than ``--limit`` seconds
of one core is kept as far as it came.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.tools import ROOT, here
from cutbench.atlas.box import BLUNT, WEDGE, Box
from cutbench.base.errors import CutbenchError
from cutbench.base.files import replacing
from cutbench.case.case import Case, load_case
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


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.atlas", description=__doc__.split("\n")[0])
    parser.add_argument("--box", choices=BOXES, default="blunt")
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="leave so many of them to others")
    parser.add_argument("--seed", type=int, default=SEED, help="another than the atlas's: runs to test it by")
    parser.add_argument("--limit", type=float, default=240.0, help="seconds of one core for a run")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "atlas", metavar="DIR")
    asked = parser.parse_args(argv)
    asked.out.mkdir(parents=True, exist_ok=True)
    box = BOXES[asked.box]
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
