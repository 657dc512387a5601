"""Paths of equilibria through snap-backs: the blade's travel is an unknown, the growth of the cut is given.

Where cutting is abrupt, equilibrium under a blade that only moves forward ends at a turning point, and the
force jumps. Behind it there are equilibria at less travel. With C(u) = ∫ g(d) dA, the cut's length by its
damage d, the equations are

    R(u, travel) = 0,   C(u) − C(u_old) = ΔC.

Damage never heals, so C grows along the whole path, the blade going forward or back (a dissipation-driven
control as of Gutiérrez, Comm. Numer. Meth. Eng. 20 (2004), 10.1002/cnm.649, and Verhoosel et al., Int. J.
Numer. Meth. Eng. 77 (2009), 10.1002/nme.2447). ``solve.bordered`` solves them. While nothing breaks the
travel is given instead.

Contact that shifts by an element, or an element that opens at once, can end a branch altogether: then no
equilibrium is near, whatever is given. There the body is let go under a still blade and creeps to rest; such
points are marked, and what the creep dissipates stands in their work as "snap".

Laws must not depend on time: equilibria at rest have none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from cutbench.case.tuning import PathTuning
from cutbench.forms.base import Step
from cutbench.solver.bordered import Bordered, step_to
from cutbench.solver.march import Stalled
from cutbench.solver.newton import NewtonSettings, NoConvergence, newton
from cutbench.solver.problem import Problem, damage_growth
from cutbench.solver.step_control import DRAGS, RESTS, StepControl, StepRules, StepState

#: What was given at a point: travel, or growth of the cut; or nothing, the body was let go.
TRAVEL, CUT, RELEASE = "travel", "cut", "release"


@dataclass(frozen=True)
class _State:
    """Where a step begins. ``broken``: C in mm of the meshed part."""

    travel: float
    u: np.ndarray
    states: dict[str, dict]
    broken: float


@dataclass(frozen=True)
class PathPoint(_State):
    """An equilibrium, or a state of a release."""

    force: float
    reaction: float
    work: dict[str, float]
    iterations: int
    step: Step
    by: str
    #: What its step began from; its tangent is that of ``u`` on the way from there.
    begun: dict[str, dict] = field(repr=False, default_factory=dict)


@dataclass(frozen=True)
class _Change:
    """What the last step changed."""

    u: np.ndarray
    travel: float
    broken: float


@dataclass(frozen=True)
class Path:
    """Equilibria from rest until the blade has travelled ``depth``: iterate to get each.

    ``bottom`` as in a march, and so are the rules of its steps: what is given is their size, be it travel or
    growth of the cut.
    """

    problem: Problem
    centre0: np.ndarray
    depth: float
    bottom: np.ndarray
    tuning: PathTuning = field(default_factory=PathTuning)
    rules: StepRules = field(default_factory=StepRules)
    newton: NewtonSettings = field(default_factory=NewtonSettings)

    @cached_property
    def _bordered(self) -> Bordered | None:
        if (cut := self.problem.cut) is None:
            return None
        return Bordered(self.problem, cut, self.centre0, self.newton, self.tuning.iterations)

    @cached_property
    def _control(self) -> StepControl:
        """The march's, without damping to raise: no step is so short that a snap has begun. One that is
        refused costs as much as ten that are taken."""
        rules = replace(self.rules, damage=self.tuning.damage, gentle=0.0, paper=False)
        return StepControl(replace(rules, shrink=rules.shrink**2), damped=False)

    def __iter__(self) -> Iterator[PathPoint]:
        """Each point of the path. Raises Stalled where it ends early."""
        first, control, tuning = min(self.rules.first, self.rules.largest), self._control, self.tuning
        at: _State = _State(0.0, np.zeros(self.problem.ndof), self.problem.start(), 0.0)
        by, size = TRAVEL, StepState(first)
        before: _Change | None = None
        still = 0  # releases one after the other
        refused: list[str] = []
        for _ in range(tuning.points):
            if at.travel >= self.depth - 1e-9:
                return
            begun = self.problem.touched(at.states)
            try:
                point, growth = self._step(by, size.size, at, begun, before)
            except NoConvergence as error:
                refused.append(f"{at.travel:.4f} mm, by {by}, {size.size:.2g} mm: {error.reason}")
                less = control.shorter(size, error, False)
                if by == TRAVEL and self._bordered and (less is None or less.size < first / 20):
                    by, less = CUT, StepState(first)  # the blade cannot go on: what breaks decides
                if less is not None:
                    size = less
                    continue
                # Where it does not move by itself, the blade is moved on a little before it is let go.
                if still > tuning.nudges:
                    raise Stalled(refused, "no equilibrium is near, again and again") from error
                for point in self._release(at, tuning.nudge if still else 0.0, refused):
                    yield (at := point)
                still += 1
                by, size, before, refused = TRAVEL, StepState(first), None, []
                continue
            yield point
            still, refused = 0, []
            before = _Change(point.u - at.u, point.travel - at.travel, point.broken - at.broken)
            at = point
            size = control.after(size, point.iterations, growth, 0.0, 1.0)
            # The cut's growth is given where it grows fast against the travel.
            wanted = CUT if self._bordered and before.broken > tuning.breaks * abs(before.travel) else TRAVEL
            if wanted != by:
                last = before.broken if wanted == CUT else abs(before.travel)
                by, size = wanted, StepState(min(max(first / 4, last), self.rules.largest))
        raise Stalled(refused, f"{tuning.points} points")

    def _step(self, by, amount, at, begun, before) -> tuple[PathPoint, float]:
        """A step of what is given, and how much damage grows in it; raises NoConvergence."""
        step, u, result, iterations = (self._by_travel if by == TRAVEL else self._by_cut)(
            amount, at, begun, before
        )
        growth = damage_growth(at.states, result.states)
        if before is not None and growth > 2 * self.tuning.damage:
            raise NoConvergence(f"damage grew by {growth:.2f}")
        moved = self._travel(step) - at.travel
        turns = before is not None and before.travel * moved < 0
        if abs(moved) > (self.tuning.turn if turns else self.tuning.stride):
            raise NoConvergence(f"the blade moved by {moved:.2g} mm")
        point = self._point(at, begun, step, u, result, iterations, by)
        if by == TRAVEL and point.broken - at.broken > 2 * self.rules.largest:
            raise NoConvergence(f"the cut grew by {point.broken - at.broken:.2g} mm")
        return point, growth

    def _by_travel(self, amount, at, begun, before):
        amount = min(amount, self.depth - at.travel)
        step = step_to(self.centre0, at.travel + amount, at.travel, at.u)
        if before is not None and before.travel > 0:
            try:
                guess = at.u + before.u * min(amount / before.travel, 1.5)
                return step, *newton(self.problem, guess, begun, step, self.newton)
            except NoConvergence:
                pass
        return step, *newton(self.problem, at.u, begun, step, self.newton)

    def _by_cut(self, amount, at, begun, before):
        assert self._bordered is not None, "without a cut the travel is given"
        solve = partial(self._bordered.solve, amount, at.u, at.travel, begun, at.broken)
        if before is not None and before.broken > 0:
            ratio = min(amount / before.broken, 2.0)
            try:
                return solve(at.u + ratio * before.u, at.travel + ratio * before.travel)
            except NoConvergence:
                pass
        return solve(at.u, at.travel)

    def _release(self, at: _State, nudge: float, refused: list[str]) -> Iterator[PathPoint]:
        """States of a creep to rest under a still blade. Raises Stalled where it does not come to rest."""
        problem, rest, control = self.problem, self.tuning.rest, StepControl(self.rules)
        if problem.damping is None:
            raise Stalled(refused, "no equilibrium is near")
        raised = StepState(self.rules.first, self.rules.jump_damping, RESTS)
        now: StepState | None = raised
        while now is not None and now.blade != DRAGS:
            begun = problem.touched(at.states)
            drag = rest * now.damping_factor if now.rests else 0.0
            # Drag is a force per displacement, in G: over a step of 1 s.
            factor = drag * problem.shear_modulus / problem.damping.viscosity
            step = step_to(self.centre0, at.travel + nudge, at.travel, at.u, factor)
            try:
                u, result, iterations = newton(problem, at.u, begun, step, self.newton)
            except NoConvergence as error:
                refused.append(f"{at.travel:.4f} mm, released, drag {drag:.1g}: {error.reason}")
                now = control.shorter(now if now.rests else replace(raised, vain=now.vain), error, False)
                continue
            point = self._point(at, begun, step, u, result, iterations, RELEASE)
            yield point
            if not now.rests:
                return
            at, nudge, now = point, 0.0, control.after(now, iterations, 0.0, 0.0, 1.0)
        raise Stalled(refused, "no equilibrium is near, and the body does not come to rest")

    def _point(self, at, begun, step, u, result, iterations, by) -> PathPoint:
        work = self.problem.work(u, begun, result.states, step)
        reaction, broken = float(result.residual[self.bottom].sum()), 0.0
        if (cut := self.problem.cut) is not None:
            broken = cut.broken(u, self.problem.p, begun["cohesion"], step)[0]
        return PathPoint(
            self._travel(step), u, result.states, broken, self.problem.force(result.states), reaction,
            work, iterations, step, by, begun,
        )  # fmt: skip

    def _travel(self, step: Step) -> float:
        return float(self.centre0[1] - step.centre[1])
