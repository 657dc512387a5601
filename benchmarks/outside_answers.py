"""What discovery makes of campaigns by other formulas: ``python -m benchmarks.discovery --outside``."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.outside import SHOWN, Truth, make, plan
from cutbench.base.errors import CutbenchError
from cutbench.base.files import write_json
from cutbench.data.campaign import load_campaign
from cutbench.discovery import Discovery, discover
from cutbench.discovery.candidates import family_of
from cutbench.discovery.clean import NEAR
from cutbench.discovery.point import Point

#: The benchmark's classes by the package's.
_CLASSES = {
    "strain stiffening": "stiffening",
    "viscoelasticity": "viscoelasticity",
    "softening on unloading": "softening",
    "machine": "rig",
    "reading": "reading",
    "volume change": "volume",
    "nu": "volume",
}


def class_of(name: str) -> str:
    """The class of a cause that discovery names; the package's where it is none of the benchmark's."""
    return _CLASSES.get(family_of(name), family_of(name))


def judge(truth: Truth, d: Discovery) -> dict:
    """What was said, beside what was hidden."""
    said = [class_of(n) for n in d.found]
    groups = [{class_of(n) for n in r.group} | {class_of(r.accepted)} for r in d.rounds if r.accepted]
    named = set().union(*groups) if groups else set()
    wanted = truth.classes
    return {
        "case": truth.number, "effects": list(truth.effects), "classes": list(wanted),
        "modes": list(truth.modes), "misfit": truth.misfit,
        "repetitions": truth.repetitions, "scatter": truth.scatter, "noise": truth.noise,
        "verdict": d.verdict, "found": list(d.found), "said": said,
        "right": bool(wanted) and bool(groups) and bool(groups[0] & set(wanted)),
        "both": bool(wanted) and set(wanted) <= named,
        "wrong": [n for n, group in zip(said, groups, strict=False) if not group & set(wanted)],
        "stated_gain": d.clean and d.clean.value, "stated_between": d.clean and [d.clean.low, d.clean.high],
        "expected_near": d.clean and d.clean.near, "plain_gain": d.gain.gain if d.gain else None,
        "measured_gain": _gain(truth, d) if d.gain else None, "seconds": d.seconds,
    }  # fmt: skip


def _gain(truth: Truth, d: Discovery) -> float:
    """Fall of the root mean square error against the clean curves of the tests that were not fitted."""
    before, after = (_error(truth, point) for point in (d.first, d.final))
    return 1 - after / before


def _error(truth: Truth, point: Point) -> float:
    total, count = 0.0, 0
    for e in point.campaign.test:
        grid, (t, F) = point.inverse.grids[e.id], truth.clean[e.id]
        y, area = point.tests[e.id], e.area_mm2 or 1.0
        # Where the force only grows it is compared by displacement, and the clean one's time is as good.
        true = np.interp(grid.time_s, t, F) / area
        total, count = total + ((y - true) ** 2).sum(), count + y.size
    return float(np.sqrt(total / count))


def _near(r: Mapping) -> bool:
    return abs(r["stated_gain"] - r["measured_gain"]) < NEAR


def summary(rows: Sequence[Mapping]) -> dict[str, str]:
    """The figures that the benchmark is for, of effects that show."""

    def part(some: list, test) -> str:
        return f"{sum(map(bool, map(test, some)))} of {len(some)}"

    rows = [r for r in rows if not r["effects"] or r["misfit"] >= SHOWN[0]]
    one = [r for r in rows if len(r["effects"]) == 1]
    physics = [r for r in one if r["classes"][0] not in ("rig", "reading", "volume")]
    asked = [r for r in one if r not in physics]
    none, two = ([r for r in rows if len(r["effects"]) == n] for n in (0, 2))
    stated = [r for r in rows if r["stated_gain"] is not None]
    narrow = [r for r in stated if r["stated_between"][1] - r["stated_between"][0] <= 0.4]
    return {
        "one effect: the right class first or in its group": part(physics, lambda r: r["right"]),
        "a rig, a reading or a value that is wrong: named": part(asked, lambda r: r["right"]),
        "a class named that was not there": part(list(rows), lambda r: r["wrong"]),
        "'none' where there is none": part(none, lambda r: r["verdict"] == "none"),
        "two effects: both named": part(two, lambda r: r["both"]),
        "two effects: one of them first": part(two, lambda r: r["right"]),
        "'unexplained' or 'undecided' where there is an effect":
            part(one + two, lambda r: r["verdict"] in ("unexplained", "undecided")),
        "stated gain within 10 points of the one on clean held-out curves":
            part(stated, _near),
        "as many of these as the stated distributions expect":
            f"{sum(r['expected_near'] for r in stated):.1f} of {len(stated)}",
        "stated gain within 10 points, where the interval is no wider than 40": part(narrow, _near),
        "gain on clean held-out curves within the stated 90 % interval":
            part(stated, lambda r: r["stated_between"][0] <= r["measured_gain"] <= r["stated_between"][1]),
        "seconds a case, median and largest":
            f"{np.median([r['seconds'] for r in rows]):.1f}, {max(r['seconds'] for r in rows):.1f}",
    }  # fmt: skip


def run(
    cases: int, seed: int, kept: Path | None, only: int | None = None, limit: float = np.inf, wider=False
) -> int:
    """All campaigns, one after the other; ``kept`` goes on from where it was stopped."""
    asked = {"outside": True, "wider": wider, "cases": cases, "seed": seed}
    rows: list[dict] = []
    if kept is not None and kept.exists() and asked.items() <= (data := json.loads(kept.read_text())).items():
        rows = data["rows"]
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for number, effects in enumerate(plan(cases, seed, wider)):
            if only not in (None, number) or number in [r["case"] for r in rows]:
                continue
            if time.perf_counter() - began > limit:
                break
            truth = make(number, effects, seed, Path(folder) / str(number), wider)
            try:
                rows.append(judge(truth, discover(load_campaign(truth.file), workers=0)))
            except CutbenchError as error:
                print(f"{number:3d} {effects}: {error}", flush=True)
                continue
            r = rows[-1]
            print(
                f"{number:3d} {' + '.join(effects) or 'none':32s} {truth.repetitions} x {truth.scatter:.2f}"
                f" misfit {truth.misfit:5.1f}  {r['verdict']:11s} {','.join(r['found']):26s}"
                f" {'right' if r['right'] else ''}{' both' if r['both'] and len(effects) == 2 else ''}"
                f"{' WRONG ' + ','.join(r['wrong']) if r['wrong'] else ''} gain {r['stated_gain'] or 0:.2f}"
                f" {r['measured_gain'] or 0:.2f} {r['seconds']:.0f} s",
                flush=True,
            )
            if kept is not None:
                write_json({**asked, "rows": rows}, kept)
    figures = summary(rows)
    for key, value in figures.items():
        print(f"{key}: {value}")
    if kept is not None:
        write_json({**asked, "summary": figures, "rows": rows}, kept)
    return 0
