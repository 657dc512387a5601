"""One timed run in a process of its own: reads a job as JSON on standard input, writes a record on output.

A process of its own, because the peak memory is a process's and because threads are set before numpy.
"""

from __future__ import annotations

import json
import sys

#: Parts of a run that its timer names; what is left of the total is "rest".
PARTS = ("setup", "window", "assembly", "residual", "factorization", "solve")


def record(result, peak_MB: float | None) -> dict:
    """Seconds, counts and ms per iteration of a ``cutbench.Result``.

    An iteration is a factorization with all that goes along with it. Steps with an old factorization are
    cheap: counted as iterations they would make the rest look fast, so they show as further solves only.
    Factorizations of steps that were given up count; their time does, too.
    """
    seconds = {part: result.timings.get(part, 0.0) for part in PARTS}
    total = result.timings["total"]
    seconds["rest"] = total - sum(seconds.values())
    counts = result.counts
    iterations = counts.get("factorization_calls", 0)
    shown = {
        "window": seconds["window"],
        "assembly": seconds["assembly"] + seconds["residual"],
        "factorization": seconds["factorization"],
        "solve": seconds["solve"],
        "rest": seconds["rest"],
    }
    return {
        "outcome": result.outcome.kind,
        "message": str(result.outcome),
        "reached_mm": result.outcome.reached_mm,
        "degrees_of_freedom": counts["degrees_of_freedom"],
        "steps": counts["steps"],
        "rejected_steps": counts["rejected_steps"],
        "iterations": iterations,
        "iterations_in_accepted_steps": counts["iterations"],
        "solves": counts.get("solve_calls", 0),
        "seconds": {**seconds, "total": total},
        "ms_per_iteration": {
            part: 1e3 * value / iterations if iterations else None
            for part, value in {"total": total, **shown}.items()
        },
        "closure": result.measures.get("closure"),
        "peak_MB": peak_MB,
    }


def peak_MB() -> float | None:
    """Largest resident size of this process in MB; None where the system does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / 1e6 if sys.platform == "darwin" else size / 1e3


def main() -> None:
    from cutbench.case.case import load_case
    from cutbench.run.build import build
    from cutbench.run.runner import run_case

    job = json.load(sys.stdin)
    case = load_case(job["material"], {**job["changes"], "depth": f"{job['depth_mm']!r} mm"})
    solver = build(case).problem.solver.name
    result = run_case(case)
    done = record(result, peak_MB()) | {"case": case.id, "solver": solver}
    json.dump(done, sys.stdout)


if __name__ == "__main__":
    main()
