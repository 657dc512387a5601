"""What discovery makes of cuts by other numerics and formulas: ``python -m benchmarks.outside_cuts``.

Each campaign has cuts at three speeds, and one at a fourth that is only predicted. They are computed with
other elements, steps, contact or cohesive shape than a fit's defaults, and the effect in them follows a
formula that no candidate has: powers of the speed, a relaxing modulus, a machine that gives way, a reading
that drifts; stiffening alone is a candidate's (``fung``). A sixth hide nothing but the other numerics.

    python -m benchmarks.outside_cuts [--cases 24] [--seed N] [--case K] [--limit SECONDS] [--json FILE]
        [--runs FOLDER]

The fit runs at its default numerics on two processes. ``--limit``: seconds after which no case begins.
``--runs``: where each case leaves its runs, so that one that was stopped goes on; its seconds are then those
of the rest.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutbench.base.errors import CutbenchError
from cutbench.base.files import write_json
from cutbench.base.progress import silent
from cutbench.case.case import Case, load_case
from cutbench.data.campaign import load_campaign
from cutbench.discovery import Discovery, discover
from cutbench.discovery.candidates import cause_of, family_of
from cutbench.discovery.outcome import CHANCE
from cutbench.run.runner import run_case

#: What a right answer names one of, by effect: classes of laws, or kinds of causes.
CLASSES = {
    "toughness by speed": ("rate of cutting",),
    "adhesion by speed": ("adhesion by speed",),
    "relaxing modulus": ("viscoelasticity",),
    "stiffening": ("strain stiffening",),
    "blunt tip": ("tool",),
    "compliance": ("machine",),
    "late zero": ("reading",),
    "drift": ("reading",),
}
NONE, SWING = "none", "swing"
#: mm/s: three that are fitted, one that is predicted.
SPEEDS = {"slow": 0.005, "middle": 0.021, "fast": 0.08, "other": 0.04}
SIZES = {"width": "20 mm", "length": "30 mm", "height": "14 mm"}
DEPTH_MM, READINGS, REPETITIONS, NOISE = 5.0, 150, 3, 0.01
#: At this force a machine that gives way has given half a millimetre, for an effect of size 1.
MACHINE_N = 1.2
#: What the truth computes with in place of the defaults, by turns.
OTHERWISE: tuple[tuple[str, Mapping[str, object]], ...] = (
    ("finer", {"h": "0.045 mm", "step": "0.06 mm", "penalty": 128000, "stick": 51200}),
    ("coarse", {"numerics": "fast"}),
    ("cohesion as printed", {"numerics": "fast", "with": ["smith_ferrante"]}),
    ("material normal", {"normal": "material", "h": "0.1 mm"}),
)


@dataclass(frozen=True)
class Truth:
    """What was hidden, where its campaign lies, and the clean force (m,) over travel of the predicted cut."""

    number: int
    effect: str
    otherwise: str
    size: float
    scatter: float
    file: Path
    other: tuple[np.ndarray, np.ndarray]


def plan(cases: int, seed: int) -> list[tuple[str, int]]:
    """Effect and number of the numerics of each case: a sixth hide none, one in 24 what no candidate has."""
    none, swing = max(round(cases / 6), 1), round(cases / 24)
    effects = [*CLASSES] * math.ceil(cases / len(CLASSES))
    made = [NONE] * none + [SWING] * swing + effects[: cases - none - swing]
    order = np.random.default_rng(seed).permutation(len(made))
    return [(made[k], i % len(OTHERWISE)) for i, k in enumerate(order)]


def true_case(effect: str, speed: float, size: float, choices: Mapping[str, object]) -> Case:
    """The specimen cut at ``speed`` (mm/s), with the effect in its values."""
    relative, toughness, adhesion, modulus, tip = speed / SPEEDS["slow"], 5.0, 1.5, 8.0, 1.05
    more: dict[str, object] = {}
    laws = list(choices.get("with", ()))
    if effect == "toughness by speed":
        toughness *= relative ** (0.25 * size)
    elif effect == "adhesion by speed":
        adhesion *= relative ** (0.5 * size)
    elif effect == "relaxing modulus":  # as far as it relaxes while the blade goes 2 mm
        modulus *= 1 + size * math.exp(-2.0 / speed / 60.0)
    elif effect == "stiffening":
        laws, more = [*laws, "fung"], {"b_fung": 0.4 * size}
    elif effect == "blunt tip":
        tip /= 1 + 1.5 * size
    values = {
        **SIZES, "speed": f"{speed} mm/s", "depth": f"{DEPTH_MM} mm", "eta_reg": "0.8 s", "tip": f"{tip} mm",
        "G_c": f"{toughness} J/m^2", "tau_W": f"{adhesion} kPa", "G": f"{modulus} kPa", **more,
    }  # fmt: skip
    return load_case("gelatin", {**choices, **values, **({"with": laws} if laws else {})})


def recorded(
    effect: str, size: float, x: np.ndarray, F: np.ndarray, speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Travel (m,) and force (m,) as a laboratory records them of the true ones."""
    largest = F.max()
    if effect == "compliance":
        x = x + 0.5 * size * (np.maximum(F, 0.0) / MACHINE_N) ** 0.8  # the same machine in all cuts
        # A machine never goes back: where the force falls fast, the specimen runs on at a stand.
        ahead = np.diff(np.maximum.accumulate(x), prepend=0.0) > 0
        x, F = x[ahead], F[ahead]
    elif effect == "late zero":
        x = x - 0.5 * size
    elif effect == "drift":
        F = F + 0.25 * size * largest * (x / speed) / (DEPTH_MM / SPEEDS["slow"])
    elif effect == SWING:
        F = F * (1 + 0.25 * size * np.sin(2 * np.pi * x / 1.3 + 20 * speed))
    return x[x > 0], F[x > 0]


