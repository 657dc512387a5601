"""Timed runs in a process of their own: jobs as a JSON list on standard input, a record a line on output.

With the package of the folder that it is started in, which may be an older one: so this file knows nothing of
its neighbours, and of cutbench a few public names alone. Before the first job of a kind a short run loads
what a process loads once, compiled code with it.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import cutbench

#: Parts of a run's time that are the limit: factorizations and solutions, of the body and around the front.
LIMIT = ("factorization", "solve", "window_factorization", "window_solve")
COUNTS = ("steps", "rejected_steps", "iterations", "factorization_calls", "window_factorization_calls")
MEASURES = ("onset_mm", "peak_N", "drop_rel", "closure")
WARM_MM = 0.2


def record(result, cpu_s: float) -> dict:
    """What a run cost and what came out; ``limit`` is the limit's part of its time, None where a part of the
    solutions has not been timed."""
    seconds = result.timings
    whole = "window" not in seconds or "window_solve" in seconds
    return {
        "outcome": result.outcome.kind,
        "message": str(result.outcome),
        "reached_mm": float(result.outcome.reached_mm),
        "unknowns": result.counts["degrees_of_freedom"],
        "cpu_s": cpu_s,
        "limit": sum(seconds.get(name, 0.0) for name in LIMIT) / seconds["total"] if whole else None,
        **{name: result.counts.get(name, 0) for name in COUNTS},
        **{name: number(result.measures.get(name)) for name in MEASURES},
        "seconds": {name: float(value) for name, value in seconds.items()},
    }


def number(value: float | None) -> float | None:
    """None for what is not finite: JSON has no word for it."""
    return float(value) if value is not None and abs(value) < float("inf") else None


def peak_MB() -> float | None:
    """Largest resident size of this process in MB; None where the system does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / 1e6 if sys.platform == "darwin" else size / 1e3


def main() -> None:
    here = Path.cwd().resolve()
    if not cutbench.__file__ or not Path(cutbench.__file__).resolve().is_relative_to(here):
        sys.exit(f"cutbench is that of {cutbench.__file__}, not the one of {here}")
    jobs, warm = json.load(sys.stdin), set()
    for job in jobs:
        case = job.pop("case", None)
        if case is None:
            case, kind = (
                cutbench.load_case(job["material"], job["changes"]),
                (job["material"], *job["changes"]),
            )
        else:
            case, kind = cutbench.Case.from_dict(case), job["material"]
        if kind not in warm:
            cutbench.run2d(case.set(depth=f"{WARM_MM} mm"))
            warm.add(kind)
        begin = time.process_time()
        result = cutbench.run2d(case)
        done = record(result, time.process_time() - begin)
        print(json.dumps({**job, **done, "peak_MB": peak_MB()}), flush=True)


if __name__ == "__main__":
    main()
