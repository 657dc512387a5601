"""Blocks in three dimensions: one step of indentation by each solver, and the published model's run.

    python -m benchmarks.solid [--large] [--run [--python EXE]] [--json FILE]

The step presses the blade 0.02 mm into gelatin, from rest, with linear elements: about 11,000 and 45,000
tetrahedra in the quarter block, with ``--large`` also 114,000 and 300,000. Solvers: ``direct`` (a
factorization in every iteration), ``kept`` (GMRES preconditioned by the last one), ``multigrid`` (nothing
factorized). ``--run``: gelatin with the paper's numerics to 14 mm; where EXE has DOLFINx, an iteration of a
block of its size there is measured just before and after (``peer_dolfinx.py``). Each in a process of its own
with one thread. Exit status 1 if one falls short, 2 for bad input.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.one_run import peak_MB
from benchmarks.peer import PYTHON, iteration
from benchmarks.tools import ROOT, check_json, facts, table
from cutbench.base.files import write_json
from cutbench.base.threads import ONE_THREAD

#: Element sizes in mm and how many thousand tetrahedra they give; the last two only if asked for.
SIZES = ((0.85, 11), (0.4, 44), (0.25, 114), (0.175, 300))
#: How each solver is called in a case.
SOLVERS = {"direct": "pardiso", "kept": "kept", "multigrid": "multigrid"}
#: Blade travel in mm; iterations and seconds that an implementation in DOLFINx needed for it, on another
#: machine (taken as given); how many of the iterations are measured here.
RUN_MM, PEER_ITERATIONS, PEER_S, REPEAT = 14.0, 6216, 881.0, 30

_COLUMNS = (
    "tetrahedra", "dofs", "solver", "mm", "N", "setup s", "s", "iterations", "factor.", "GMRES", "peak MB",
)  # fmt: skip


def jobs(large: bool, run: bool) -> list[dict]:
    """What to compute, as plain data."""
    sizes = SIZES if large else SIZES[:2]
    found = [{"h": h, "solver": name, "depth_mm": 0.02} for h, _ in sizes for name in SOLVERS]
    return found + ([{"depth_mm": RUN_MM}] if run else [])


def measured(job: dict) -> dict:
    """Compute ``job`` in this process. Raises BadInput for a solver that is not installed."""
    from cutbench.case.case import load_case
    from cutbench.run.build import build
    from cutbench.solver.march import Stalled

    changes = {"numerics": "paper", "depth": f"{job['depth_mm']!r} mm"}
    if "h" in job:
        name = SOLVERS[job["solver"]]
        name = "superlu" if name == "pardiso" and not _has_pardiso() else name
        # Whole Newton steps of one kind: the staggered scheme has nothing to hold before the cut.
        changes |= {"h": f"{job['h']!r} mm", "corner": 1, "solver": name, "scheme": "monolithic"}
    case = load_case("gelatin", changes, dim=3)
    since = time.perf_counter()
    built = build(case)
    ready, cpu = time.perf_counter(), time.process_time()
    last, iterations, steps, stopped = None, 0, 0, None
    try:
        for last in built.march:
            iterations, steps = iterations + last.iterations, steps + 1
    except Stalled as error:
        stopped = error.reason
    done, cpu = time.perf_counter(), time.process_time() - cpu
    problem = built.problem
    counts = getattr(problem.solver, "counts", {})
    return {
        **job,
        "tetrahedra": int(built.geometry.mesh.t.shape[1]),
        "degrees_of_freedom": int(problem.free.size),
        "entries": int(problem.pattern.indices.size),
        "solver": job.get("solver", "auto"),
        "library": problem.solver.name,
        "reached_mm": 0.0 if last is None else last.travel,
        "force_N": None if last is None else last.force * built.geometry.multiplicity,
        "stopped": stopped,
        "setup_s": ready - since,
        "march_s": done - ready,
        "march_cpu_s": cpu,
        "steps": steps,
        "iterations": iterations,
        "factorizations": counts.get("factorizations", problem.timer.counts.get("factorization", 0)),
        "hierarchies": counts.get("hierarchies", 0),
        "gmres_iterations": counts.get("gmres_iterations", 0),
        "seconds": problem.timer.seconds,
        "peak_MB": peak_MB(),
    }


def _has_pardiso() -> bool:
    from cutbench.solver.linear import available

    return "pardiso" in available()


def run(job: dict) -> dict:
    """``measured`` in a process of its own. RuntimeError if it crashes."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.solid", "--job", json.dumps(job)], text=True,
        capture_output=True, env={**os.environ, **ONE_THREAD, "PYTHONPATH": path}, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        raise RuntimeError(f"{job}: {said[-1] if said else f'exit status {done.returncode}'}")
    return json.loads(done.stdout)


