"""``python -m benchmarks [--against COMMIT] [--all [--write]] [--quick] [--json FILE]``: what a run costs.

Each material at the defaults, in CPU seconds, beside its limit: the time in factorization and solution of the
iterations made. ``--against``: the same runs in an older commit, by turns, each in a process of its own with
one thread and this interpreter. ``--all``: beside an older commit, beside the peer (``benchmarks.peer``), and
runs to the transition (``benchmarks.transition``); ``--write`` puts it into the documentation's table
(``benchmarks.page``), from a tree without changes. Exit status 1 if a run fell short, 2 for bad input.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from benchmarks import page, peer, transition
from benchmarks.tools import ROOT, check_json, facts, fastest, files_of, here, job, known, table, timed
from cutbench.base.files import write_json

MATERIALS = ("gelatin", "elastomer", "meat")
DEPTH_MM, QUICK_MM = 7.0, 0.5
#: The commit that ``--all`` is held against.
OLDER = "dc2113e"

_COLUMNS = (
    "run", "commit", "mm", "unknowns", "CPU s", "steps", "given up", "iterations", "factor.", "window",
    "limit %", "onset mm", "peak N", "drop", "closure", "peak MB",
)  # fmt: skip


def side_by_side(name: str, depth_mm: float, rounds: int, older: Path | None) -> dict:
    """A material here and, where its files are given, in the older commit, by turns. RuntimeError where a
    process crashes."""
    trees = {"here": ROOT} if older is None else {"older": older, "here": ROOT}
    found: dict[str, list[dict]] = {side: [] for side in trees}
    for _ in range(rounds):
        for side, tree in trees.items():
            print(f"{name}, {side} ...", file=sys.stderr, flush=True)
            found[side] += timed([job(name, depth_mm)], tree)
    best = {side: fastest(records) for side, records in found.items()}
    return {"run": name, "here": best["here"], "older": best.get("older")}


def row(name: str, commit: str, r: dict) -> list[str]:
    """A record as the table shows it."""

    def shown(key: str, form: str, factor: float = 1.0) -> str:
        return "-" if r[key] is None else format(factor * r[key], form)

    return [
        name, commit, shown("reached_mm", "g"), shown("unknowns", "d", 1), shown("cpu_s", ".2f"),
        *(shown(key, "d", 1) for key in ("steps", "rejected_steps", "iterations", "factorization_calls",
                                         "window_factorization_calls")),
        shown("limit", ".0f", 100), shown("onset_mm", ".3f"), shown("peak_N", ".4g"),
        shown("drop_rel", ".3f"), shown("closure", ".1e"), shown("peak_MB", ".0f"),
    ]  # fmt: skip


def options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Time runs on this machine.")
    parser.add_argument("--against", metavar="COMMIT", help=f"an older commit; --all takes {OLDER}")
    parser.add_argument("--materials", default=",".join(MATERIALS), help="by name, with commas between")
    parser.add_argument(
        "--depth", type=float, default=DEPTH_MM, metavar="MM", help="blade travel (default 7)"
    )
    parser.add_argument("--rounds", type=int, default=1, metavar="N", help="the fastest of N counts")
    parser.add_argument("--all", action="store_true", help="the peer and runs to the transition, too")
    parser.add_argument("--points", type=int, default=transition.POINTS, metavar="N", help="of those runs")
    parser.add_argument("--python", default=peer.PYTHON, metavar="EXE", help="one that has DOLFINx")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_MM:g} mm: a check, no measurement")
    parser.add_argument("--write", action="store_true", help="put what --all finds into the documentation")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything there, too")
    asked = parser.parse_args(argv)
    asked.materials = [name for name in asked.materials.split(",") if name]
    wrong = set(asked.materials) - set(MATERIALS)
    if wrong or not asked.materials:
        value = ", ".join(sorted(wrong))
        parser.error(f"--materials '{value}' cannot be used; expected some of {', '.join(MATERIALS)}")
    for name, low in (("rounds", 1), ("points", 1)):
        if getattr(asked, name) < low:
            parser.error(
                f"--{name} = {getattr(asked, name)} cannot be used; expected a whole number, 1 or more"
            )
    if not asked.depth > 0:
        parser.error(f"--depth = {asked.depth:g} cannot be used; expected more than 0 mm")
    if asked.write and (not asked.all or asked.quick):
        parser.error("--write cannot be used like this; expected --all beside it, and no --quick")
    if asked.write and here()["changed"] is not False:
        parser.error(
            "--write cannot be used here; expected a git clone without changes, so that a commit names it"
        )
    check_json(parser, asked.json)
    if asked.all and asked.against is None:
        asked.against = OLDER
    asked.older = None if asked.against is None else known(parser, "--against", asked.against)
    return asked


def main(argv: Sequence[str] | None = None) -> int:
    asked = options(argv)
    depth = QUICK_MM if asked.quick else asked.depth
    command = "python -m benchmarks " + " ".join(sys.argv[1:] if argv is None else argv)
    found = {
        **here(), "command": command.strip(), "quick": asked.quick, "machine": facts(), "depth_mm": depth,
        "older": asked.older, "runs": [],
    }  # fmt: skip
    crashed = []
    with nullcontext() if asked.older is None else files_of(asked.older) as older:
        for name in asked.materials:
            try:
                found["runs"].append(side_by_side(name, depth, asked.rounds, older))
            except RuntimeError as error:
                crashed.append(f"{name}: {error}")
    rows = []
    for r in found["runs"]:
        rows += [row(r["run"], page.short(asked.older), r["older"])] if r["older"] else []
        rows.append(row(r["run"], "here", r["here"]))
    print(page.machine(found["machine"]))
    print(table(rows, _COLUMNS))
    print(
        "CPU s: of the run alone, in one thread; limit: the part of it in factorization and solution;"
        " factor., window: factorizations\nof the whole body, and of the elements around the front."
    )
    for r in found["runs"]:
        limit = r["here"]["limit"]
        text = f"{r['run']}: {1 / limit:.2f} times its limit" if limit else r["run"]
        if r["older"]:
            times = r["older"]["cpu_s"] / r["here"]["cpu_s"]
            text += f"; {page.short(asked.older)} takes {times:.2f} times as long"
        print(text)
    if asked.all:
        few = (1, 0.3, 20) if asked.quick else (max(asked.rounds, peer.ROUNDS),)
        try:
            found["peer"] = peer.measured(asked.python, *few)
        except (OSError, RuntimeError) as error:
            crashed.append(f"--python = '{asked.python}': {error}; expected one that has DOLFINx 0.5")
        peer_s = found["peer"]["peer_s"] if "peer" in found else None
        try:
            changes = {"depth": "0.3 mm"} if asked.quick else {}
            found["transition"] = transition.measured(asked.points, 1, peer_s, **changes)
            print(transition.told(found["transition"]))
        except RuntimeError as error:
            crashed.append(f"transition: {error}")
    sides = [r[side] for r in found["runs"] for side in ("here", "older") if r[side]]
    short = [f"{r['material']}: {r['message']}" for r in sides if r["outcome"] != "done"]
    for line in (*crashed, *short):
        print(line, file=sys.stderr)
    if asked.json is not None:
        write_json({**found, "crashed": crashed}, asked.json)
    if asked.write and not crashed:
        print(f"written: {', '.join(page.write(found))}")
    return 1 if crashed or short else 0


if __name__ == "__main__":
    sys.exit(main())
