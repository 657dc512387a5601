"""Published experiments of cutting, computed beside what is published.

``python -m studies.gallery --out DIR``, from the project's folder, computes what DIR/runs lacks, and
writes DIR/experiments.json, DIR/experiments.md and pictures. Start it again to go on.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.files import replacing
from cutbench.base.report import Table
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show
from cutbench.run.measures import MAX_JUMPS
from cutbench.run.pool.batch import Batch
from cutbench.run.store.runs import Store
from studies.gallery.experiments import EXPERIMENTS
from studies.gallery.picture import pictures

HEADS = ("experiment", "what", "published", "computed", "")


def judged(results: dict) -> list[tuple[str, str, str, str, str]]:
    """A row a finding."""
    rows = []
    for experiment in EXPERIMENTS:
        found = {name: results[run.case.id] for name, run in experiment.runs.items()}
        for each in experiment.findings:
            value = each.value(found)
            kind = each.kind if each.low <= value <= each.high else "missed"
            text = "none" if math.isnan(value) else f"{value:.{each.digits}g}"
            rows.append((experiment.title, each.what, each.published, text, kind))
    return rows


def record(results: dict) -> list[dict]:
    """What each run is, how it ended and how well its energy closes."""
    return [
        {
            "experiment": experiment.title, "run": str(name), "id": run.case.id,
            "said": results[run.case.id].sentence(),
            "closure": results[run.case.id].measures["closure"],
            "jumps_rel": results[run.case.id].measures["jumps_rel"],
            "cpu_s": results[run.case.id].timings["total"],
        }
        for experiment in EXPERIMENTS
        for name, run in experiment.runs.items()
    ]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m studies.gallery", description=__doc__)
    parser.add_argument(
        "--out", metavar="DIR", required=True, type=Path, help="a folder for runs and results"
    )
    parser.add_argument("--workers", metavar="N", type=int, help="processes; default: one a core")
    asked = parser.parse_args()
    try:
        with bar("published experiments", "runs") as on_progress:
            batch = Batch(Store(asked.out / "runs"), workers=asked.workers, on_progress=on_progress)
            batch.go(run.case for experiment in EXPERIMENTS for run in experiment.runs.values())
    except BadInput as error:
        print(f"studies.gallery: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted: runs that ended are kept, the same command goes on", file=sys.stderr)
        return 130
    rows, runs = judged(batch.results), record(batch.results)
    lines = [f"| {' | '.join(row)} |" for row in (HEADS, ["---"] * len(HEADS), *rows)]
    for name, text in (
        ("experiments.md", "\n".join(lines) + "\n"),
        ("experiments.json", json.dumps(runs, indent=1) + "\n"),
    ):
        with replacing(asked.out / name) as path:
            path.write_text(text, encoding="utf-8")
    pictures(batch.results, asked.out)
    show(Table(HEADS, rows))
    doubtful = [run for run in runs if run["jumps_rel"] > MAX_JUMPS or abs(run["closure"]) > 0.01]
    for run in doubtful:
        print(
            f"{run['experiment']}, {run['run']}: closure {run['closure']:.2%}, jumps {run['jumps_rel']:.1%}"
        )
    print(f"{len(batch.results)} runs, {batch.computed} of them computed now; {asked.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