def beside(job: dict, python: str) -> dict:
    """``run``, with the CPU ms of an iteration of the peer where ``python`` has it, else why not."""
    try:
        before = iteration(python, REPEAT, "block")
    except (OSError, RuntimeError) as error:
        return {**run(job), "peer_failed": str(error)}
    record, after = run(job), iteration(python, REPEAT, "block")
    return {**record, "peer_ms": (before["ms"] + after["ms"]) / 2, "peer_unknowns": before["dofs"]}


def row(r: dict) -> list[str]:
    """A record as the table shows it."""
    made = f"{r['hierarchies']} (AMG)" if r["solver"] == "multigrid" else str(r["factorizations"])
    return [
        str(r["tetrahedra"]), str(r["degrees_of_freedom"]), r["solver"], f"{r['reached_mm']:g}",
        "-" if r["force_N"] is None else f"{r['force_N']:.6f}", f"{r['setup_s']:.1f}", f"{r['march_s']:.1f}",
        str(r["iterations"]), made, str(r["gmres_iterations"]),
        "-" if r["peak_MB"] is None else f"{r['peak_MB']:.0f}",
    ]  # fmt: skip


def _peer(r: dict) -> str:
    """What the peer takes, in words."""
    given = f"DOLFINx {PEER_S:g} s on another machine"
    if "peer_ms" not in r:
        return f"{given}, and it is not here: {r.get('peer_failed', 'not asked')}"
    here = PEER_ITERATIONS * r["peer_ms"] / 1000
    iterations = f"{PEER_ITERATIONS:,} iterations of {r['peer_ms']:.0f} ms"
    return (
        f"{given}; its {iterations} ({r['peer_unknowns']:,} unknowns)"
        f" {here:.0f} CPU s here, {here / r['march_cpu_s']:.1f} times as long"
    )


def options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.solid", description="Time blocks.")
    parser.add_argument("--large", action="store_true", help="larger blocks too, up to 300,000 tetrahedra")
    parser.add_argument("--run", action="store_true", help="the published model's run to 14 mm too")
    parser.add_argument("--python", default=PYTHON, metavar="EXE", help="one that has DOLFINx, for --run")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything there, too")
    parser.add_argument("--job", type=json.loads, help=argparse.SUPPRESS)
    asked = parser.parse_args(argv)
    check_json(parser, asked.json)
    return asked


def main(argv: Sequence[str] | None = None) -> int:
    asked = options(argv)
    if asked.job is not None:
        json.dump(measured(asked.job), sys.stdout)
        return 0
    found, crashed = [], []
    machine = facts()
    for job in jobs(asked.large, asked.run):
        print(job, "...", file=sys.stderr, flush=True)
        try:
            found.append(run(job) if "h" in job else beside(job, asked.python))
        except RuntimeError as error:
            crashed.append(str(error))
            print(error, file=sys.stderr)
        if asked.json is not None:  # after each: the large ones take minutes
            write_json({"machine": machine, "jobs": found, "crashed": crashed}, asked.json)
    print(f"{machine['cpu']}, {machine['cores']} cores, one thread a run")
    print(table([row(r) for r in found], _COLUMNS))
    for r in found:
        if "h" not in r:
            print(
                f"paper's numerics to {r['reached_mm']:g} mm: {r['march_s']:.0f} s,"
                f" {r['march_cpu_s']:.0f} of them CPU; {_peer(r)}"
            )
    short = [r for r in found if r["stopped"] is not None]
    for r in short:
        print(f"{r['tetrahedra']} tetrahedra, {r['solver']}: {r['stopped']}")
    return 1 if short or crashed else 0


if __name__ == "__main__":
    sys.exit(main())
