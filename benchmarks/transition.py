"""``python -m benchmarks.transition [--points N] [--seed S] [--against COMMIT]``: what a point costs.

A run to its transition, or to 12 mm, at each of N points drawn at random (a Latin hypercube) in ``BOX``:
median, quartiles and ninth tenth of CPU seconds, and how many got to the end. ``--against``: the same points
in an older commit, by turns, each at its own defaults, with how much the answers differ. Beside it stands
what the peer needs for its run on this machine (``benchmarks.peer``), where there is DOLFINx. Exit status 1
if a run stalls.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from benchmarks.peer import ITERATIONS, PYTHON, iteration
from benchmarks.robustness import Side, drawn
from benchmarks.tools import check_json, facts, files_of, here, known, timed
from cutbench.base.files import write_json
from cutbench.case.case import Case, load_case

POINTS = 24
MATERIAL, DEPTH = "gelatin", "12 mm"
#: What is drawn: groups of the cut, friction, and the tip, 1.5 to 6 times as long as half of the blade's
#: 0.7 mm is wide.
BOX = (
    Side("cohesion", "1", 1.0, 15.0, True),
    Side("viscosity", "1", 0.01, 5.0, True),
    Side("adhesion", "1", 0.0, 0.2, False),
    Side("mu", "1", 0.0, 0.4, False),
    Side("tip", "mm", 0.525, 2.1, False),
)


def jobs(count: int, seed: int, **changes: object) -> list[dict]:
    """Runs to the transition at points of the box, as every commit can read them."""
    base = load_case(MATERIAL)
    return [
        {
            "material": MATERIAL, "groups": case.groups(),
            "changes": {**_values(base, case), "until": "transition", "depth": DEPTH, **changes},
        }
        for case in drawn(base, BOX, count, seed)
    ]  # fmt: skip


def _values(base: Case, case: Case) -> dict[str, str]:
    """By name what ``case`` has and ``base`` has not, with units."""
    told, plain = (each.to_dict()["values"] for each in (case, base))
    return {n: f"{q['value']!r} {q['unit']}" for n, q in told.items() if q != plain[n]}


def summary(runs: Sequence[dict], peer_s: float | None) -> dict:
    """Quartiles of the seconds, shares, and the seconds of the peer."""
    seconds = [r["cpu_s"] for r in runs]
    low, median, high, ninth = (float(q) for q in np.quantile(seconds, (0.25, 0.5, 0.75, 0.9)))
    done = sum(r["outcome"] == "done" for r in runs)
    return {
        "points": len(runs), "done": done, "median_s": median, "quartiles_s": [low, high],
        "ninth_s": ninth, "longest_s": max(seconds), "peer_s": peer_s,
        "cut": sum(r["onset_mm"] is not None for r in runs),
    }  # fmt: skip


def measured(
    count: int, seed: int, peer_s: float | None, older: Path | None = None, **changes: object
) -> dict:
    """Run them, one after the other, in ``older`` files beside. RuntimeError where a process crashes."""
    runs: list[dict] = []
    beside: list[dict] = []
    for k, job in enumerate(jobs(count, seed, **changes)):
        runs += timed([job])
        others = [] if older is None else list(timed([job], older))
        run, beside = runs[-1], beside + others
        text = "".join(f", {other['cpu_s']:.1f} s older" for other in others)
        print(f"{k + 1}/{count}: {run['cpu_s']:.1f} s{text}, {run['message']}", file=sys.stderr, flush=True)
    found = {**summary(runs, peer_s), "seed": seed, "runs": runs}
    return found if older is None else {**found, "older": {**summary(beside, None), "runs": beside}}


def told(found: dict) -> str:
    """The summary in a sentence or two, for people and for the page."""
    low, high = found["quartiles_s"]
    text = (
        f"A run to its transition takes {found['median_s']:.1f} s of CPU time (median of {found['points']}"
        f" points drawn at random; half of them take {low:.1f} to {high:.1f} s, a tenth more than"
        f" {found['ninth_s']:.1f} s, the longest {found['longest_s']:.1f} s). {found['done']} of"
        f" {found['points']} got to their end."
    )
    if "older" in found:
        older = found["older"]
        text += (
            f" The older commit takes {older['median_s'] / found['median_s']:.2f} times the median and"
            f" {older['ninth_s'] / found['ninth_s']:.2f} times the ninth tenth; {older['done']} got to their"
            f" end there. {moved(found['runs'], older['runs'])}"
        )
    if found["peer_s"] is not None:
        times = found["peer_s"] / found["median_s"]
        text += f" The peer's run takes {found['peer_s']:.0f} s here, {times:.1f} times the median."
    return text


def moved(runs: Sequence[dict], older: Sequence[dict]) -> str:
    """By how much onset and peak (relative) and drop differ at the most, in a sentence."""
    apart = []
    for key in ("onset_mm", "peak_N", "drop_rel"):
        both = [(a[key], b[key]) for a, b in zip(runs, older, strict=True)]
        size = [1.0 if key == "drop_rel" else b for _, b in both]
        apart.append(max((abs(a - b) / s for (a, b), s in zip(both, size, strict=True)
                          if a is not None and b is not None), default=0.0))  # fmt: skip
    onset, peak, drop = apart
    return f"Onsets differ by at most {onset:.1%}, peaks by {peak:.1%}, drops by {drop:.3f}."


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.transition", description=__doc__.split("\n")[0])
    parser.add_argument(
        "--points", type=int, default=POINTS, metavar="N", help=f"how many (default {POINTS})"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="S")
    parser.add_argument("--against", metavar="COMMIT", help="an older commit, by turns")
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
    changes = {"depth": "0.3 mm"} if asked.quick else {}
    older = None if asked.against is None else known(parser, "--against", asked.against)
    with nullcontext() if older is None else files_of(older) as tree:
        found = measured(asked.points, asked.seed, peer_s, tree, **changes)
    print(told(found))
    if asked.json is not None:
        write_json({**here(), "machine": facts(), "quick": asked.quick, "transition": found}, asked.json)
    return 0 if found["done"] == found["points"] else 1


if __name__ == "__main__":
    sys.exit(main())
