"""Paths of equilibria through snap-backs: the blade's travel is an unknown, the growth of the cut is given.

Where cutting is abrupt, equilibrium under a blade that only moves forward ends at a turning point, and the
force jumps. Behind it there are equilibria at less travel. With C(u) = ∫ d dA, the damage summed over the cut
plane, the equations are

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
from dataclasses import dataclass, field

import numpy as np

from cutbench.case.tuning import PathTuning
from cutbench.forms.base import Step
from cutbench.solver.bordered import Bordered, step_to
from cutbench.solver.newton import NewtonSettings, NoConvergence, newton
from cutbench.solver.problem import Problem, damage_growth

#: What was given at a point: travel, growth of the cut or of all damage; or nothing, the body was let go.
TRAVEL, CUT, DAMAGE, RELEASE = "travel", "cut", "damage", "release"


@dataclass
class PathPoint:
    """An equilibrium, or a state of a release. ``broken``: C in mm of the meshed part."""

    travel: float
    u: np.ndarray
    states: dict[str, dict]
    force: float
    reaction: float
    work: dict[str, float]
    iterations: int
    step: Step
    broken: float
    by: str
    #: What its step began from; its tangent is that of ``u`` on the way from there.
    begun: dict[str, dict] = field(repr=False, default_factory=dict)


@dataclass(frozen=True)
class _State:
    """Where a step begins."""

    travel: float
    u: np.ndarray
    states: dict[str, dict]
    broken: float


@dataclass(frozen=True)
class _Change:
    """What the last step changed."""

    u: np.ndarray
    travel: float
    broken: float


@dataclass
class Path:
    """Follow equilibria from rest until the blade has travelled ``depth``; iterate to get each.

    ``stopped`` says why the path ended early, None if it did not. ``bottom``: as in a march.
    """

    problem: Problem
    centre0: np.ndarray
    depth: float
    bottom: np.ndarray
    rules: PathTuning = field(default_factory=PathTuning)
    newton: NewtonSettings = field(default_factory=NewtonSettings)
    stopped: str | None = None
    failures: list[str] = field(default_factory=list)

    def __post_init__(self):
        self._damping = self.problem.damping
        self._cut = cut = self.problem.cut
        if cut is not None:
            self._bordered = Bordered(self.problem, cut, self.centre0, self.newton)

    def __iter__(self) -> Iterator[PathPoint]:
        problem, rules = self.problem, self.rules
        at = _State(0.0, np.zeros(problem.ndof), problem.start(), 0.0)
        by, amount = TRAVEL, rules.travel / 5
        before: _Change | None = None
        still = 0  # releases one after the other
        for _ in range(rules.points):
            if at.travel >= self.depth * (1 - 1e-9):
                return
            begun = self.problem.touched(at.states)
            found = self._first_converged_step(by, amount, at, begun, before)
            if found is None:
                for point in self._release(at, rules.nudge if still else 0.0):
                    yield point
                    at = _State(point.travel, point.u, point.states, point.broken)
                # Where it does not move by itself, the blade is moved on a little before it is let go.
                still += 1
                if self.stopped is None and still > 20:
                    self.stopped = "no equilibrium is near, again and again"
                if self.stopped is not None:
                    return
                by, amount, before = TRAVEL, rules.travel / 10, None
                continue
            by, amount, (step, u, result, iterations) = found
            point = self._point(at, begun, step, u, result, iterations, by)
            yield point
            still = 0
            before = _Change(u - at.u, point.travel - at.travel, point.broken - at.broken)
            at = _State(point.travel, u, point.states, point.broken)
            if iterations <= 6:
                amount *= 1.5
            by, amount = self._next(by, amount, before)
        self.stopped = f"{rules.points} points"

    def _next(self, by: str, amount: float, last: _Change) -> tuple[str, float]:
        """What is given next, and how much: the cut's growth where it grows fast against the travel."""
        rules = self.rules
        if self._cut is not None and last.broken > rules.breaks * abs(last.travel):
            if by != CUT:
                amount = max(rules.first, last.broken)
            return CUT, min(amount, rules.growth)
        if by == DAMAGE and last.travel < 0:
            return CUT, rules.first
        if by != TRAVEL:
            amount = max(abs(last.travel), rules.travel / 10)
        return TRAVEL, min(amount, rules.travel)

    def _first_converged_step(self, by, amount, at, begun, before):
        """What was given, how much, and the step that found an equilibrium; None if none did."""
        rules = self.rules
        while True:
            try:
                return by, amount, self._step(by, amount, at, begun, before)
            except NoConvergence as error:
                self.failures.append(f"{at.travel:.4f} mm, by {by}, {amount:.2g} mm: {error.reason}")
                amount /= 4
                if by == TRAVEL and self._cut is not None and amount < rules.travel / 100:
                    by, amount = CUT, rules.first  # the blade cannot go on: what breaks decides
                elif amount < rules.shortest:
                    if by != CUT:
                        break
                    by, amount = DAMAGE, rules.first
        for amount in rules.leaps if self._cut is not None else ():
            try:
                return CUT, amount, self._step(CUT, amount, at, begun, None)
            except NoConvergence as error:
                self.failures.append(f"{at.travel:.4f} mm, leap of {amount:.2g} mm: {error.reason}")
        return None

    def _step(self, by, amount, at, begun, before):
        """One step of what is given; returns (Step, u, Evaluation, iterations) or raises NoConvergence."""
        if by == TRAVEL:
            found = self._by_travel(amount, at, begun, before)
        else:
            found = self._by_cut(by, amount, at, begun, before)
        growth = damage_growth(at.states, found[2].states)
        if growth > self.rules.damage and before is not None:
            raise NoConvergence(f"damage grew by {growth:.2f}")
        moved = self._travel(found[0]) - at.travel
        turns = before is not None and before.travel * moved < 0
        if abs(moved) > (self.rules.turn if turns else self.rules.stride):
            raise NoConvergence(f"the blade moved by {moved:.2g} mm")
        if by == TRAVEL and self._cut is not None:
            grown = self._cut.broken(found[1], self.problem.p, begun["cohesion"], found[0])[0] - at.broken
            if grown > 2 * self.rules.growth:
                raise NoConvergence(f"the cut grew by {grown:.2g} mm")
        return found

    def _by_travel(self, amount, at, begun, before):
        amount = min(amount, self.depth - at.travel)
        step = step_to(self.centre0, at.travel + amount, at.travel, at.u)
        guesses = [at.u]
        if before is not None and before.travel > 0:
            guesses.insert(0, at.u + before.u * min(amount / before.travel, 1.5))
        for i, guess in enumerate(guesses):
            try:
                return step, *newton(self.problem, guess, begun, step, self.newton)
            except NoConvergence:
                if i == len(guesses) - 1:
                    raise

    def _by_cut(self, by, amount, at, begun, before):
        self._bordered.local = by == CUT
        start = at.broken
        if by != CUT:
            start = self._bordered.broken(at.u, begun, step_to(self.centre0, at.travel, at.travel, at.u))[0]
        guesses = [(at.u, at.travel)]
        if before is not None and before.broken > 0:
            ratio = min(amount / before.broken, 2.0)
            guesses.insert(0, (at.u + ratio * before.u, at.travel + ratio * before.travel))
        for i, (u, travel) in enumerate(guesses):
            try:
                return self._bordered.solve(amount, at.u, at.travel, begun, start, u, travel)
            except NoConvergence:
                if i == len(guesses) - 1:
                    raise

    def _release(self, at: _State, nudge: float) -> Iterator[PathPoint]:
        """States of a creep to rest under a still blade; sets ``stopped`` where it does not come to rest."""
        if self._damping is None:
            self.stopped = "no equilibrium is near"
            return
        drag = 1.0  # in G: elements move by a part of themselves
        for _ in range(60):
            begun = self.problem.touched(at.states)
            factor = drag * self.problem.shear_modulus / self._damping.viscosity  # over a step of 1 s
            step = step_to(self.centre0, at.travel + nudge, at.travel, at.u, factor)
            try:
                u, result, iterations = newton(self.problem, at.u, begun, step, self.newton)
                point = self._point(at, begun, step, u, result, iterations, RELEASE)
            except NoConvergence as error:
                self.failures.append(f"{at.travel:.4f} mm, released, drag {drag:.1g}: {error.reason}")
                drag = 4 * drag or 1.0
                if drag > 1e3:
                    break
                continue
            at = _State(point.travel, u, point.states, point.broken)
            yield point
            nudge = 0.0
            if drag == 0:
                return
            drag = 0.4 * drag if drag > 1e-4 else 0.0
        self.stopped = "no equilibrium is near, and the body does not come to rest"

    def _point(self, at, begun, step, u, result, iterations, by) -> PathPoint:
        work = self.problem.work(u, begun, result.states, step)
        force = self.problem.force(result.states)
        reaction = float(result.residual[self.bottom].sum())
        broken = 0.0
        if self._cut is not None:
            broken = self._cut.broken(u, self.problem.p, begun["cohesion"], step)[0]
        return PathPoint(
            self._travel(step), u, result.states, force, reaction, work, iterations, step, broken, by, begun
        )

    def _travel(self, step: Step) -> float:
        return float(self.centre0[1] - step.centre[1])
