"""Compute the runs of the atlas, and pack them for the package.

    python -m benchmarks.atlas --runs 400 --store DIR --workers 1
    python -m benchmarks.atlas --runs 400 --store DIR --pack cutbench/atlas/blunt.npz

Points of a box of dimensionless groups (``cutbench.atlas.box``), the first of Sobol's sequence. Started again
it computes what the store lacks, and takes more runs.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.robustness import record, run_all, say, summary
from benchmarks.tools import ROOT, check_json
from cutbench.atlas.box import BLUNT, WEDGE, Box
from cutbench.base.errors import CutbenchError
from cutbench.base.files import write_json
from cutbench.case.case import Case, load_case
from cutbench.run.store.runs import Store

BOXES = {"blunt": BLUNT, "wedge": WEDGE}
SEED = 1


def base_of(box: Box) -> Case:
    """The case whose groups are set: gelatin's units, with all laws of the box's model."""
    base = load_case("gelatin")
    return base if box is BLUNT else base.set(with_=box.blade)


def cases(box: Box, count: int, seed: int = SEED) -> list[Case]:
    """The first ``count`` runs of the atlas."""
    base = base_of(box)
    return [box.case(base, parts) for parts in box.points(count, seed)]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.atlas", description=__doc__.split("\n")[0])
    parser.add_argument("--box", choices=BOXES, default="blunt")
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--from", type=int, default=0, dest="first", help="leave so many of them to others")
    parser.add_argument("--seed", type=int, default=SEED, help="another than the atlas's: runs to test it by")
    parser.add_argument("--workers", type=int, default=1, help="processes; 0: in this one")
    parser.add_argument("--store", type=Path, default=ROOT / "runs" / "atlas", metavar="DIR")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    check_json(parser, asked.json)
    try:
        store = Store(asked.store)
        wanted = cases(BOXES[asked.box], asked.runs, asked.seed)[asked.first :]
        records: list[dict] = []
        began = time.monotonic()
        try:
            for result in run_all(wanted, store, asked.workers):
                records.append(record(result))
                head = f"{len(records)}/{len(wanted)} {time.monotonic() - began:6.0f} s"
                print(head, result.outcome, file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            print("Interrupted; the same command goes on from here.", file=sys.stderr)
        found = summary(records, len(wanted))
        say(found)
        if asked.json is not None:
            write_json({**found, "seed": asked.seed, "runs": records}, asked.json)
    except CutbenchError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
