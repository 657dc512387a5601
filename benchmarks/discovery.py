"""``python -m benchmarks.discovery --cases N --seed S [--kinds homogeneous,cut]``: blind discovery.

Campaigns with a hidden effect are made up (``benchmarks.hidden``). The search sees the campaign only; its
answer is then held against what was hidden. Of N cases about a sixth hide nothing and a tenth an effect that
no candidate has (a force that swings, a jump half way, a slow softening). An effect that the baseline's free
parameters take up, or the scatter between specimens hides, cannot be seen in the fitted tests: such cases are
counted beside the others too. Prints a confusion matrix; ``--json FILE`` keeps everything, and goes on from
there when called again. ``--outside``: causes by formulas that the package has not (``benchmarks.outside``),
in tension; ``--wider`` with it: in compression and shear, too, with more that can be wrong beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import outside_answers
from benchmarks.hidden import FAMILIES, OUTSIDE, SCATTER, VISIBLE, Hidden, make
from cutbench.base.errors import CutbenchError
from cutbench.base.files import write_json
from cutbench.base.progress import silent
from cutbench.calibration.fitting import fit
from cutbench.calibration.prediction import predictor
from cutbench.data.experiment import Experiment
from cutbench.discovery import Discovery, discover
from cutbench.discovery.point import Point, point_of

#: What is left of an effect in the fitted tests counts as shown by so many standard deviations: chance among
#: all candidates takes some three of them.
SHOWN = 5.0


def left_over(point: Point, clean: Mapping[str, tuple]) -> float:
    """What the free parameters of the baseline cannot take up of the clean train curves, in standard
    deviations of all readings together: by their derivatives at ``point``, where it was fitted."""
    train = {e.id: _truth(point, e, clean) - point.y[e.id] for e in point.campaign.train}
    r, J = point.w.noise.white(train), point.w.noise.white(point.J)
    size = np.linalg.norm(J, axis=0)
    J = J / np.where(size > 0, size, 1)
    return float(np.linalg.norm(r - J @ np.linalg.lstsq(J, r, rcond=1e-9)[0]))


def _truth(point: Point, e: Experiment, clean: Mapping[str, tuple]) -> np.ndarray:
    """The clean curve (m,) where the readings of ``e`` are compared."""
    grid, (x, y, t) = point.inverse.grids[e.id], clean[e.id]
    return np.interp(grid.x, x, y) if e.monotone else np.interp(grid.time_s, t, y)


def held_out_errors(pairs: Sequence[tuple[Point, Mapping[str, tuple]]]) -> list[float]:
    """Relative squared error of each point's prediction of the test experiments that all of them predict (of
    the fitted ones, where there are none) against its clean curves, the mean of each summed."""
    first = pairs[0][0].campaign
    tests = [e for e in first.test if all(e.id in point.tests for point, _ in pairs)]

    def error(point: Point, clean: Mapping[str, tuple]) -> float:
        total = 0.0
        for e in tests or first.train:
            y, true = (point.tests if tests else point.y)[e.id], _truth(point, e, clean)
            total += ((y - true) ** 2).mean() / np.abs(true).max() ** 2
        return float(total)

    return [error(*pair) for pair in pairs]


def uneventful(hidden: Hidden, d: Discovery, workers: int = 0) -> Point:
    """The baseline fitted to the same specimens and noise with nothing hidden: how far off it is then is
    none of the effect's doing."""
    fitted = fit(replace(d.campaign, experiments=hidden.without.experiments), workers=workers)
    with predictor(workers) as run:
        return point_of(fitted, run)


def judge(hidden: Hidden, d: Discovery, workers: int = 0) -> dict:
    """What the search said, beside what was hidden."""
    first = d.rounds[0]
    named = d.found[0] if d.found else (first.tried[0].name if first.tried else None)
    group = list(first.group)
    right = hidden.effect in (d.found[:1] or ()) or (bool(d.found) and hidden.effect in group)
    cut = caused = None
    if d.found:
        without = uneventful(hidden, d, workers)
        before, after, anyway = held_out_errors(
            [(d.first, hidden.clean), (d.final, hidden.clean), (without, hidden.plain)]
        )
        cut = 1 - after / max(before, 1e-30)
        # Where chance alone is off by as much, the effect caused no error that could be cut.
        caused = (before - after) / (before - anyway) if before > anyway else None
    return {
        "case": hidden.number, "effect": hidden.effect, "family": hidden.family, "design": hidden.design,
        "change": hidden.change, "left_over": left_over(d.first, hidden.clean), "values": hidden.values,
        "verdict": d.verdict, "found": list(d.found), "named_first": named, "group": group, "right": right,
        "seconds": d.seconds, "heldout_error_cut": cut, "of_what_the_effect_caused": caused,
        "p_residual": first.scores.p_residual,
        "best": [{"name": t.name, "p_any": t.p_any, "share": t.share, "behind": t.behind, "se": t.behind_se,
                  "better": t.heldout.better, "better_se": t.heldout.better_se, "gain": t.heldout.gain}
                 for t in first.tried[:4]],
    }  # fmt: skip


