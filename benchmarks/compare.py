"""``python -m benchmarks.compare OLD NEW [--only NAME ...] [--tolerance 1e-9] [--json FILE]``: what moved?

Two commits side by side. The files of each are put into a temporary folder, and the same jobs run in both by
the command line alone, so that neither's inner layout matters: one thread a process, old and new of a job at
a time. Every number of the tables and of the reports is compared, but for times, versions, ids and counts of
work. Differences of a curve are relative to the largest value of its unit, of other numbers to themselves.
A name that only the newer commit has is reported; one that it has no more counts as a difference. Exit status
0 if all is equal within the tolerance, 1 if not, 2 for bad input.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools import check_json, files_of, known, table
from cutbench.base.files import write_json
from cutbench.base.threads import ONE_THREAD

HOLD = """base = "gelatin"
[protocol]
depth = "4 mm"
motion = [["0 s", "0 mm"], ["190 s", "4 mm"], ["230 s", "4 mm"], ["270 s", "3.5 mm"]]
[numerics]
h = "0.7 mm"
"""

MAP = """title = "Eight points"
base = "gelatin"
[protocol]
depth = "10 mm"
[numerics]
energy_step = 0.1
corner = 0.125
shallow = 1
step = "0.2 mm"
h = "0.65 mm"
penalty = 11200
stick = 4480
[[axis]]
name = "cohesion"
values = [1.0, 12.5]
[[axis]]
name = "viscosity"
values = [0.01, 5.0]
[[axis]]
name = "adhesion"
values = [0.0, 0.187]
[plot]
x = "cohesion"
y = "viscosity"
panel = "adhesion"
"""

CAMPAIGN = """title = "Made up: a rubber that stiffens and relaxes"
baseline = ["neo_hookean", "volumetric"]
candidates = ["yeoh", "gent", "maxwell"]
[parameters]
G = "15 kPa"
nu = 0.4999
[fit]
free = ["G"]
"""

TEST = """[[experiment]]
id = "{0}"
kind = "uniaxial"
data = "{0}.csv"
columns = {{ time = "time", stretch = "stretch", stress = "stress", repetition = "specimen" }}
"""


def campaign() -> dict[str, str]:
    """The files of a campaign: slow and fast tension of two specimens each, with noise."""
    noise, files = np.random.default_rng(1), {"campaign.toml": CAMPAIGN}
    for name, rate in (("slow", 0.002), ("fast", 0.2)):
        rows = ["specimen,time [s],stretch,stress [kPa]"]
        for specimen, scale in (("A", 0.98), ("B", 1.02)):
            for x in np.linspace(1.02, 1.8, 40):
                t, strain = (x - 1) / rate, x - x**-2
                relaxed = 20 * scale * strain * (1 + 0.15 * (x - 1) ** 2)
                P = relaxed + 6 * strain * -math.expm1(-t / 2) * 2 / t + 0.05 * noise.standard_normal()
                rows.append(f"{specimen},{t:.5f},{x:.5f},{P:.5f}")
        files[f"{name}.csv"] = "\n".join(rows) + "\n"
        files["campaign.toml"] += TEST.format(name)
    return files


@dataclass(frozen=True)
class Job:
    """A command, the files that it reads, and those of its output that are compared."""

    name: str
    command: str
    compared: tuple[str, ...] = ("curve.csv", "run.json")
    files: Mapping[str, str] = field(default_factory=dict)


#: Small enough for coarse elements, and weak enough to be cut within a minute.
BLOCK = "--set width='8 mm' --set length='3 mm' --set height='6 mm' --set cohesion=1.5"
JOBS = (
    Job("gelatin", "run2d gelatin --depth 5"),
    Job("elastomer", "run2d elastomer --depth 5"),
    Job("meat", "run2d meat --depth 5"),
    Job("map", "sweep map.toml --workers 1", ("map.csv",), {"map.toml": MAP}),
    Job("fit", "fit campaign.toml --workers 0", ("fit.json",), campaign()),
    Job("discovery", "discover campaign.toml --workers 0", ("discovery.json",), campaign()),
    Job("block", f"run3d gelatin --numerics tetrahedra --depth 1.3 --h 1 --no-plane-strain {BLOCK}"),
    Job("tension", "tension gelatin --notched --h 1 --elongation 7", ("curve.csv", "tension.json")),
    Job("hold", "run2d hold.toml", files={"hold.toml": HOLD}),
    Job("paper", "run2d gelatin --numerics paper --h 0.7 --depth 4"),
)

Numbers = dict[str, np.ndarray]

#: Parts of a report that say how it was computed, not what came out.
IGNORED = {
    "case", "computation", "counts", "id", "message", "numerics", "platform", "reproduce", "run_id", "schema",
    "seconds", "timings_s", "versions",
}  # fmt: skip
#: Numbers that are errors or chances themselves: relative to one, as they are relative already.
ERRORS = ("closure", "reaction_error", "chance")
#: What a curve whose numbers moved is told by, beside the numbers that moved.
MEASURES = ("onset_mm", "peak_N", "drop_rel", "steady_N", "max_N")


def environment(tree: Path) -> dict[str, str]:
    fixed = {"PYTHONPATH": str(tree), "PYTHONHASHSEED": "0", "MPLBACKEND": "Agg", "COLUMNS": "200"}
    return {**os.environ, **ONE_THREAD, **fixed}


def start(job: Job, tree: Path, folder: Path) -> subprocess.Popen:
    """The job's command with the package of ``tree``; what it says goes to ``said`` in ``folder``."""
    folder.mkdir(parents=True)
    for name, text in job.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "cutbench", *shlex.split(job.command), "--out", "out"]
    with (folder / "said").open("w") as said:
        return subprocess.Popen(command, cwd=folder, env=environment(tree), stdin=subprocess.DEVNULL,
                                stdout=said, stderr=said, start_new_session=True)  # fmt: skip