def make(
    number: int, effect: str, otherwise: int, seed: int, folder: Path, run: Callable = run_case,
    repetitions: int = REPETITIONS,
) -> Truth:  # fmt: skip
    """Compute one campaign by ``run`` and write it into ``folder``. Raises CutbenchError."""
    rng = np.random.default_rng([seed, number])
    size, scatter = float(rng.uniform(0.6, 1.2)), float(rng.uniform(0.01, 0.04))
    name, choices = OTHERWISE[otherwise]
    folder.mkdir(parents=True, exist_ok=True)
    text = [f'title = "cuts {number}"', 'material = "gelatin"', "[parameters]"]
    text += [f'G = "{8 * rng.uniform(0.8, 1.25):.3g} kPa"', f'G_c = "{5 * rng.uniform(0.8, 1.25):.3g} J/m^2"']
    other = np.zeros(0), np.zeros(0)
    for id, speed in SPEEDS.items():
        curve = run(true_case(effect, speed, size, choices)).curve
        x = np.linspace(0, DEPTH_MM, READINGS + 1)[1:]
        x, F = recorded(effect, size, x, np.interp(x, curve["displacement_mm"], curve["force_N"]), speed)
        rows = []
        for r in range(repetitions):
            mine = F * (1 + scatter * rng.standard_normal()) + NOISE * F.max() * rng.standard_normal(F.size)
            rows += [f"{r},{a:.6g},{b:.6g}" for a, b in zip(x, mine, strict=True)]
        (folder / f"{id}.csv").write_text("\n".join(["rep,u [mm],F [N]", *rows]) + "\n")
        text += [
            "", "[[experiment]]", f'id = "{id}"', 'kind = "cut"', f'data = "{id}.csv"',
            f'role = "{"test" if id == "other" else "train"}"', f'speed = "{speed} mm/s"',
            'columns = { displacement = "u", force = "F", repetition = "rep" }',
            "specimen = { " + ", ".join(f'{k} = "{v}"' for k, v in SIZES.items()) + " }",
            'blade = { thickness = "0.7 mm", tip = "1.05 mm" }',
        ]  # fmt: skip
        other = x, F
    file = folder / "campaign.toml"
    file.write_text("\n".join(text) + "\n")
    return Truth(number, effect, name, size, scatter, file, other)


