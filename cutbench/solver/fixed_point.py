"""A fixed-point iteration: damage and multipliers are held while Newton's method solves, and taken anew until
both stand still.

Both are taken anew together: a loop for one of them inside that of the other ends at the same place, after as
many solutions as the product of theirs. Where contact is soft beside the body such a loop leaves nine tenths
of an error. So the staggered one goes on from a mixture of its last places (Anderson, J. ACM 12, 1965, 547).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cutbench.forms.base import Step
from cutbench.solver.newton import NewtonSettings, NoConvergence, newton
from cutbench.solver.problem import Evaluation, Problem

#: Places that are mixed: the last ones.
MIXING_DEPTH = 6
#: A change so many times as long as the last one says that the places before are of other contacts.
MAX_CHANGE_RATIO = 4.0
#: Repetitions at the most.
LOOPS = 200
#: Change of damage below which a loop has found where it goes: before, a front that jumps may end elsewhere
#: where the loop is another.
SMALL_DAMAGE_CHANGE = 0.01
#: Part of its residual that a solution may leave from there on: what is held changes more.
INNER_RESIDUAL_FRACTION = 0.2


class AndersonMixing:
    """Of the places that x ← G(x) led to last the combination for which the changes G(x) − x cancel best."""

    def __init__(self) -> None:
        self._past: list[tuple[np.ndarray, np.ndarray]] = []

    def mixed(self, found: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Where to go on instead of at ``found`` = G(x), where ``change`` is G(x) − x in any measure."""
        if self._past and not self._goes_on(change, self._past[-1][1]):
            self._past.clear()
        self._past = [*self._past[1 - MIXING_DEPTH :], (found, change)]
        if len(self._past) == 1:
            return found
        places, changes = (np.array(each[:-1]) - each[-1] for each in zip(*self._past, strict=True))
        weights = np.linalg.lstsq(changes @ changes.T, -changes @ change, rcond=1e-10)[0]
        return found + weights @ places

    def _goes_on(self, change: np.ndarray, last: np.ndarray) -> bool:
        """The same is held as before, and changes as it did."""
        return change.size == last.size and np.linalg.norm(change) <= MAX_CHANGE_RATIO * np.linalg.norm(last)


class FixedPointIteration:
    """The loop of one step: holds multipliers for ``updates`` at the most, and damage if ``staggered``."""

    def __init__(self, problem: Problem, settings: NewtonSettings, updates: int, staggered: bool):
        self._problem, self._settings, self._updates = problem, settings, updates
        self._cut, self._mixing = problem.cut if staggered else None, AndersonMixing()
        #: Iterations of each solution.
        self.effort: list[int] = []
        #: What solutions began from and what they found, the last ones of those with the same multipliers.
        self.solves: list[tuple[dict, np.ndarray]] = []

    def solved(self, u: np.ndarray, states: dict, step: Step) -> tuple[np.ndarray, Evaluation]:
        """Displacements and their evaluation, from the guess ``u``. Raises NoConvergence."""
        settings, p, cut = self._settings, self._problem.p, self._cut
        held, exact, calm, place = states.get("cohesion", {}), cut is None, False, step.u_old
        inner = step if exact else replace(step, damage_held=True)
        for _ in range(LOOPS):
            u, found = self._solution(u, states, held, inner, exact, calm)
            after, moved = self._augmented(states, found)
            still, grown = np.abs(moved).max(initial=0.0) <= 1, held
            if cut is not None and (still or not calm):
                # The state that this opening leads to, from the damage at the start of the step.
                grown = cut.ended(u, p, states["cohesion"], step)
                change = np.abs(grown["damage"] - held["damage"]).max(initial=0.0)
                still, calm = (
                    still and change < settings.staggered_change,
                    calm or change < SMALL_DAMAGE_CHANGE,
                )
            if still and exact:
                return u, found if cut is None else self._problem.evaluate(u, states, step)
            exact, states, held, last, place = exact or still, after, grown, place, u
            if cut is not None and calm:
                states, place = self._mixed(after, u, moved, u - last)
                held = cut.ended(place, p, states["cohesion"], step)
        raise NoConvergence(f"damage or multipliers still change after {LOOPS} loops")

    def _solution(self, u, states, held, step, exact, calm) -> tuple[np.ndarray, Evaluation]:
        """With the multipliers of ``states`` and the damage of ``held``."""
        problem, settings, begun, near = self._problem, self._settings, states, False
        if self._cut is not None:
            # From one solution to the next only what is held changes, and that less and less.
            begun, near = {**states, "cohesion": held}, any(self.effort)
        if not exact:
            enough = max(settings.staggered_tolerance, settings.tolerance)
            if calm:
                left = problem.relative_residual(problem.evaluate(u, begun, step))
                enough = max(enough, INNER_RESIDUAL_FRACTION * left)
            settings = replace(settings, tolerance=enough)
        u, found, iterations = newton(problem, u, begun, step, settings, near=near)
        self.effort.append(iterations)
        if self.solves and self.solves[-1][0] is states:
            self.solves.pop()
        self.solves.append((states, u))
        return u, found

    def _augmented(self, states: dict, found: Evaluation) -> tuple[dict, np.ndarray]:
        """``states`` with the multipliers that take over the pressures ``found``, and what these change by
        (faces,), over what counts as standing still."""
        if not self._updates:
            return states, np.zeros(0)
        self._updates -= 1
        states, moved = {**states}, []
        for form in self._problem.blades:
            before = states[form.name]["multiplier"]
            multiplier = form.augment(found.answers[form.name].state)["multiplier"]
            enough = self._settings.multipliers * (np.abs(multiplier).max() or np.abs(before).max() or 1.0)
            moved.append((multiplier - before).mean(axis=0) / enough)
            states[form.name] = {**states[form.name], "multiplier": multiplier}
        return states, np.concatenate([np.zeros(0), *moved])

    def _mixed(self, states: dict, u, moved, change) -> tuple[dict, np.ndarray]:
        """``states`` with the multipliers, and displacements whose damage, to go on from: multipliers have
        ``moved``, displacements by ``change``. The former settle last, and tell how to mix."""
        blades, at = self._problem.blades if moved.size else [], 0
        found = [states[form.name]["multiplier"][0] for form in blades]
        place = self._mixing.mixed(np.concatenate([*found, u]), moved if moved.size else change)
        for form in blades:
            before = states[form.name]["multiplier"]
            multiplier = np.maximum(place[at : at + before.shape[1]], 0.0)
            at += multiplier.size
            mixed = {**states[form.name], "multiplier": np.broadcast_to(multiplier, before.shape)}
            states = {**states, form.name: mixed}
        return states, place[at:]
