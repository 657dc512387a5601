"""``python -m benchmarks [--quick] [--only NAME] [--repeat N] [--json FILE]``: seconds, iterations, memory.

Each job runs in a process of its own with one thread. This process imports no numpy: on Linux a child's
peak memory starts at its parent's size. Exit status 1 if a job fell short, 2 for bad input.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from benchmarks.jobs import JOBS, QUICK_MM, Job
from benchmarks.machine import facts
from cutbench.base.threads import ONE_THREAD

ROOT = Path(__file__).resolve().parents[1]

_COLUMNS = (
    "job", "solver", "mm", "dofs", "s", "steps", "given up", "iterations", "solves",
    "ms/it", "window", "assembly", "factor.", "solve", "rest", "peak MB",
)  # fmt: skip


def run(job: Job, repeat: int) -> dict:
    """The fastest of ``repeat`` runs of a job, with the seconds of all. RuntimeError if one crashes."""
    found = []
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    for _ in range(repeat):
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.measure"], input=json.dumps(asdict(job)), text=True,
            capture_output=True, env={**os.environ, **ONE_THREAD, "PYTHONPATH": path}, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            said = done.stderr.strip().splitlines()
            raise RuntimeError(f"{job.name}: {said[-1] if said else f'exit status {done.returncode}'}")
        found.append(json.loads(done.stdout))
    best = min(found, key=lambda r: r["seconds"]["total"])
    return {**asdict(job), **best, "all_seconds": [r["seconds"]["total"] for r in found]}


def row(r: dict) -> list[str]:
    """A record as the table shows it."""

    def ms(part: str) -> str:
        value = r["ms_per_iteration"][part]
        return "-" if value is None else f"{value:.2f}"

    reached = f"{r['reached_mm']:g}" + ("" if r["outcome"] == "done" else f" of {r['depth_mm']:g}")
    peak = "-" if r["peak_MB"] is None else f"{r['peak_MB']:.0f}"
    return [
        r["name"], r["solver"], reached, str(r["degrees_of_freedom"]), f"{r['seconds']['total']:.2f}",
        str(r["steps"]), str(r["rejected_steps"]), str(r["iterations"]), str(r["solves"]),
        ms("total"), ms("window"), ms("assembly"), ms("factorization"), ms("solve"), ms("rest"), peak,
    ]  # fmt: skip


def table(rows: Sequence[Sequence[str]], columns: Sequence[str] = _COLUMNS) -> str:
    """Columns of text, the first to the left, numbers to the right."""
    lines = [list(columns), *map(list, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    sides = [str.ljust if i < 2 else str.rjust for i in range(len(columns))]
    shown = [
        "  ".join(side(cell, width) for side, cell, width in zip(sides, line, widths, strict=True))
        for line in lines
    ]
    return "\n".join([shown[0], "-" * len(shown[0]), *shown[1:]])


def check_json(parser: argparse.ArgumentParser, path: Path | None) -> None:
    """Before the runs, so that minutes of measuring do not end at a missing folder."""
    if path is not None and not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
        parser.error(f"--json = '{path}' cannot be used; expected a file in a folder that can be written to")


def write_whole(path: Path, data: dict) -> None:
    """Write JSON beside ``path`` and put it in its place: it is there whole or not at all."""
    with tempfile.NamedTemporaryFile(
        "w", dir=path.parent, suffix=".tmp", delete=False, encoding="utf-8"
    ) as draft:
        json.dump(data, draft, indent=2)
        draft.write("\n")
    os.replace(draft.name, path)


def options(argv: Sequence[str] | None) -> argparse.Namespace:
    names = [job.name for job in JOBS]
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Time runs on this machine.")
    quick = f"{QUICK_MM:g} mm of travel each: a check, no measurement"
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument(
        "--only", action="append", choices=names, metavar="NAME", help=f"one of: {'; '.join(names)}"
    )
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="the fastest of N runs counts")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything there, too")
    asked = parser.parse_args(argv)
    if asked.repeat < 1:
        parser.error(f"--repeat = {asked.repeat} cannot be used; expected a whole number, 1 or more")
    check_json(parser, asked.json)
    return asked


def main(argv: Sequence[str] | None = None) -> int:
    asked = options(argv)
    jobs = [job for job in JOBS if asked.only is None or job.name in asked.only]
    if asked.quick:
        jobs = [replace(job, depth_mm=QUICK_MM) for job in jobs]
    found, crashed = [], []
    for job in jobs:
        print(f"{job.name}, {job.depth_mm:g} mm ...", file=sys.stderr, flush=True)
        try:
            found.append(run(job, asked.repeat))
        except RuntimeError as error:
            crashed.append(str(error))
            print(error, file=sys.stderr)
    machine = facts(ONE_THREAD["OMP_NUM_THREADS"])
    print(f"{machine['cpu']}, {machine['cores']} cores, {machine['threads_per_run']} thread a run")
    print(machine["system"])
    print(", ".join(f"{k} {v}" for k, v in {"python": machine["python"], **machine["versions"]}.items() if v))
    print(table([row(r) for r in found]))
    print(
        "iterations: factorizations, also of steps that were given up; solves beyond them reuse one.\n"
        "ms/it: time per iteration with its further solves. Where another program counts otherwise,\n"
        "only the seconds compare."
    )
    short = [r for r in found if r["outcome"] != "done"]
    for r in short:
        print(f"{r['name']}: {r['message']}")
    if asked.json is not None:
        write_whole(asked.json, {"quick": asked.quick, "machine": machine, "jobs": found, "crashed": crashed})
    return 1 if short or crashed else 0


if __name__ == "__main__":
    sys.exit(main())