def plan(cases: int, seed: int, kinds: Sequence[str]) -> list[tuple[str, str, bool]]:
    """Effect, family and whether several conditions, of each case."""
    rng = np.random.default_rng(seed)
    nothing, alien = max(1, round(cases * 12 / 80)), max(1, round(cases * 8 / 80))
    pools = {
        "homogeneous": [(e, f) for f in ("bulk", "cut law", "blade law") for e in FAMILIES[f]],
        "cut": [(e, "cut") for e in FAMILIES["cut"]],
    }
    pool = [pair for kind in kinds for pair in pools[kind]]
    families = [f for f in ("bulk", "cut law", "blade law") if "homogeneous" in kinds]
    families += ["cut"] if "cut" in kinds else []
    made = [
        (*pool[i % len(pool)], bool((i // len(pool) + i % len(pool)) % 2))
        for i in range(cases - nothing - alien)
    ]
    made += [("none", families[i % len(families)], bool((i // 2) % 2)) for i in range(nothing)]
    made += [(OUTSIDE[i % 3], families[i % len(families)], bool((i // 2) % 2)) for i in range(alien)]
    return [made[i] for i in rng.permutation(len(made))]


def confusion(rows: Sequence[dict]) -> str:
    truths = sorted({r["effect"] for r in rows})
    said = sorted({_said(r) for r in rows})
    table = Counter((r["effect"], _said(r)) for r in rows)
    width = max(map(len, truths)) + 2
    lines = [" " * width + "  ".join(said)]
    for t in truths:
        lines.append(t.ljust(width) + "  ".join(str(table[t, s] or ".").rjust(len(s)) for s in said))
    return "\n".join(lines)


def _said(r: dict) -> str:
    return r["found"][0] if r["found"] and r["verdict"] == "mechanism" else r["verdict"]


def summary(rows: Sequence[dict]) -> dict:
    hidden = [r for r in rows if r["effect"] not in (*OUTSIDE, "none")]
    seen = [r for r in hidden if r["change"] > VISIBLE * SCATTER]
    shown = [r for r in seen if r["left_over"] > SHOWN]
    lost = [r for r in seen if r["left_over"] <= SHOWN]
    nothing = [r for r in rows if r["effect"] == "none"]
    alien = [r for r in rows if r["effect"] in OUTSIDE]
    right = [r for r in seen if r["right"]]

    def part(some, test) -> str:
        return f"{sum(map(test, some))} of {len(some)}"

    return {
        "true cause first or in the first group, of changes by more than twice the scatter":
            part(seen, lambda r: r["right"]),
        f"the same, where the baseline's free parameters leave more than {SHOWN:g} standard deviations":
            part(shown, lambda r: r["right"]),
        "found or nothing named, where they leave less": part(lost, lambda r: r["right"] or not r["found"]),
        "another cause named": part(hidden, lambda r: bool(r["found"]) and not r["right"]),
        "a cause named where there is none": part(nothing, lambda r: bool(r["found"])),
        "'none' where there is none": part(nothing, lambda r: r["verdict"] == "none"),
        "'unexplained' for outside effects": part(alien, lambda r: r["verdict"] == "unexplained"),
        "held-out squared error cut by 80 % or more where the cause was found":
            part(right, lambda r: r["heldout_error_cut"] >= 0.8),
        "the same of the error that the effect caused":
            part([r for r in right if r["of_what_the_effect_caused"] is not None],
                 lambda r: r["of_what_the_effect_caused"] >= 0.8),
        "seconds a case, median and largest": f"{np.median([r['seconds'] for r in rows]):.1f},"
            f" {max(r['seconds'] for r in rows):.1f}",
    }  # fmt: skip


def _asked(args) -> dict:
    return {"cases": args.cases, "seed": args.seed, "kinds": args.kinds}


def _known(args) -> list[dict]:
    """Cases that an earlier call with the same plan has done."""
    if args.json is None or not args.json.exists():
        return []
    data = json.loads(args.json.read_text())
    return data["rows"] if {k: data[k] for k in _asked(args)} == _asked(args) else []


def _told(done: float, total: float, text: str) -> None:
    print(f"    {text}", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.discovery", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default="homogeneous")
    parser.add_argument("--outside", action="store_true", help="causes by formulas that the package has not")
    parser.add_argument("--wider", action="store_true", help="with --outside: also compressed and sheared")
    parser.add_argument("--only", help="one effect")
    parser.add_argument("--case", type=int, help="the case of this number alone")
    parser.add_argument("--workers", type=int, default=0, help="processes of a search; default: this one")
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds after which no case begins")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--told", action="store_true", help="show what the search does")
    args = parser.parse_args(arguments)
    if args.outside:
        return outside_answers.run(args.cases, args.seed, args.json, args.case, args.limit, args.wider)
    rows, began = _known(args), time.perf_counter()
    for number, (effect, family, many) in enumerate(plan(args.cases, args.seed, args.kinds.split(","))):
        asked = args.only in (None, effect) and args.case in (None, number)
        if not asked or number in [r["case"] for r in rows]:
            continue
        if time.perf_counter() - began > args.limit:
            break
        hidden = make(number, effect, family, many, args.seed)
        try:
            found = discover(
                hidden.campaign, workers=args.workers, on_progress=_told if args.told else silent
            )
            rows.append(judge(hidden, found, args.workers))
        except CutbenchError as error:
            print(f"{number} {effect}: {error}", flush=True)
            continue
        r = rows[-1]
        print(
            f"{number:3d} {effect:20s} {family:9s} {hidden.design:18s} change {hidden.change:.2f}"
            f" ({r['left_over']:.0f} sd)  {r['verdict']:11s} {','.join(r['found']):22s} group {r['group']}"
            f" {'right' if r['right'] else ''} cut {r['heldout_error_cut']} {r['of_what_the_effect_caused']}"
            f" {r['seconds']:.0f} s",
            flush=True,
        )
        if args.json:
            write_json({**_asked(args), "rows": rows}, args.json)
    print(confusion(rows))
    figures = summary(rows)
    for key, value in figures.items():
        print(f"{key}: {value}")
    if args.json:
        write_json({**_asked(args), "summary": figures, "rows": rows}, args.json)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
