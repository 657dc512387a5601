"""Which reading of the blade, or which mechanism beside the published ones, gives all that is published?

    python -m studies.paper.recalibrate --out DIR

The three campaigns of studies/published are fitted once for each of ``READINGS``, with all else equal: G_c
and the viscous time are free in all of them. Runs and fits are kept in DIR: the same command goes on.
``recalibrate.json`` has of each fit the evidence, the values, and each measure as it was measured and as it
is computed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from benchmarks.tools import here
from cutbench.base.errors import CutbenchError
from cutbench.base.files import write_json
from cutbench.base.report import Table
from cutbench.calibration.fitting import Fit, fit
from cutbench.calibration.report import to_dict
from cutbench.case.case import load_case
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show
from cutbench.data.campaign import Campaign, load_campaign

HERE = Path(__file__).parents[1] / "published"
MATERIALS = ("gelatin", "elastomer", "meat")
HEAD = ("material", "reading", "most probable", "computed (standard deviations off)", "log evidence")


@dataclass(frozen=True)
class Reading:
    """A reading of the experiments: what its case sets, what beside G_c and the viscous time a fit looks for,
    with bounds in internal units, and whether that begins from the published values."""

    name: str
    sets: Mapping[str, object]
    free: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    published: bool = False


def _drawn(name: str, law: str = "", **free: tuple[float, float]) -> Reading:
    """The paper's blade as it is drawn, with one more law or free parameter."""
    with_ = ["contact", law] if law else ["contact"]
    return Reading(f"ellipse as drawn, {name}", {"with_": with_, "tip": "1.05 mm"}, free, True)


#: The first is the paper's blade with a length of its own, the next are as utility blades are ground. The
#: others keep the ellipse as it is drawn and ask whether a mechanism does as well.
READINGS = (
    Reading("ellipse of another length", {"with_": "contact", "tip": "3 mm"}, {"tip": (0.35, 4.2)}, True),
    Reading("wedge 20°, edge 50 µm", {}),
    Reading("wedge 20°, edge 20 µm", {"edge_radius": "0.02 mm"}),
    Reading("wedge 30°, edge 50 µm", {"angle": "30 deg"}),
    _drawn("nothing else"),
    _drawn("stiff skin of 0.5 mm", "stiff_skin", skin_stiffness=(0.0, 20.0)),
    _drawn("tough skin of 0.5 mm", "tough_skin", skin_toughness=(0.0, 20.0)),
    _drawn("toughness by rate", "rate_toughness", rate_toughening=(0.0, 5.0)),
    _drawn("viscoelastic bulk, 20 s", "maxwell", g_1=(0.0, 10.0)),
    _drawn("strain stiffening", "fung", b_fung=(0.0, 5.0)),
    _drawn("opening of the cohesive zone", delta_c=(0.02, 0.5)),
    _drawn("surface length", surface_length=(0.01, 0.5)),
    _drawn("adhesion and friction", tau_W=(0.0, 0.05), mu=(0.0, 0.5)),
)


def under(campaign: Campaign, reading: Reading) -> Campaign:
    """The campaign as it is read."""
    plan = campaign.plan
    plan = replace(plan, free=(*(plan.free or ()), *reading.free), bounds={**plan.bounds, **reading.free})
    known = load_case(str(campaign.material)).shown()
    start = {name: known[name] for name in ("G_c", "eta_reg")} if reading.published else {}
    return replace(campaign, base=campaign.base.set(**reading.sets, **start), plan=plan)


def record(found: Fit, reading: Reading) -> dict:
    """What is kept of a fit."""
    whole = to_dict(found)
    kept = {key: whole[key] for key in ("status", "message", "parameters", "chi2")}
    tests = {id: e["measures"] for id, e in whole["experiments"].items()}
    evidence = None if found.estimated is None else float(found.estimated.log_evidence)
    return {"reading": reading.name, "log_evidence": evidence, "runs": found.runs, **kept, "tests": tests}


def cells(row: Mapping) -> tuple[str, ...]:
    """A row of the table: the values found, and what each fitted measure then is."""
    units = {name: "" if q["unit"] == "1" else f" {q['unit']}" for name, q in row["parameters"].items()}
    found = [f"{n} = {q['value']:.3g}{units[n]}" for n, q in row["parameters"].items()]
    said = []
    for m in row["tests"]["block"]:
        value = "none" if m["computed"] is None else f"{m['computed']:.3g}"
        unit = "" if m["unit"] == "1" else f" {m['unit']}"
        said.append(f"{m['measure']} {value}{unit} ({m['standard_deviations_off']:+.1f})")
    return row["material"], row["reading"], ", ".join(found), ", ".join(said), f"{row['log_evidence']:.1f}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m studies.paper.recalibrate", description=__doc__)
    parser.add_argument("--out", metavar="DIR", required=True, type=Path)
    parser.add_argument("--only", metavar="MATERIAL", choices=MATERIALS, action="append")
    parser.add_argument(
        "--reading", metavar="N", type=int, action="append", help="the N-th of READINGS, from 0"
    )
    parser.add_argument("--workers", metavar="N", type=int)
    asked = parser.parse_args()
    file = asked.out / "recalibrate.json"
    kept = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    try:
        for number in asked.reading if asked.reading is not None else range(len(READINGS)):
            for material in asked.only or MATERIALS:
                reading, key = READINGS[number], f"{material}, {READINGS[number].name}"
                if key in kept:
                    continue
                began = time.time()
                campaign = under(load_campaign(HERE / f"{material}.toml"), reading)
                with bar(key, "cuts") as on_progress:
                    found = fit(
                        campaign, workers=asked.workers, refine=False, store=asked.out / "runs",
                        on_progress=on_progress,
                    )  # fmt: skip
                if found.status in ("interrupted", "out of time"):
                    return 130
                how = {"material": material, **here(), "seconds": time.time() - began}
                kept[key] = how | record(found, reading)
                write_json(kept, file)
    except CutbenchError as error:
        print(f"studies.paper.recalibrate: {error}", file=sys.stderr)
        return getattr(error, "exit_code", 1)
    rows = [cells(row) for row in sorted(kept.values(), key=lambda row: MATERIALS.index(row["material"]))]
    show(Table(HEAD, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
