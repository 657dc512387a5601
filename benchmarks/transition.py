"""``python -m benchmarks.transition [--points N] [--seed S] [--json FILE]``: what a point of a map costs.

A run to its transition at each of N points drawn at random (a Latin hypercube) in the box of
``studies/transition.toml``, with the study's numerics: median and quartiles of CPU seconds, and how many got
to the end. Beside it stands what the peer needs for its run on this machine (``benchmarks.peer``), where
there is DOLFINx. Exit status 1 if a run stalls.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.peer import ITERATIONS, PYTHON, iteration
from benchmarks.robustness import STUDY, drawn, side_of
from benchmarks.tools import check_json, facts, here, timed
from cutbench.base.files import write_json
from cutbench.maps.study import load_study

POINTS = 40


def jobs(count: int, seed: int, **changes: object) -> list[dict]:
    """Runs to the transition at points of the study's box."""
    study = load_study(STUDY)
    base = study.base.set(**{"until": "transition", **changes})
    cases = drawn(base, [side_of(axis, widen=0.0) for axis in study.axes], count, seed)
    return [{"material": base.name, "groups": case.groups(), "case": case.to_dict()} for case in cases]


def summary(runs: Sequence[dict], peer_s: float | None) -> dict:
    """Quartiles of the seconds, shares, and the seconds of the peer."""
    seconds = [r["cpu_s"] for r in runs]
    low, median, high = (float(q) for q in np.quantile(seconds, (0.25, 0.5, 0.75)))
    done = sum(r["outcome"] == "done" for r in runs)
    return {
        "points": len(runs), "done": done, "median_s": median, "quartiles_s": [low, high],
        "longest_s": max(seconds), "cut": sum(r["onset_mm"] is not None for r in runs), "peer_s": peer_s,
    }  # fmt: skip


def measured(count: int, seed: int, peer_s: float | None, **changes: object) -> dict:
    """Run them, one after the other. RuntimeError where the process crashes."""
    runs = []
    for run in timed(jobs(count, seed, **changes)):
        runs.append(run)
        print(f"{len(runs)}/{count}: {run['cpu_s']:.1f} s, {run['message']}", file=sys.stderr, flush=True)
    return {**summary(runs, peer_s), "seed": seed, "runs": runs}


def told(found: dict) -> str:
    """The summary in a sentence or two, for people and for the page."""
    low, high = found["quartiles_s"]
    text = (
        f"A run to its transition takes {found['median_s']:.1f} s of CPU time (median of {found['points']}"
        f" points drawn at random in the box of `studies/transition.toml`; half of them take {low:.1f} to"
        f" {high:.1f} s, the longest {found['longest_s']:.1f} s). {found['done']} of {found['points']} got to"
        f" their end."
    )
    if found["peer_s"] is not None:
        times = found["peer_s"] / found["median_s"]
        text += f" The peer's run takes {found['peer_s']:.0f} s here, {times:.1f} times the median."
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.transition", description=__doc__.split("\n")[0])
    parser.add_argument(
        "--points", type=int, default=POINTS, metavar="N", help=f"how many (default {POINTS})"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="S")
    parser.add_argument("--python", default=PYTHON, metavar="EXE", help="one that has DOLFINx")
    parser.add_argument("--quick", action="store_true", help="0.3 mm of travel: a check, no measurement")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    if asked.points < 1:
        parser.error(f"--points = {asked.points} cannot be used; expected a whole number, 1 or more")
    check_json(parser, asked.json)
    try:
        peer_s = ITERATIONS * iteration(asked.python, 20 if asked.quick else 200)["ms"] / 1000
    except (OSError, RuntimeError):
        peer_s = None
    found = measured(asked.points, asked.seed, peer_s, **({"depth": "0.3 mm"} if asked.quick else {}))
    print(told(found))
    if asked.json is not None:
        write_json({**here(), "machine": facts(), "quick": asked.quick, "transition": found}, asked.json)
    return 0 if found["done"] == found["points"] else 1


if __name__ == "__main__":
    sys.exit(main())