def judge(truth: Truth, d: Discovery) -> dict:
    """What was said, beside what was hidden. Right: the first cause or one that its data cannot tell from it.
    Where nothing is hidden, other numerics or a fixed value are no wrong answer. ``seen``: whether the
    baseline, its values bent as they may be, leaves more than chance does. Where it does not, these data have
    nothing that names a cause."""
    wanted = CLASSES.get(truth.effect, ())
    groups = [{*r.group, r.accepted} for r in d.rounds if r.accepted]
    named = [{family_of(n) for n in group} for group in groups]
    excused = truth.effect == NONE and all(cause_of(n) == "parameter" for n in d.found)
    hidden = set(wanted)
    right = bool(named and named[0] & hidden) if wanted else d.verdict in (NONE, "unexplained") or excused
    return {
        "case": truth.number, "effect": truth.effect, "otherwise": truth.otherwise, "size": truth.size,
        "scatter": truth.scatter, "verdict": d.verdict, "found": list(d.found),
        "numerical": d.numerics.explains, "right": right,
        "seen": bool(d.rounds[0].scores.p_residual < CHANCE),
        "wrong": [n for n, group in zip(d.found, named, strict=False) if not group & hidden and not excused],
        "misfit": max(d.first.misfit.values()), "left": max(d.final.misfit.values()),
        "gain": d.gain.gain if d.gain else None, "measured_gain": _gain(truth, d) if d.gain else None,
        "seconds": d.seconds,
    }  # fmt: skip


def _gain(truth: Truth, d: Discovery) -> float | None:
    """Fall of the error against the clean curve of the predicted cut."""
    errors = []
    for point in (d.first, d.final):
        if "other" not in point.tests:
            return None
        x = point.inverse.grids["other"].x
        errors.append(np.sqrt(np.mean((point.tests["other"] - np.interp(x, *truth.other)) ** 2)))
    return float(1 - errors[1] / errors[0])


def summary(rows: Sequence[Mapping]) -> dict[str, str]:
    hidden = [r for r in rows if r["effect"] in CLASSES]
    seen, taken_up = ([r for r in hidden if r["seen"] == here] for here in (True, False))
    rest = [r for r in rows if r["effect"] not in CLASSES]
    seconds = [r["seconds"] for r in rows]

    def part(key: str, some: Sequence[Mapping]) -> str:
        return f"{sum(bool(r[key]) for r in some)} of {len(some)}"

    return {
        "one effect: the right class first or in its group": part("right", hidden),
        "the same, where the baseline does not take it up": part("right", seen),
        "nothing named, where it does": f"{sum(not r['found'] for r in taken_up)} of {len(taken_up)}",
        "no effect, or one that no candidate has: nothing named": part("right", rest),
        "a class named that was not there": part("wrong", rows),
        "seconds a case, median and largest": f"{np.median(seconds):.0f}, {max(seconds, default=0):.0f}",
    }


def _told(done: float, total: float, text: str) -> None:
    print(f"    {text}", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.outside_cuts", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="the case of this number alone")
    parser.add_argument("--workers", type=int, default=2, help="processes of a search")
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds after which no case begins")
    parser.add_argument("--each", type=float, default=math.inf, help="seconds after which a search ends")
    parser.add_argument("--json", type=Path, help="keep everything there, and go on from it")
    parser.add_argument("--runs", type=Path, help="leave the runs of each case there, and go on from them")
    parser.add_argument("--told", action="store_true", help="show what the search does")
    args = parser.parse_args(argv)
    asked = {"cases": args.cases, "seed": args.seed}
    rows: list[dict] = []
    if (
        args.json
        and args.json.exists()
        and asked.items() <= (data := json.loads(args.json.read_text())).items()
    ):
        rows = data["rows"]
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for number, (effect, otherwise) in enumerate(plan(args.cases, args.seed)):
            if args.case not in (None, number) or number in [r["case"] for r in rows]:
                continue
            if time.perf_counter() - began > args.limit:
                break
            try:
                truth = make(number, effect, otherwise, args.seed, Path(folder) / str(number))
                d = discover(
                    load_campaign(truth.file),
                    workers=args.workers,
                    on_progress=_told if args.told else silent,
                    kept=args.runs and args.runs / str(number),
                    limit_s=args.each,
                )
            except CutbenchError as error:
                print(f"{number:3d} {effect}: {error}", flush=True)
                continue
            rows.append(r := judge(truth, d))
            print(
                f"{number:3d} {effect:20s} {truth.otherwise:20s} {r['verdict']:11s}"
                f" {','.join(r['found']):24s}"
                f" {'right' if r['right'] else ''}{' WRONG' if r['wrong'] else ''}"
                f" misfit {100 * r['misfit']:.0f} -> {100 * r['left']:.0f} % {r['seconds']:.0f} s",
                flush=True,
            )
            if args.json:
                write_json({**asked, "rows": rows}, args.json)
    figures = summary(rows)
    for key, value in figures.items():
        print(f"{key}: {value}")
    if args.json:
        write_json({**asked, "summary": figures, "rows": rows}, args.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
