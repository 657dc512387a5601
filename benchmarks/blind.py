"""``python -m benchmarks.blind FAMILY --cases N --seed S --out FOLDER``: blind discovery.

Campaigns with a hidden cause are made up (``benchmarks.blind_campaigns``) and written as files. The search
reads those and nothing else; its answer is then held against what was hidden. FAMILY is ``homogeneous``,
``cut``, ``mixed``, ``measures`` or ``fibres``. The folder keeps every row, the runs of each search and the
computed truths, and the table; the same command goes on from it, at the same commit only. The seeds in
``DEVELOPMENT`` are for working on a method; a result comes from a seed that nobody has run before. Exit
status 2 for bad input.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind_campaigns import FAMILIES, SHOWN, Truth, make, plan
from benchmarks.stand_in import StandIn
from benchmarks.tools import facts, here
from cutbench.base.errors import BadInput, ComputationFailed, CutbenchError
from cutbench.base.files import markdown_table, write_json, write_text
from cutbench.base.progress import silent
from cutbench.base.units import parse_quantity
from cutbench.calibration.cut_runs import CutRuns
from cutbench.data.campaign import load_campaign
from cutbench.data.repetition import Averaged
from cutbench.discovery import Discovery, discover
from cutbench.discovery.candidates import cause_of, family_of
from cutbench.run.pool.pool import TaskPool

#: Seeds for working on a method. What they give is no result.
DEVELOPMENT = (1, 2, 3, 5, 11)
#: What an effect must leave, in standard deviations of all readings, before anybody could name it.
SURE = 5.0


@dataclass(frozen=True)
class Answer:
    """What a search said, whoever searched. ``groups``: by cause, the names that the data cannot tell from
    it. ``stated``: the gain on curves without noise, its lower and its upper end. ``intervals``:
    by parameter of the baseline, the ends of its 95 % interval, internal units. ``grids``, ``before``,
    ``after``: by predicted test its readings, and the ordinates (m,) of the baseline and the final model."""

    verdict: str
    found: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    stated: tuple[float, float, float] | None
    grids: Mapping[str, Averaged]
    before: Mapping[str, np.ndarray]
    after: Mapping[str, np.ndarray]
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, d: Discovery) -> Answer:
        grids, before, after = {}, {}, {}
        for e in d.campaign.test:
            try:
                pair = [fitted.predicted(e).y for fitted in (d.first, d.final) if fitted is not None]
            except ComputationFailed:
                continue
            if len(pair) == 2:
                before[e.id], after[e.id] = pair
                grids[e.id] = d.first.posterior.predictions.grids[e.id]
        stated = (d.noise_free.value, d.noise_free.low, d.noise_free.high) if d.noise_free else None
        intervals = {e.label: (e.low, e.high) for e in d.fit.estimates}
        groups = tuple(f.group for f in d.found)
        return cls(d.verdict, d.names, groups, stated, grids, before, after, intervals)


def judge(truth: Truth, a: Answer) -> dict:
    """What was said, beside what was hidden.

    Right is the class of one of the causes first or in the group of the first; wrong is a class that was
    named and is not there, also in its group. Where nothing is hidden in cuts but other numerics, a fixed
    value or a numerical cause is no wrong answer.
    """
    planned = truth.planned
    hidden = {name for names in planned.classes for name in names}
    groups = [{family_of(n) for n in group} for group in a.groups]
    named: set[str] = set().union(*groups) if groups else set()
    excused = planned.family not in ("homogeneous", "fibres") and planned.sort == "none"
    wrong = [
        family_of(n) for n, group in zip(a.found, groups, strict=False)
        if not group & hidden and not (excused and cause_of(n) in ("parameter", "numerical"))
    ]  # fmt: skip
    right = {
        "none": a.verdict == "none" or not wrong,
        "alien": a.verdict in ("unexplained", "undecided") and not a.found,
    }.get(planned.sort, bool(groups) and bool(groups[0] & hidden))
    return {
        "verdict": a.verdict, "found": list(a.found), "said": [family_of(n) for n in a.found],
        "right": right, "wrong": wrong,
        "both": planned.sort == "two" and all(named & {*names} for names in planned.classes),
        "stated_gain": a.stated and a.stated[0], "stated_between": a.stated and list(a.stated[1:]),
        "measured_gain": _gain(truth, a) if a.found else None,
        # Where something is hidden, the baseline's values are not the true ones.
        "values": {
            name: [truth.values[name], *ends] for name, ends in a.intervals.items()
            if name in truth.values and planned.sort == "none"
        },
    }  # fmt: skip


def _gain(truth: Truth, a: Answer) -> float | None:
    """Fall of the root mean square error against the clean curves of the predicted tests, each over its
    largest value; None without any."""
    errors = np.zeros(2)
    for id, grid in a.grids.items():
        t, x, y = truth.clean[id]
        true = np.interp(grid.x, x, y) if t is None else np.interp(grid.time_s, t, y)
        size = np.abs(true).max()
        errors += [np.mean((m[id] - true) ** 2) / size**2 for m in (a.before, a.after)]
    return float(1 - math.sqrt(errors[1] / errors[0])) if errors[0] > 0 else None


def searched(
    truth: Truth, folder: Path, workers: int, limit_s: float, on_progress: Callable, by_atlas: bool = False,
    stand_in: StandIn | None = None,
) -> dict:  # fmt: skip
    """One search, and its row of the table. A search that fails says nothing, which is not right."""
    p, began, cpu = truth.planned, time.perf_counter(), sum(os.times()[:4])
    about = {
        "case": p.number, "family": p.family, "effects": list(p.effects), "sort": p.sort, "how": list(p.how),
        "specimens": truth.specimens, "scatter": truth.scatter, "noise": truth.noise,
        "misfit": truth.misfit, "shown": truth.shown,
    }  # fmt: skip
    try:
        d = discover(
            load_campaign(truth.file), workers=workers, store=folder, limit_s=limit_s,
            on_progress=on_progress, by_atlas=by_atlas,
            runs=stand_in and CutRuns(TaskPool(0), compute=stand_in),
        )  # fmt: skip
        missed = d.steps[0].significant if d.steps else None
        said = {**judge(truth, Answer.of(d)), "missed": missed, "ended": d.stopped}
    except ComputationFailed as error:
        nothing = Answer("undecided", (), (), None, {}, {}, {})
        said = {**judge(truth, nothing), "missed": None, "ended": str(error)}
    return {
        **about, **said, "seconds": time.perf_counter() - began, "cpu_s": sum(os.times()[:4]) - cpu,
        "runs": stand_in.count if stand_in else len(list(folder.glob("??/*"))),
    }  # fmt: skip


# -- the table --------------------------------------------------------------------------------------
def summary(rows: Sequence[Mapping]) -> dict[str, str]:
    """The figures that the benchmark is for."""
    by = {sort: [r for r in rows if r["sort"] == sort] for sort in ("none", "one", "two", "alien")}
    seen = [r for r in by["one"] if r["misfit"] >= SHOWN[0]]
    sure = [r for r in seen if r["shown"] >= SURE]
    missed = [r for r in seen if r["missed"]]
    hidden = [r for r in seen if r["shown"] < SURE] + [r for r in by["one"] if r["misfit"] < SHOWN[0]]
    two = [r for r in by["two"] if r["misfit"] >= SHOWN[0]]
    stated = [r for r in rows if r["stated_gain"] is not None and r["measured_gain"] is not None]

    def part(some: Sequence, test: Callable[[Any], object]) -> str:
        return f"{sum(bool(test(r)) for r in some)} of {len(some)}"

    def spread(key: str, form: str) -> str:
        values = [r[key] for r in rows] or [math.nan]
        return f"{np.median(values):{form}}, {max(values):{form}}"

    return {
        "one cause: the right class first or in its group": part(seen, lambda r: r["right"]),
        f"the same, where it leaves more than {SURE:g} standard deviations": part(sure, lambda r: r["right"]),
        "the same, where the fitted baseline misses more than chance makes": part(
            missed, lambda r: r["right"]
        ),
        "right or nothing named, where it leaves less": part(hidden, lambda r: r["right"] or not r["found"]),
        "a class named that is not there": part(rows, lambda r: r["wrong"]),
        "nothing hidden: nothing named": part(by["none"], lambda r: r["right"]),
        "what no candidate has: nothing named": part(by["alien"], lambda r: r["right"]),
        "two causes: both named": part(two, lambda r: r["both"]),
        "two causes: one of them first or in its group": part(two, lambda r: r["right"]),
        "gain on clean predicted curves within the stated 90 % interval": part(
            stated, lambda r: r["stated_between"][0] <= r["measured_gain"] <= r["stated_between"][1]
        ),
        "nothing hidden: true values within their 95 % intervals": part(
            [v for r in rows for v in r["values"].values()], lambda v: v[1] <= v[0] <= v[2]
        ),
        "searches that ended early, or failed": part(rows, lambda r: r["ended"]),
        "runs, median and largest": spread("runs", ".0f"),
        "seconds a campaign, median and largest": spread("seconds", ".1f"),
        "CPU seconds, median and largest": spread("cpu_s", ".1f"),
    }


def page(kept: Mapping) -> str:
    """The table in Markdown, with the commit, the seed and every row."""
    at, rows = kept["at"], sorted(kept["rows"], key=lambda r: r["case"])
    lines = [
        f"# {kept['family']}, {len(rows)} of {kept['cases']} campaigns, seed {kept['seed']}", "",
        f"Commit `{at['commit']}`{' with changes' if at['changed'] else ''}, {kept['machine']['cpu']},"
        f" {kept['workers'] or 1} process(es), limit {kept['limit_s']:g} s."
        + " The seed is for development." * (kept["seed"] in DEVELOPMENT), "",
        *markdown_table(["", ""], summary(rows).items()), "",
        *markdown_table(
            ["case", "hidden", "how", "specimens", "misfit", "shown", "verdict", "found", "", "gain", "runs",
             "s"],
            [
                [r["case"], " + ".join(r["effects"]) or "nothing", ", ".join(r["how"]),
                 f"{r['specimens']} × {100 * r['scatter']:.0f} %", f"{r['misfit']:.1f}", f"{r['shown']:.0f}",
                 r["verdict"], ", ".join(r["found"]), _marks(r), _gains(r), r["runs"], f"{r['seconds']:.0f}"]
                for r in rows
            ],
        ),
    ]  # fmt: skip
    return "\n".join(lines)


def _marks(r: Mapping) -> str:
    marks = ["right"] * r["right"] + ["both"] * r["both"] + ["WRONG"] * bool(r["wrong"])
    return ", ".join([*marks, *(["ended early"] if r["ended"] else [])])


def _gains(r: Mapping) -> str:
    measured = "–" if r["measured_gain"] is None else f"{r['measured_gain']:.2f}"
    if r["stated_between"] is None:
        return measured
    low, high = r["stated_between"]
    return f"{measured} in {low:.2f} … {high:.2f}"


# -- the command ------------------------------------------------------------------------------------
def _shown_progress(done: float, total: float, text: str) -> None:
    print(f"    {text}", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__.splitlines()[0])
    parser.add_argument("family", choices=FAMILIES)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=DEVELOPMENT[0])
    parser.add_argument("--out", type=Path, required=True, help="what is kept, and gone on from")
    parser.add_argument("--case", type=int, help="the case of this number alone")
    parser.add_argument("--only", help="one effect")
    parser.add_argument("--workers", type=int, default=0, help="processes of a search; default: this one")
    parser.add_argument("--limit", default="10 h", help="how long a search may take, such as '30 min'")
    parser.add_argument("--within", default="1000 h", help="how long after the start a case may begin")
    parser.add_argument("--estimate", action="store_true", help="cuts of the atlas, and no runs")
    parser.add_argument("--stand-in", action="store_true", help="cuts of benchmarks.stand_in, and no runs")
    parser.add_argument("--progress", action="store_true", help="show what the search does")
    args = parser.parse_args(argv)
    try:
        limit_s, within_s = (parse_quantity(getattr(args, k), "s", key=f"--{k}") for k in ("limit", "within"))
    except BadInput as error:
        parser.error(str(error))
    asked = {
        "family": args.family, "cases": args.cases, "seed": args.seed, "limit_s": limit_s,
        "workers": args.workers, "at": here(), **({"by_atlas": True} if args.estimate else {}),
        **({"stand_in": True} if args.stand_in else {}),
    }  # fmt: skip
    args.out.mkdir(parents=True, exist_ok=True)
    file = args.out / f"{args.family}-{args.seed}.json"
    kept: dict = {**asked, "machine": facts(), "rows": []}
    if file.exists():
        old = json.loads(file.read_text(encoding="utf-8"))
        if {k: old.get(k) for k in asked} != asked:
            parser.error(f"--out: '{file}' is of another call or commit; expected another folder")
        kept = old
    show = _shown_progress if args.progress else silent
    began = time.perf_counter()
    for planned in plan(args.family, args.cases, args.seed):
        if args.case not in (None, planned.number) or (args.only and args.only not in planned.effects):
            continue
        if planned.number in [r["case"] for r in kept["rows"]]:
            continue
        if time.perf_counter() - began > within_s:
            break
        folder = args.out / f"{args.family}-{args.seed}" / f"{planned.number}"
        try:
            stand_in = StandIn(args.seed) if args.stand_in else None
            how = {"run": stand_in.run_case} if stand_in else {"truths": args.out / "truths"}
            truth = make(planned, args.seed, folder, **how)
            load_campaign(truth.file)
        except CutbenchError as error:  # what cannot be computed, or no reader would believe
            print(f"{planned.number:3d} {planned.effects} is not made: {error}", flush=True)
            continue
        r = searched(truth, folder / "runs", args.workers, limit_s, show, args.estimate, stand_in)
        kept["rows"].append(r)
        print(
            f"{planned.number:3d} {' + '.join(r['effects']) or 'nothing':32s} {', '.join(r['how']):30s}"
            f" {r['misfit']:5.1f} {r['shown']:5.0f} {r['verdict']:11s} {', '.join(r['found']):26s}"
            f" {_marks(r)} {_gains(r)} {r['runs']} runs {r['seconds']:.0f} s",
            flush=True,
        )
        write_json(kept, file)
        write_text(page(kept), file.with_suffix(".md"))
    for key, value in summary(kept["rows"]).items():
        print(f"{key}: {value}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
