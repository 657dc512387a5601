"""A strip pulled until it tears: the bulk and cut laws of a cutting test, without a blade.

The specimen is the one of the paper's tension tests, 12 × 30 × 3 mm between clamps that let nothing slide or
narrow, with or without a notch in the middle of one side. Laws, forms and Newton's method are those of a run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.progress import OnProgress, silent
from cutbench.base.units import Parameter
from cutbench.case.case import Case
from cutbench.forms.base import Step
from cutbench.models3d.strip import strip
from cutbench.run.build import Built, build
from cutbench.run.result import Outcome
from cutbench.solver.newton import NewtonSettings, NoConvergence, newton
from cutbench.solver.problem import damage_growth

#: The strip, and the speed at which its clamps part: those of the paper.
SPECIMEN = {"width": "12 mm", "height": "30 mm", "length": "3 mm", "speed": "0.03 mm/s"}
NOTCH = Parameter("notch", "mm", "c", "length of the notch", low=0, default=2.4)
#: A strip whose force has fallen to this part of its largest is torn.
TORN = 0.05
#: Mirror images that the meshed part stands for.
IMAGES = 4
#: Below this step the damping is raised where Newton's method fails, mm.
GENTLE = 5e-3
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
#: The cut has begun when it is longer by this, mm.
ONSET_MM = 0.1


@dataclass
class Tension:
    """One test: ``curve`` maps columns to arrays (n,), a value a step."""

    case: Case
    notch_mm: float
    curve: dict[str, np.ndarray]
    outcome: Outcome
    measures: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)


def strip_case(case: Case, changes: Mapping[str, object] | None = None, *, notch_mm: float) -> Case:
    """``case`` as a strip: without blade, rig and skin, of the paper's size and speed, then ``changes``.

    ``depth`` is the largest elongation, by default the height, which is the distance of the clamps. A strip
    without a notch stays whole: its laws are those of the bulk. Raises BadInput.
    """
    slots = SLOTS if notch_mm > 0 else SLOTS[:1]
    kept = [law.name for law in case.model.all if law.slot in slots]
    if notch_mm > 0 and not case.model.laws("cut"):
        raise BadInput(
            key="notch", value=f"{notch_mm:g} mm", expected="0 mm in a model without a law for the cut plane"
        )
    asked = {**SPECIMEN, **(changes or {})}
    made = case.set(mechanisms=kept, **{"depth": asked["height"], **asked})
    if not 0 <= notch_mm < made.p.width:
        raise BadInput(
            key="notch", value=f"{notch_mm:g} mm", expected=f"less than the width, {made.p.width:g} mm"
        )
    return made


def run_tension(
    case: Case,
    notch_mm: float,
    *,
    on_progress: OnProgress = silent,
) -> Tension:
    """Pull the strip ``case`` (from ``strip_case``) to its depth, or until it is torn.

    ``on_progress`` has the elongation in mm and the force. A KeyboardInterrupt ends the test with what
    it has.
    """
    began = time.perf_counter()
    p = case.p
    geometry = strip(p.width, p.height, p.length, notch_mm, case.numerics.h_mm)
    pull = _Pull(build(case, geometry))
    rows, interrupted = [pull.row], False
    try:
        for row in pull:
            rows.append(row)
            on_progress(row["elongation_mm"], p.depth, f"{row['force_N']:.3g} N")
    except KeyboardInterrupt:
        interrupted = True
    curve = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    reached = float(curve["elongation_mm"][-1])
    if interrupted:
        outcome = Outcome("interrupted", f"stopped by the user at {reached:.3f} mm", "", reached)
    elif pull.stopped is not None:
        advice = "Try a smaller h, or damping_mm = 1e-3."
        text = f"no smaller step converges at {reached:.3f} mm of {p.depth:g} mm ({pull.stopped})"
        outcome = Outcome("stalled", text, advice, reached)
    else:
        what = "torn" if reached < p.depth - 1e-9 else "reached"
        outcome = Outcome("done", f"{what} at {reached:.3f} mm", "", reached)
    timer = pull.built.problem.timer
    counts = {"steps": len(rows), "iterations": pull.iterations, "rejected_steps": len(pull.failures)}
    counts["degrees_of_freedom"] = int(pull.built.problem.free.size)
    timings = {**timer.seconds, "total": time.perf_counter() - began}
    return Tension(case, notch_mm, curve, outcome, _measures(case, curve), counts, timings)


class _Pull:
    """Steps of the clamps; iterate to get the row of each converged one."""

    def __init__(self, built: Built):
        self.built = built
        problem, n = built.problem, built.case.numerics
        self.moved = built.space.nodes_on("clamp") * 3
        problem.in_balance = np.arange(problem.ndof)
        self.newton = NewtonSettings(**vars(n.tuning.newton), tolerance=n.tolerance)
        self.damped = any(form.name == "damping" for form in problem.forms)
        self.failures: list[str] = []
        self.stopped: str | None = None
        self.iterations = 0
        self.spent = self.taken = 0.0
        self.row = {"elongation_mm": 0.0, "force_N": 0.0, "time_s": 0.0, "stress_MPa": 0.0}
        self.row |= {"cut_length_mm": 0.0, "closure": 0.0}

    def __iter__(self):
        problem, case = self.built.problem, self.built.case
        n, p = case.numerics, case.p
        u, states, before = np.zeros(problem.ndof), problem.start(), None
        reached, size, last = 0.0, min(n.tuning.steps.first, n.step_mm), 0.0
        top, easy, factor, nowhere = 0.0, 0, 1.0, np.zeros(3)
        X = self.built.space.X
        while reached < p.depth - 1e-9:
            size = min(size, p.depth - reached)
            step = Step(size / p.speed, u, nowhere, nowhere, factor)
            if before is None:  # uniform stretching without change of volume
                guess = u.copy()
                strain = size / p.height
                guess[: X.size] += (X * np.array([[strain], [-strain / 2], [-strain / 2]])).T.ravel()
                guess[problem.fixed] = 0.0
            else:
                guess = u + (u - before) * (size / last)
            guess[self.moved] = (reached + size) / 2
            try:
                new, result, effort = newton(problem, guess, states, step, self.newton)
                growth = damage_growth(states, result.states)
                if growth > 2 * n.damage_step and size > 4 * n.step_min_mm:
                    raise NoConvergence(f"damage grew by {growth:.2f}")
                spent, taken, defect = self._energy(new, states, result, step, size)
                if defect > 3 * n.energy_step and size > GENTLE:
                    raise NoConvergence(f"the energy of the step closes only to {defect:.0%}")
            except NoConvergence as error:
                self.failures.append(f"{reached:.4f} mm: {error.reason}")
                size, easy = size / 2, 0
                if self.damped and size < GENTLE and factor < n.tuning.steps.largest_damping:
                    factor = max(10.0, 10 * factor)
                    size = max(size, n.step_min_mm)
                elif size < n.step_min_mm:
                    self.stopped = error.reason
                    return
                continue
            self.spent, self.taken = self.spent + spent, self.taken + taken
            reached, last = reached + size, size
            before, u, states = u, new, result.states
            self.iterations += effort
            self._add(reached, result, states)
            yield self.row
            top = max(top, self.row["force_N"])
            if self.row["force_N"] < TORN * top and self.row["cut_length_mm"] > 0:
                return
            easy += 1
            factor = max(1.0, 0.6 * factor)
            if effort > 9 or growth > n.damage_step or defect > n.energy_step:
                size *= 0.7
            elif effort <= 6 and growth < 0.7 * n.damage_step and 2 * defect < n.energy_step and easy > 1:
                size = min(1.5 * size, n.step_mm)

    def _force(self, result) -> float:
        return float(result.residual[self.moved].sum()) * self.built.geometry.multiplicity

    def _energy(self, u, old, result, step, size: float) -> tuple[float, float, float]:
        """Work of the clamps and of the mechanisms in a step, mJ, and their relative difference."""
        problem = self.built.problem
        spent = (self.row["force_N"] + self._force(result)) / 2 * size
        taken = sum(problem.work(u, old, result.states, step).values()) * IMAGES
        # Against the work over a largest step: within a small jump nothing is gained by closing better.
        whole = spent / size * max(size, self.built.case.numerics.step_mm)
        return spent, taken, abs(spent - taken) / max(whole, 1e-300)

    def _add(self, reached: float, result, states) -> None:
        p, built = self.built.case.p, self.built
        cut = 0.0
        if "cohesion" in states:
            cut = float(built.form("cohesion").cut_area(states["cohesion"]).sum()) / (p.length / 2)
        self.row = {
            "elongation_mm": reached,
            "force_N": (force := self._force(result)),
            "time_s": reached / p.speed,
            "stress_MPa": force / (p.width * p.length),
            "cut_length_mm": cut,
            "closure": (self.spent - self.taken) / self.spent if self.spent else 0.0,
        }


def _measures(case: Case, curve: dict[str, np.ndarray]) -> dict[str, float]:
    out = dict.fromkeys(MEASURES, math.nan)
    e, F, cut = curve["elongation_mm"], curve["force_N"], curve["cut_length_mm"]
    if e.size < 2:
        return out
    top = int(np.argmax(F))
    out |= {
        "modulus_MPa": float(curve["stress_MPa"][1] / (e[1] / case.p.height)),
        "max_mm": float(e[top]),
        "max_N": float(F[top]),
        "max_MPa": float(curve["stress_MPa"][top]),
        "energy_mJ": float(np.trapezoid(F, e)),
    }
    if (cut >= ONSET_MM).any():
        i = int(np.argmax(cut >= ONSET_MM))
        part = (ONSET_MM - cut[i - 1]) / (cut[i] - cut[i - 1])
        out["onset_mm"] = float(e[i - 1] + part * (e[i] - e[i - 1]))
        out["onset_N"] = float(F[i - 1] + part * (F[i] - F[i - 1]))
    return out