def finish(running: subprocess.Popen, folder: Path) -> dict:
    """Exit status, CPU seconds of the process and all that it started, and its last words if it failed."""
    _, status, used = os.wait4(running.pid, 0)
    running.returncode = os.waitstatus_to_exitcode(status)
    said = (folder / "said").read_text(encoding="utf-8", errors="replace").splitlines()
    words = [line.strip(" │") for line in said if any(map(str.isalnum, line))]  # without a frame
    last = words[-1] if running.returncode and words else ""
    return {"exit": running.returncode, "cpu_s": used.ru_utime + used.ru_stime, "said": last}


def numbers(path: Path) -> tuple[Numbers, dict[str, str]]:
    """By name, the arrays of numbers in a table or a report, and its words: labels, names of mechanisms."""
    found: Numbers = {}
    words: dict[str, str] = {}
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        for name in rows[0] if rows else ():
            cells = [row[name] for row in rows]
            try:
                found[name] = np.array([float(cell or "nan") for cell in cells])
            except ValueError:
                words[name] = ", ".join(cells)
    else:
        _flatten(json.loads(path.read_text(encoding="utf-8")), "", found, words)
    for name in [name for name in (*found, *words) if IGNORED & set(name.split("."))]:
        (found if name in found else words).pop(name)
    return found, words


def _flatten(value: object, name: str, found: Numbers, words: dict[str, str]) -> None:
    if isinstance(value, str) and " " not in value:  # more than a word is prose
        words[name] = value
    elif value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
        found[name] = np.array([value], dtype=float)
    elif isinstance(value, list) and value and all(type(v) in (int, float, type(None)) for v in value):
        found[name] = np.array(value, dtype=float)
    elif isinstance(value, (list, dict)):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            _flatten(part, f"{name}.{key}" if name else str(key), found, words)


def _unit(name: str) -> str:
    """What the numbers of one curve are measured against together: its forces, its works, its ways."""
    last = name.rsplit("_", 1)[-1]
    return last if last in ("N", "mJ", "mm", "s", "MPa") else name


def _largest(*arrays: np.ndarray) -> float:
    return max((float(np.nanmax(np.abs(a))) for a in arrays if np.isfinite(a).any()), default=0.0)


def _difference(a: np.ndarray, b: np.ndarray, scale: float) -> float:
    if a.shape != b.shape or not np.array_equal(np.isnan(a), np.isnan(b)):
        return math.inf
    apart = _largest(a - b)
    return apart / scale if apart else 0.0


def differences(old: Numbers, new: Numbers, curve: bool, tolerance: float) -> dict:
    """The largest relative difference and its name, and the names that only one of the two has."""
    note = ""
    if curve and "time_s" in old and "time_s" in new:
        t, s = old["time_s"], new["time_s"]
        if _difference(t, s, _largest(t, s)) > tolerance:
            note, both = f"other steps, {s.size} instead of {t.size}, compared in between", t <= s[-1]
            old = {name: a[both] for name, a in old.items()}
            new = {name: np.interp(t[both], s, b) for name, b in new.items()}
    group = _unit if curve else str
    scales: dict[str, float] = {}
    for name in (*old, *new):
        size = max(_largest(old.get(name, np.zeros(1)), new.get(name, np.zeros(1))), name.endswith(ERRORS))
        scales[group(name)] = max(scales.get(group(name), 0.0), size)
    apart = {name: _difference(old[name], new[name], scales[group(name)]) for name in old if name in new}
    gone = [name for name in old if name not in new and not np.isnan(old[name]).all()]
    apart |= dict.fromkeys(gone, math.inf)
    where = max(apart, key=apart.__getitem__, default="") if any(apart.values()) else ""
    return {
        "largest": apart.get(where, 0.0), "where": where, "compared": len(apart), "note": note,
        "above": sorted(name for name, d in apart.items() if not d <= tolerance),
        "only_old": gone, "only_new": sorted({*new} - {*old}),
    }  # fmt: skip


