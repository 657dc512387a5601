"""A strip pulled until it tears: the bulk and cut laws of a cutting test, without a blade.

The specimen is the one of the paper's tension tests, 12 × 30 × 3 mm between clamps that let nothing slide or
narrow, with or without a notch in the middle of one side. Laws, forms and Newton's method are those of a run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.base.progress import OnProgress, silent
from cutbench.base.units import Parameter
from cutbench.case.case import Case
from cutbench.case.numerics import defaults
from cutbench.models3d.strip import strip
from cutbench.run.build import Built, build
from cutbench.run.measures import ONSET, first_crossing
from cutbench.run.result import Outcome
from cutbench.solver.march import Load, Stalled
from cutbench.solver.problem import Evaluation, Problem

#: The strip, and the speed at which its clamps part: those of the paper.
SPECIMEN = {"width": "12 mm", "height": "30 mm", "length": "3 mm", "speed": "0.03 mm/s"}
NOTCH = Parameter("notch", "mm", "c", "length of the notch", low=0, default=2.4)
#: A strip whose force has fallen to this part of its largest is torn.
TORN = 0.05
#: Mirror images that the meshed part stands for.
IMAGES = 4
#: Slots of the laws that a strip has.
SLOTS = ("bulk", "cut")

#: Unit and meaning of each number, in the order in which tables show them.
MEASURES: dict[str, tuple[str, str]] = {
    "modulus_MPa": ("MPa", "slope of nominal stress over strain at the start"),
    "onset_mm": ("mm", "elongation at which the cut has begun"),
    "onset_N": ("N", "force then"),
    "max_mm": ("mm", "elongation at the largest force"),
    "max_N": ("N", "largest force"),
    "max_MPa": ("MPa", "largest nominal stress, over the whole width"),
    "energy_mJ": ("mJ", "work done"),
}


@dataclass
class Tension:
    """A tension test is a strip that was pulled until it tore or reached its elongation.

    ``case`` is the strip, from ``strip_case``, ``notch_mm`` the length of its notch, 0 for none. ``curve``
    has columns (n,), a value a step that is kept, the start among them: ``elongation_mm``, ``force_N``,
    ``time_s``, ``stress_MPa`` (nominal), ``cut_length_mm``, ``closure``. ``measures`` are read off it
    (``cutbench.run.tension.MEASURES``), units in the names."""

    case: Case
    notch_mm: float
    curve: dict[str, np.ndarray]
    outcome: Outcome
    measures: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)


def strip_case(case: Case, changes: Mapping[str, object] | None = None, *, notch_mm: float) -> Case:
    """Make the case of a strip in tension from the case of a cut.

    The strip is without blade, rig and skin, and of the paper's size and speed. ``depth`` is the largest
    elongation, by default the height, which is the distance of the clamps. A strip without a notch stays
    whole: its laws are those of the bulk. ``changes``, as ``Case.set`` takes them, are applied at last.

    Raises BadInput for a notch as long as the strip is wide, one in a model without a law for the cut plane,
    or changes that cannot be used."""
    slots = SLOTS if notch_mm > 0 else SLOTS[:1]
    kept = [law.name for law in case.model.all if law.slot in slots]
    if notch_mm > 0 and not case.model.laws("cut"):
        raise BadInput(
            key="notch", value=f"{notch_mm:g} mm", expected="0 mm in a model without a law for the cut plane"
        )
    asked = {**SPECIMEN, **(changes or {})}
    if case.numerics == defaults(3):
        asked = {"numerics": "tetrahedra", **asked}
    made = case.set(mechanisms=kept, **{"depth": asked["height"], "until": "depth", **asked})
    require(
        all(made.model.mirrored(made.p)[::2]),
        "mechanisms",
        ", ".join(kept),
        "laws without a direction, or with one along or across the pull: a quarter of the strip is meshed",
    )
    if not 0 <= notch_mm < made.p.width:
        raise BadInput(
            key="notch", value=f"{notch_mm:g} mm", expected=f"less than the width, {made.p.width:g} mm"
        )
    return made


def run_tension(case: Case, notch_mm: float, *, on_progress: OnProgress = silent) -> Tension:
    """Compute a tension test: pull a strip, from ``strip_case``, to its largest elongation, or until it is
    torn.

    ``on_progress(done, total, text)`` is called with elongations in mm and the force. A KeyboardInterrupt
    ends the test with what it has."""
    began = time.perf_counter()
    p = case.p
    geometry = strip(p.width, p.height, p.length, notch_mm, case.sizes.h_mm)
    built = build(case, geometry)
    clamp = _Clamp(built)
    march = replace(built.march, centre0=np.zeros(3), window=None, load=clamp)
    rows = [dict.fromkeys((*_row(built, 0.0, 0.0, {}), "closure"), 0.0)]
    interrupted, stalled, refused, iterations, top = False, "", 0, 0, 0.0
    try:
        for step in march.steps():
            iterations, refused = iterations + step.iterations, refused + len(step.refused)
            row = _row(built, step.travel, step.force * IMAGES, step.states)
            # Damping that is still raised holds a strip back: one that has torn all the same is torn.
            torn = row["force_N"] < TORN * top and row["cut_length_mm"] > 0
            if step.between and not torn:
                continue
            spent, left = step.progress.spent, step.progress.left
            rows.append(row | {"closure": left / spent if spent else 0.0})
            on_progress(step.travel, p.depth, f"{row['force_N']:.3g} N")
            top = max(top, row["force_N"])
            if torn:
                break
    except KeyboardInterrupt:
        interrupted = True
    except Stalled as error:
        stalled, refused = error.reason, refused + len(error.refused)
    curve = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    reached = float(curve["elongation_mm"][-1])
    if interrupted:
        outcome = Outcome("interrupted", f"stopped by the user at {reached:.3f} mm", "", reached)
    elif stalled:
        advice = "Try a smaller h, or a larger damping."
        text = f"no smaller step converges at {reached:.3f} mm of {p.depth:g} mm ({stalled})"
        outcome = Outcome("stalled", text, advice, reached)
    else:
        what = "torn" if reached < p.depth * (1 - 1e-9) else "reached"
        outcome = Outcome("done", f"{what} at {reached:.3f} mm", "", reached)
    counts = {"steps": len(rows), "iterations": iterations, "rejected_steps": refused}
    counts["degrees_of_freedom"] = int(built.problem.free.size)
    timings = {**built.problem.timer.seconds, "total": time.perf_counter() - began}
    return Tension(case, notch_mm, curve, outcome, _measures(case, curve), counts, timings)


class _Clamp(Load):
    """Clamps that part by the travel: each goes half of it, and the meshed part has one."""

    def __init__(self, built: Built):
        self._moved, self._fixed = built.space.nodes_on("clamp") * 3, built.problem.fixed
        self._X, self._height = built.space.X, built.geometry.height

    def force(self, problem: Problem, found: Evaluation) -> float:
        return float(found.residual[self._moved].sum()) / 2

    def begun(self, u: np.ndarray, before: float, travel: float) -> np.ndarray:
        """Uniform stretching without change of volume."""
        guess, strain = u.copy(), (travel - before) / (2 * self._height)
        stretched = self._X * np.array([[strain], [-strain / 2], [-strain / 2]])
        guess[: self._X.size] += stretched.T.ravel()
        guess[self._fixed] = 0.0
        return self.placed(guess, travel)

    def placed(self, guess: np.ndarray, travel: float) -> np.ndarray:
        guess = guess.copy()
        guess[self._moved] = travel / 2
        return guess


def _row(built: Built, travel: float, force: float, states: Mapping[str, dict]) -> dict[str, float]:
    p, cut = built.case.p, 0.0
    if "cohesion" in states:
        cut = float(built.form("cohesion").cut_area(states["cohesion"]).sum()) / (p.length / 2)
    return {
        "elongation_mm": travel,
        "force_N": force,
        "time_s": travel / p.speed,
        "stress_MPa": force / (p.width * p.length),
        "cut_length_mm": cut,
    }


def _measures(case: Case, curve: dict[str, np.ndarray]) -> dict[str, float]:
    e, F, cut = curve["elongation_mm"], curve["force_N"], curve["cut_length_mm"]
    if e.size < 2:
        return dict.fromkeys(MEASURES, math.nan)
    top, onset = int(np.argmax(F)), first_crossing(e, cut, ONSET * case.unit_mm)
    return {
        "modulus_MPa": float(curve["stress_MPa"][1] / (e[1] / case.p.height)),
        "onset_mm": onset,
        "onset_N": float(np.interp(onset, e, F)),
        "max_mm": float(e[top]),
        "max_N": float(F[top]),
        "max_MPa": float(curve["stress_MPa"][top]),
        "energy_mJ": float(np.trapezoid(F, e)),
    }
