"""``python -m benchmarks.edges [--refined] [--json FILE]``: sharp blades in soft solids, as real ones are.

Each material under a wedge of 20 degrees with edges of 50 and 20 µm, with the friction and adhesion that it
has, and gelatin and meat with a cohesion of 30 and 40, too, to 6 mm: CPU seconds, steps, closure, onset, peak
and drop. ``--refined``: each again with half of the elements' size, half of the steps and a third of the
damage that a step may do, and by how much that moves onset, peak (relative) and drop. Exit status 1 if one
falls short.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.tools import check_json, facts, here, job, table, timed
from cutbench.base.files import write_json
from cutbench.case.case import load_case

DEPTH_MM, ANGLE = 6.0, "20 deg"
EDGES = ("0.05 mm", "0.02 mm")
#: (G_c/δ_c)/G, beside the material's own, which is None.
COHESIONS: dict[str, tuple[float | None, ...]] = {
    "gelatin": (None, 30.0, 40.0), "elastomer": (None,), "meat": (None, 30.0, 40.0),
}  # fmt: skip
#: η v/δ_c where the cohesion is another: so low that a tough gel collapses.
VISCOSITY = {"gelatin": 0.05}
COLUMNS = ("material", "cohesion", "edge", "numerics", "CPU s", "steps", "given up", "closure", "onset mm",
           "peak N", "drop", "onset", "peak", "drop moved")  # fmt: skip


def refinements(material: str) -> dict[str, dict[str, object]]:
    """Changes of the numerics by name, the first of them none."""
    n = load_case(material).numerics
    finer = {"h": n.h / 2, "corner": n.corner / 2} if n.corner else {"h": n.h / 2}
    return {
        "defaults": {},
        "elements / 2": finer,
        "steps / 2": {"step": n.step / 2, "damage_step": n.damage_step / 2},
        "damage / 3": {"damage_step": n.damage_step / 3},
    }


def jobs(refined: bool) -> Iterator[dict]:
    """Runs, with their names."""
    for material, cohesions in COHESIONS.items():
        for edge in EDGES:
            for cohesion in cohesions:
                blade = {"with_": ["wedge"], "angle": ANGLE, "edge_radius": edge}
                own = {} if cohesion is None else {"cohesion": cohesion}
                if own and material in VISCOSITY:
                    own["viscosity"] = VISCOSITY[material]
                for name, changes in refinements(material).items():
                    if name == "defaults" or refined:
                        told = {"cohesion": cohesion, "edge": edge, "numerics": name}
                        yield {**job(material, DEPTH_MM, **blade, **own, **changes), "told": told}


def row(run: dict, base: dict) -> list[str]:
    """A record as the table shows it, beside that at the defaults."""

    def shown(key: str, form: str) -> str:
        return "–" if run[key] is None else format(run[key], form)

    def moved(key: str, relative: bool) -> str:
        if run is base or run[key] is None or base[key] is None:
            return ""
        change = run[key] - base[key]
        return f"{change / base[key]:+.1%}" if relative else f"{change:+.3f}"

    told = run["told"]
    cohesion = "own" if told["cohesion"] is None else f"{told['cohesion']:g}"
    return [
        run["material"], cohesion, told["edge"], told["numerics"], shown("cpu_s", ".1f"), shown("steps", "d"),
        shown("rejected_steps", "d"), shown("closure", ".1e"), shown("onset_mm", ".3f"),
        shown("peak_N", ".3f"), shown("drop_rel", ".3f"), moved("onset_mm", True), moved("peak_N", True),
        moved("drop_rel", False),
    ]  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.edges", description=__doc__.split("\n")[0])
    parser.add_argument("--refined", action="store_true", help="each with finer numerics, too")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    check_json(parser, asked.json)
    runs: list[dict] = []
    rows = []
    for run in timed(list(jobs(asked.refined))):
        runs.append(run)
        rows.append(row(run, next(r for r in reversed(runs) if r["told"]["numerics"] == "defaults")))
        print("  ".join(rows[-1]), run["message"], file=sys.stderr, flush=True)
    print(table(rows, COLUMNS, left=4))
    if asked.json is not None:
        write_json({**here(), "machine": facts(), "runs": runs}, asked.json)
    return 0 if all(run["outcome"] == "done" for run in runs) else 1


if __name__ == "__main__":
    sys.exit(main())