def compare(job: Job, trees: Sequence[Path], folder: Path, tolerance: float) -> dict:
    """Run a job with both packages at a time, and hold one outcome against the other."""
    folders = [folder / job.name / side for side in ("old", "new")]
    running: list[subprocess.Popen] = []
    try:
        for tree, at in zip(trees, folders, strict=True):
            running.append(start(job, tree, at))
        sides = [finish(process, at) for process, at in zip(running, folders, strict=True)]
    finally:
        for process in running:
            if process.returncode is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    found: dict[str, Any] = {"job": job.name, "command": job.command, "old": sides[0], "new": sides[1]}
    found |= {"files": {}, "words": [], "measures": {}}
    for name in job.compared:
        paths = [at / "out" / name for at in folders]
        missing = [side for side, path in zip(("old", "new"), paths, strict=True) if not path.is_file()]
        if missing:
            found["files"][name] = {"largest": math.inf, "where": f"no {name} ({', '.join(missing)})"}
            continue
        (a, words), (b, others) = (numbers(path) for path in paths)
        found["files"][name] = differences(a, b, name.endswith(".csv"), tolerance)
        found["words"] += [
            f"{name}: {key}: {words.get(key)} / {others.get(key)}"
            for key in sorted({*words, *others}) if words.get(key) != others.get(key)
        ]  # fmt: skip
        if name.endswith(".json"):
            values = [{n.rsplit(".", 1)[-1]: v for n, v in side.items()} for side in (a, b)]
            found["measures"] = {
                n: [float(v[n][0]) if n in v else None for v in values] for n in MEASURES if n in values[0]
            }
    worst = max(found["files"].values(), key=lambda f: f["largest"])
    same_rows = not any(f.get("note") for f in found["files"].values())
    same_end = sides[0]["exit"] == sides[1]["exit"]
    found["largest"], found["where"] = worst["largest"], worst["where"]
    found["equal"] = bool(worst["largest"] <= tolerance and same_rows and same_end)
    return found


def told(found: dict) -> Iterator[str]:
    """Lines below the table about a job: what failed, what has another name, what a curve says instead."""
    for side in ("old", "new"):
        if found[side]["exit"]:
            yield f"{side}: exit status {found[side]['exit']}: {found[side]['said']}"
    for name, f in found["files"].items():
        if f.get("note"):
            yield f"{name}: {f['note']}"
        if f.get("above"):
            yield f"{name}: {len(f['above'])} of {f['compared']} differ: {', '.join(f['above'][:8])}"
        for side in ("old", "new"):
            if f.get(f"only_{side}"):
                yield f"{name}: only {side}: {', '.join(f[f'only_{side}'][:8])}"
    yield from found["words"][:8]
    if not found["equal"]:
        for name, (a, b) in found["measures"].items():
            if a is not None and b is not None and a != b and not math.isnan(a):
                yield f"{name}: {a:.6g} -> {b:.6g} ({(b - a) / a if a else math.inf:+.2%})"


def options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m benchmarks.compare", description="Two commits side by side.")
    names = [job.name for job in JOBS]
    some = f"some of: {', '.join(names)}"
    parser.add_argument("old", help="a git revision")
    parser.add_argument("new", help="another")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=some)
    parser.add_argument("--tolerance", type=float, default=1e-9, help="largest relative difference")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything there, too")
    asked = parser.parse_args(argv)
    if not 0 <= asked.tolerance < math.inf:
        parser.error(f"--tolerance = {asked.tolerance} cannot be used; expected a number, 0 or more")
    for name in ("old", "new"):
        known(parser, name.upper(), getattr(asked, name))
    check_json(parser, asked.json)
    return asked


def main(argv: Sequence[str] | None = None, jobs: Sequence[Job] = JOBS) -> int:
    asked = options(argv)
    found = []
    with tempfile.TemporaryDirectory(prefix="compare-") as name:
        folder = Path(name)
        with files_of(asked.old) as old, files_of(asked.new) as new:
            for job in jobs:
                if asked.only is None or job.name in asked.only:
                    print(f"{job.name}: {job.command} ...", file=sys.stderr, flush=True)
                    found.append(compare(job, (old, new), folder / "jobs", asked.tolerance))
                    if asked.json is not None:
                        write_json({"old": asked.old, "new": asked.new, "jobs": found}, asked.json)
    rows = []
    for f in found:
        a, b = f["old"]["cpu_s"], f["new"]["cpu_s"]
        seconds = (f"{a:.1f}", f"{b:.1f}", f"{b / a:.2f}")
        rows.append([f["job"], "yes" if f["equal"] else "no", *seconds, f"{f['largest']:.1e}", f["where"]])
    print(table(rows, ("job", "equal", "old s", "new s", "new/old", "difference", "where")))
    for f in found:
        for line in told(f):
            print(f"{f['job']}: {line}")
    return 0 if all(f["equal"] for f in found) else 1


if __name__ == "__main__":
    sys.exit(main())
