"""``python -m benchmarks.peer [--python EXE] [--rounds N] [--json FILE]``: beside DOLFINx, by turns.

The published model of gelatin to 14 mm in plane strain: quadratic elements, 2,090 unknowns, the default
predictor, the energy held. Ours is run, and CPU seconds are measured. Of the other side two things make the
seconds. *Measured* here, on this machine, just before and just after each of our runs: one Newton iteration
in DOLFINx of a problem of that size and kind (``peer_dolfinx.py``; it leaves out friction, adhesion and
states, so it is rather faster than the whole). *Taken as given*: an independent implementation of the model
in DOLFINx 0.5.2 needed 3,728 such iterations; it is not part of this repository, and is not run.

Two problems: with this package's stiff contact, and with the contact as the model was published, which is
what the other side solved. ``--python`` names an interpreter that has DOLFINx (Debian: ``python3-dolfinx``).
Exit status 2 where it has not.
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

from benchmarks.tools import ROOT, check_json, facts, fastest, here, job, timed
from cutbench.base.files import write_json
from cutbench.base.threads import ONE_THREAD

#: Iterations that the implementation in DOLFINx needed to 14 mm.
ITERATIONS = 3728
DEPTH_MM, ROUNDS = 14.0, 3
PYTHON = "/usr/bin/python3"
#: Element size in mm at which the section has about 2,090 unknowns.
SIZE_MM = 0.52
#: As published: the laws, the material's normal, elements as wide as tall; nothing keeps surfaces apart.
_LAWS = {
    "with_": ["smith_ferrante", "viscous"], "without": "surface_gradient", "self_contact": "off",
    "normal": "material", "release": "0 mm", "element": "P2", "h": f"{SIZE_MM:g} mm", "slender": 1,
    "corner": 1, "shallow": 1, "step": "0.1 mm",
}  # fmt: skip
#: ε_N = 1 N/mm² on the dimensionless gap, in G per mm of ours; sticking as stiff as printed for elements of
#: 1 mm; no multiplier.
_CONTACT = {"gap": "ellipse", "penalty": 533.4, "stick": 9333.1, "multiplier": "none", "closing": 0}
PROBLEMS = {"contact as published": {**_LAWS, **_CONTACT}, "contact of the defaults": _LAWS}


def iteration(python: str, repeat: int, kind: str = "section") -> dict:
    """What ``peer_dolfinx.py`` measures of a ``section`` or a ``block``.

    RuntimeError with its last words where it fails, OSError without ``python``.
    """
    script = Path(__file__).with_name("peer_dolfinx.py")
    done = subprocess.run(
        [python, str(script), str(repeat), kind], capture_output=True, text=True, cwd=ROOT,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": ""}, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        raise RuntimeError(said[-1] if said else f"exit status {done.returncode}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def measured(python: str, rounds: int, depth_mm: float = DEPTH_MM, repeat: int = 200) -> dict:
    """Both sides by turns. RuntimeError or OSError where ``python`` has no DOLFINx."""
    before = iteration(python, repeat)
    found: dict[str, list[dict]] = {name: [] for name in PROBLEMS}
    for number in range(rounds):
        for name, changes in PROBLEMS.items():
            (ours,) = timed([job("gelatin", depth_mm, **changes)])
            after = iteration(python, repeat)
            ms = (before["ms"] + after["ms"]) / 2
            ours |= {"peer_ms": ms, "times": ITERATIONS * ms / 1000 / ours["cpu_s"] * depth_mm / DEPTH_MM}
            found[name].append(ours)
            print(
                f"{name}, round {number + 1}: {ITERATIONS} iterations of {ms:.2f} ms"
                f" = {ITERATIONS * ms / 1000:.1f} s ({before['dofs']} unknowns) against {ours['cpu_s']:.2f} s"
                f" ({ours['unknowns']} unknowns): {ours['times']:.1f} times",
                flush=True,
            )
            before = after
    problems = []
    for name, runs in found.items():
        ratio = statistics.median(r["times"] for r in runs)
        problems.append({**fastest(runs), "problem": name, "times": ratio})
    ms = statistics.median(r["peer_ms"] for runs in found.values() for r in runs)
    return {
        "measured": {"ms_per_iteration": ms, "unknowns": before["dofs"], "dolfinx": before["dolfinx"]},
        "taken_as_given": {"iterations": ITERATIONS},
        "peer_s": ITERATIONS * ms / 1000,
        "depth_mm": depth_mm,
        "problems": problems,
    }


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peer", description="Beside DOLFINx, by turns."
    )
    parser.add_argument("--python", default=PYTHON, metavar="EXE", help="one that has DOLFINx")
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N")
    parser.add_argument("--quick", action="store_true", help="0.3 mm of travel: a check, no measurement")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    if asked.rounds < 1:
        parser.error(f"--rounds = {asked.rounds} cannot be used; expected a whole number, 1 or more")
    check_json(parser, asked.json)
    try:
        found = measured(asked.python, asked.rounds, *((0.3, 20) if asked.quick else ()))
    except (OSError, RuntimeError) as error:
        print(f"--python = '{asked.python}': {error}; expected one that has DOLFINx 0.5", file=sys.stderr)
        return 2
    for r in found["problems"]:
        print(f"{r['problem']}: median of {asked.rounds}: {r['times']:.1f} times")
    if asked.json is not None:
        write_json({**here(), "machine": facts(), "quick": asked.quick, "peer": found}, asked.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
