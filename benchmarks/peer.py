"""``python -m benchmarks.peer --python /usr/bin/python3``: the coarse gelatin run beside DOLFINx, by turns.

An independent implementation of the published model in DOLFINx 0.5.2 needed 3,728 iterations at 2,094
degrees of freedom for gelatin to 14 mm. What one of them costs on this machine is measured with a problem of
that size and kind (``peer_dolfinx.py``: quadratic elements, bulk, cut and contact terms, MUMPS), just before
and just after each run of ours: on a shared machine only seconds of the same minutes compare. ``--python``
names an interpreter that has DOLFINx (Debian: ``python3-dolfinx``). Exit status 2 where it has not.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.__main__ import check_json, run, write_whole
from benchmarks.jobs import JOBS
from benchmarks.machine import facts
from cutbench.base.threads import ONE_THREAD

#: Iterations that the DOLFINx implementation needed to 14 mm.
ITERATIONS = 3728
JOB = "gelatin, coarse, as printed"


def iteration_ms(python: str) -> dict:
    """What ``peer_dolfinx.py`` measures. RuntimeError with its last words where it fails."""
    script = Path(__file__).with_name("peer_dolfinx.py")
    done = subprocess.run(
        [python, str(script)], capture_output=True, text=True, env={**os.environ, **ONE_THREAD}, check=False
    )
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        raise RuntimeError(said[-1] if said else f"exit status {done.returncode}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peer", description="Beside DOLFINx, by turns."
    )
    parser.add_argument("--python", default="/usr/bin/python3", metavar="EXE", help="one that has DOLFINx")
    parser.add_argument("--job", default=JOB, metavar="NAME", choices=[job.name for job in JOBS])
    parser.add_argument("--rounds", type=int, default=5, metavar="N")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    if asked.rounds < 1:
        parser.error(f"--rounds = {asked.rounds} cannot be used; expected a whole number, 1 or more")
    check_json(parser, asked.json)
    job = next(job for job in JOBS if job.name == asked.job)
    rounds = []
    try:
        before = iteration_ms(asked.python)
        for number in range(asked.rounds):
            ours, after = run(job, 1), iteration_ms(asked.python)
            theirs = ITERATIONS * (before["median_ms"] + after["median_ms"]) / 2000
            seconds = ours["seconds"]["total"]
            rounds.append({"ours_s": seconds, "theirs_s": theirs, "ratio": theirs / seconds, "run": ours})
            each = f"{before['median_ms']:.1f} and {after['median_ms']:.1f} ms an iteration"
            print(
                f"round {number + 1}: {theirs:.1f} s ({before['dofs']} dofs, {each}) against {seconds:.2f} s"
                f" ({ours['iterations']} iterations at {ours['degrees_of_freedom']} dofs):"
                f" {theirs / seconds:.1f} times",
                flush=True,
            )
            before = after
    except (OSError, RuntimeError) as error:
        print(
            f"--python = '{asked.python}': {error}; expected one that has DOLFINx 0.5",
            file=sys.stderr,
        )
        return 2
    ratios = [r["ratio"] for r in rounds]
    print(f"median of {len(ratios)}: {statistics.median(ratios):.1f} times")
    if asked.json is not None:
        write_whole(asked.json, {"machine": facts("1"), "iterations": ITERATIONS, "rounds": rounds})
    return 0


if __name__ == "__main__":
    sys.exit(main())
