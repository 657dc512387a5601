"""Kill a sweep's workers and the sweep itself at random moments: what is lost, what is done twice?

    python -m benchmarks.kills --kills 10 --seed 0 --json FILE

A map of real, coarse runs is computed once in peace. Then once more, while processes of the sweep, its
workers as often as itself, are killed with SIGKILL at random moments; a sweep that was killed is started
again. Exit status 1 if a finished run is lost or written a second time, or if the two maps differ.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.tools import check_json, facts
from cutbench.base.files import write_json

STUDY = """title = "To be killed"
base = "gelatin"

[protocol]
depth = "3.5 mm"

[numerics]
h = "0.8 mm"
element = "P1"
energy_step = 0.1

[[axis]]
name = "cohesion"
from = 1.0
to = 10.0
scale = "log"
points = 6

[[axis]]
name = "viscosity"
from = 0.1
to = 2.0
scale = "log"
points = 5
"""


def start(study: Path, out: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "cutbench", "sweep", str(study), "--out", str(out), "--workers", "2"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


#: How a sweep of a study into a folder begins.
Begin = Callable[[Path, Path], subprocess.Popen]


def workers_of(pid: int) -> list[int]:
    """Processes below ``pid`` that compute (multiprocessing's tracker is left alone)."""
    below, found = [pid], []
    while below:
        task = Path(f"/proc/{below.pop()}/task")
        for children in task.glob("*/children"):
            for child in map(int, children.read_text().split()):
                below.append(child)
                words = Path(f"/proc/{child}/cmdline").read_bytes()
                if b"spawn_main" in words:
                    found.append(child)
    return found


def entries(out: Path) -> dict[str, tuple[int, int]]:
    """Finished runs: id -> inode and time of its record."""
    found = {}
    for record in out.glob("runs/??/*/run.json"):
        about = record.stat()
        found[record.parent.name] = (about.st_ino, about.st_mtime_ns)
    return found


def disturbed(
    study: Path, out: Path, kills: int, chance: random.Random, pause: float, begin: Begin = start
) -> dict:
    """Kill ``kills`` times, about every ``pause`` seconds; then let it end."""
    killed = {"sweep": 0, "worker": 0}
    finished: dict[str, tuple[int, int]] = {}
    rewritten, lost = set(), set()

    def compare():
        now = entries(out)
        lost.update(finished.keys() - now.keys())
        rewritten.update(k for k in finished.keys() & now.keys() if finished[k] != now[k])
        finished.update(now)

    process = begin(study, out)
    while sum(killed.values()) < kills:
        time.sleep(chance.uniform(0.3, 2 * pause))
        compare()
        if process.poll() is not None:
            break  # it ended before all kills were done
        below = workers_of(process.pid)
        if below and chance.random() < 0.5:
            target, kind = chance.choice(below), "worker"
        else:
            target, kind = process.pid, "sweep"
        os.kill(target, signal.SIGKILL)
        killed[kind] += 1
        if kind == "sweep":
            process.wait()
            compare()
            process = begin(study, out)
    code = process.wait()
    compare()
    return {
        "killed": killed,
        "exit": code,
        "runs": len(finished),
        "lost": len(lost),
        "written_twice": len(rewritten),
    }


def main(argv: list[str] | None = None, text: str = STUDY, begin: Begin = start) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kills", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pause", type=float, default=8.0, help="mean seconds between kills (default 8)")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args(argv)
    check_json(parser, asked.json)
    if not Path("/proc/self/task").exists():
        print("needs /proc to find the workers (Linux)", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study.toml"
        study.write_text(text, encoding="utf-8")
        peace, war = Path(folder) / "peace", Path(folder) / "war"
        begin(study, peace).wait()
        found = disturbed(study, war, asked.kills, random.Random(asked.seed), asked.pause, begin)
        found["same_map"] = (peace / "map.csv").read_bytes() == (war / "map.csv").read_bytes()
        found["all_runs"] = len(entries(peace))
    good = (
        found["same_map"]
        and not found["lost"]
        and not found["written_twice"]
        and found["exit"] == 0
        and found["runs"] == found["all_runs"]
    )
    kills = ", ".join(f"{n} of {kind}" for kind, n in found["killed"].items())
    maps = "the same map" if found["same_map"] else "another map"
    print(f"kills: {kills}; runs {found['runs']} of {found['all_runs']}")
    print(f"lost {found['lost']}; written twice {found['written_twice']}; {maps}")
    if asked.json:
        record = {"schema": 1, "seed": asked.seed, **found, "machine": facts()}
        write_json(record, asked.json)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
