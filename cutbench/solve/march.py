"""Steps of blade travel: prediction, Newton, step control, contact updates, energy ledger."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cutbench.forms.base import Step
from cutbench.motion import Motion
from cutbench.solve.newton import NewtonSettings, NoConvergence, newton
from cutbench.solve.predict import Past
from cutbench.solve.problem import Evaluation, Problem, damage_growth
from cutbench.solve.window import Window

#: Staggered scheme: repetitions at the most, and the change of damage at which it stands still.
STAGGERED_LOOPS = 200
STAGGERED_TOLERANCE = 1e-4
#: Residual over the forces at which a loop ends whose damage is not yet the last.
STAGGERED_INNER = 1e-5
#: The damping is raised to this many times its value before a run gives up.
LARGEST_BOOST = 1e7
#: And to this before a step is taken whose energy does not close: within a jump it then spreads over several.
LEAKY_BOOST = 1e4
#: Where the ledger has left more than this part of the blade's whole work open, steps that add to it are held
#: to a quarter of what they may leave open otherwise: errors of one sign must not add up.
DRIFT = 0.005
#: What the ledger may leave open in a step that was foreseen from an element higher: of the step's own work,
#: and in units of what is allowed otherwise; where the ledger drifts, a tenth of it.
CREDIBLE = 2.0
#: Such a prediction is tried where it leaves less than this part of the residual of a straight one.
BETTER = 0.5


@dataclass(frozen=True)
class StepRules:
    """Blade travel per step in mm: largest, smallest, first; targets that change it."""

    largest: float = 0.1
    smallest: float = 1e-4
    first: float = 0.02
    damage: float = 0.2
    iterations: int = 6
    grow: float = 1.5
    shrink: float = 0.5
    tenth: float = 0.1
    augmentations: int = 0
    #: Largest part of the blade's work in a step that the ledger may leave open.
    defect: float = 0.05
    #: Below this step, in mm, where Newton's method fails the next one is a tenth: a snap has begun.
    gentle: float = 0.03
    #: After so many refused steps since the last one as long as that it is no snap, and damping is raised at
    #: any step below it until one is as long again.
    patience: int = 40
    #: Below this step, in mm, one whose energy does not close is taken where damping has been raised in vain.
    finest: float = 5e-3
    #: Damage is held during Newton's method and updated until it stands still (the paper's scheme).
    staggered: bool = False
    #: A tenth of the step when damage grew by more than ``damage``, else five times (the paper's rule).
    paper: bool = False


class _Leaky(NoConvergence):
    """A step that converged, but whose energy does not close."""


@dataclass
class _Found:
    """What was found for a step from ``begun``, where the blade's force was ``force_before``.

    Force and work are computed when they are asked for: many steps are refused before.
    """

    problem: Problem
    begun: dict[str, dict]
    step: Step
    force_before: float
    u: np.ndarray
    result: Evaluation
    effort: list[int]
    solves: list

    @cached_property
    def work(self) -> dict[str, float]:
        return self.problem.work(self.u, self.begun, self.result.states, self.step)

    @cached_property
    def force(self) -> float:
        return self.problem.force(self.result.states)

    @cached_property
    def spent(self) -> float:
        """The blade's work."""
        moved = float(np.real(self.step.centre_old - self.step.centre)[1])
        return (self.force_before + self.force) / 2 * moved

    @cached_property
    def left(self) -> float:
        """What the ledger leaves open of it."""
        return self.spent - sum(self.work.values())


def _drifts(spent: float, left: float, spent_before: float, left_before: float) -> bool:
    """Whether a step adds to what the ledger has left open so far, and that is too much already."""
    return left * left_before > 0 and abs(left_before + left) > DRIFT * (spent_before + spent)


@dataclass
class Accepted:
    """A converged step. ``way`` is its end in mm of time × speed: the travel, where the blade never rests."""

    travel: float
    way: float
    dt: float
    u: np.ndarray
    states: dict[str, dict]
    force: float
    reaction: float
    work: dict[str, float]
    iterations: int
    step: Step
    #: Each inner solve: the states it began from and the displacements it found (one without augmentations).
    solves: list[tuple[dict[str, dict], np.ndarray]]


@dataclass
class Progress:
    """What a march is between two steps: enough to go on from there. ``way`` as in ``Accepted``."""

    way: float
    size: float
    u: np.ndarray
    states: dict[str, dict]
    u_before: np.ndarray | None = None
    size_before: float | None = None
    easy: int = 0
    force: float = 0.0
    boost: float = 1.0
    #: The blade's work so far, and what of it the ledger has left open.
    spent: float = 0.0
    left: float = 0.0
    #: Steps that predictions are made from.
    past: dict[str, np.ndarray] | None = None
    #: Refused steps since the last one as long as ``StepRules.gentle``.
    refused: int = 0


@dataclass
class March:
    """Drive the blade through its ``motion``; iterate to get each accepted step.

    ``centre0`` (3,): the ellipse's centre at zero travel; the blade moves along −y.
    """

    problem: Problem
    centre0: np.ndarray
    motion: Motion
    bottom: np.ndarray  # degrees of freedom whose reaction balances the blade's force
    rules: StepRules = field(default_factory=StepRules)
    newton: NewtonSettings = field(default_factory=NewtonSettings)
    failures: list[str] = field(default_factory=list)
    stopped: str | None = None
    #: Steps to take instead of choosing them, each with its length in mm and the damping's boost.
    schedule: Sequence[tuple[float, float]] | None = None
    #: Displacements at the end of each of these steps in a march that hardly differs: looked for from there.
    known: Sequence[np.ndarray] | None = None
    #: Where to begin, if not at rest; and who is told of each step's end when the next one begins.
    resume: Progress | None = None
    at_rest: Callable[[Progress], None] | None = None
    #: Predicts from what happened one element higher, where that is asked for.
    past: Past | None = None
    #: Looks for the next state around the front first.
    window: Window | None = None

    @property
    def speed(self) -> float:
        """Way per time, mm/s."""
        return self.motion.speed

    def _centre(self, travel: float) -> np.ndarray:
        return self.centre0 - np.array([0.0, travel, 0.0])

    def __iter__(self) -> Iterator[Accepted]:
        problem, rules, motion = self.problem, self.rules, self.motion
        begin = self.resume or Progress(0.0, rules.first, np.zeros(problem.ndof), problem.start())
        way, size, u, states = begin.way, begin.size, begin.u, begin.states
        u_before, size_before, easy, force = begin.u_before, begin.size_before, begin.easy, begin.force
        spent_before, left_before, refused = begin.spent, begin.left, begin.refused
        if self.past is not None and begin.past is not None:
            self.past.restore(begin.past)
        damping = next((f for f in problem.forms if f.name == "damping"), None)
        if damping is not None:
            damping.boost = begin.boost
        plan, chosen, known = iter(self.schedule or ()), self.schedule is None, iter(self.known or ())
        while way < motion.end - 1e-9:
            if not chosen:
                size, boost = next(plan, (0.0, 1.0))
                if size == 0.0:
                    return
                if damping is not None:
                    damping.boost = boost
            size = min(size, motion.room(way))
            travel, ahead = motion.travel(way), motion.travel(way + size)
            step = Step(size / self.speed, u, self._centre(ahead), self._centre(travel))
            begun = problem.touched(states)
            straight = None if u_before is None else u + (u - u_before) * (size / size_before)
            known_end = next(known, None)
            try:
                drift = (spent_before, left_before)
                if known_end is not None:
                    straight = known_end
                elif straight is not None and self.window is not None:
                    began = time.perf_counter()
                    try:
                        straight = self.window.solved(straight, u, begun, step, self.newton)
                    finally:
                        problem.timer.add("window", began)
                found = self._first_that_holds(u, straight, begun, step, size, force, drift)
                growth = damage_growth(states, found.result.states)
                if chosen and not rules.paper and growth > 2 * rules.damage and size > 4 * rules.smallest:
                    raise NoConvergence(f"damage grew by {growth:.2f}")
                # What the ledger leaves open is the error of the step.
                spent, left = found.spent, found.left
                # Against the blade's work over the largest step: within a small jump of a fine step
                # nothing is gained by closing better than that. A blade at rest is taken as one that moves.
                whole = (abs(force) + abs(found.force)) / 2 * max(size, rules.largest)
                able = damping is not None and damping.boost < LEAKY_BOOST
                defect = abs(left) / max(whole, 1e-300)
                allowed = rules.defect / 4 if _drifts(spent, left, *drift) else rules.defect
                if chosen and not rules.paper and defect > allowed and (size > rules.finest or able):
                    raise _Leaky(f"the energy of the step closes only to {defect:.0%}")
            except NoConvergence as error:
                self.failures.append(f"{travel:.4f} mm, step {size:.2g} mm: {error.reason}")
                easy = 0
                if not chosen:
                    self.stopped = error.reason
                    return
                # To a jump a smaller step is what more damping is. But the blade drags what it moves against
                # raised damping, a force of the method's own: it goes a short way then.
                refused += 1
                crawls, leaky = refused > rules.patience, isinstance(error, _Leaky)
                least = rules.smallest if not crawls else rules.finest if leaky else rules.gentle
                if size > least:
                    snaps = way > 0 and size <= rules.gentle and not leaky
                    size = max(size * (rules.tenth if snaps else rules.shrink), rules.smallest)
                elif crawls and damping is not None and size < rules.finest:
                    size, damping.boost = rules.finest, 10.0
                elif damping is not None and damping.boost < LARGEST_BOOST:
                    damping.boost = max(10.0, damping.boost * 10)
                else:
                    self.stopped = error.reason
                    return
                continue
            states = found.result.states
            u_before, size_before = u, size
            u, way = found.u, way + size
            force = found.force
            spent_before, left_before = spent_before + spent, left_before + left
            reaction = found.result.residual[self.bottom].sum()
            if self.past is not None:
                self.past.add(ahead, u, np.real(states["cohesion"]["damage"]))
            effort = found.effort
            yield Accepted(
                ahead, way, step.dt, u, states, force, reaction, found.work, sum(effort), step, found.solves
            )
            easy = easy + 1
            hardest = max(effort)
            if damping is not None:
                damping.boost = max(1.0, damping.boost * 0.6)
            if rules.paper:
                size = (
                    max(size / 10, rules.smallest) if growth > rules.damage else min(5 * size, rules.largest)
                )
            elif hardest > rules.iterations + 3 or growth > rules.damage or defect > 0.7 * allowed:
                size = max(0.7 * size, min(size, rules.smallest))
            elif (
                hardest <= rules.iterations
                and defect < 0.35 * allowed
                and growth < 0.7 * rules.damage
                and easy > 1
            ):
                size = min(size * rules.grow, rules.largest)
            if size_before >= rules.gentle:
                refused = 0
            if motion.turns(way):
                u_before, size = None, min(size, rules.first)
            if self.at_rest is not None:
                boost = 1.0 if damping is None else damping.boost
                past = None if self.past is None else self.past.state()
                rest = (u_before, size_before, easy, force, boost, spent_before, left_before, past, refused)
                self.at_rest(Progress(way, size, u, states, *rest))

    def _first_that_holds(self, u, straight, states, step, size, force, drift) -> _Found:
        """A step from the better of two predictions: a straight line, and what happened one element higher.

        Where the second leads to a state that energy does not lead to, it has jumped ahead of a snap: then
        the first decides. It stays with a state for as long as there is equilibrium near it.
        """
        repeated = None if self.past is None or straight is None else self.past.guess(size, u)
        guesses = [guess for guess in (straight, u) if guess is not None]
        if repeated is not None and self._misses(repeated, states, step) < BETTER * self._misses(
            straight, states, step
        ):
            try:
                found = self._found(repeated, states, step, force)
                part = CREDIBLE * self.rules.defect
                if _drifts(found.spent, found.left, *drift):
                    part /= 10
                if abs(found.left) <= part * abs(found.spent):
                    return found
            except NoConvergence:
                pass
        for i, guess in enumerate(guesses):
            try:
                return self._found(guess, states, step, force)
            except NoConvergence as error:
                # The last state is a better start only where the prediction itself was unusable.
                if i == len(guesses) - 1 or "predicted" not in error.reason:
                    raise
        raise AssertionError("a march always has its last state to begin from")

    def _misses(self, u, states, step) -> float:
        """Residual over the forces in balance."""
        e = self.problem.evaluate(u, states, step, tangent=False)
        size = float(np.linalg.norm(e.residual[self.problem.free])) / e.scale
        return size if np.isfinite(size) else np.inf

    def _found(self, guess, states, step, force) -> _Found:
        return _Found(self.problem, states, step, force, *self._solve(guess, states, step))

    def _solve(self, u, states, step):
        """Newton's method, inside the loops that hold damage or multipliers (none by default).

        Returns displacements, evaluation, the iterations of each inner solve, and what each began from
        and found.
        """
        u, result, effort = self._hold_damage(u, states, step)
        solves = [(states, u)]
        for _ in range(self.rules.augmentations):
            states = {**states}
            for form in self.problem.blades:
                held = form.augment(result.states[form.name])["multiplier"]
                states[form.name] = {**states[form.name], "multiplier": held}
            u, result, more = self._hold_damage(u, states, step)
            effort = effort + more
            solves.append((states, u))
        return u, result, effort, solves

    def _hold_damage(self, u, states, step):
        if not self.rules.staggered or "cohesion" not in states:
            u, result, iterations = newton(self.problem, u, states, step, self.newton)
            return u, result, [iterations]
        cut = next(f for f in self.problem.forms if f.name == "cohesion")
        held, effort = states["cohesion"], []
        settings = replace(self.newton, tolerance=max(STAGGERED_INNER, self.newton.tolerance))
        for _ in range(STAGGERED_LOOPS):
            cut.held = True
            try:
                # From one loop to the next only the damage changes, and that less and less.
                u, _, iterations = newton(
                    self.problem, u, {**states, "cohesion": held}, step, settings, near=any(effort)
                )
            finally:
                cut.held = False
            effort.append(iterations)
            # The state that this opening leads to, from the damage at the start of the step.
            grown = cut.evaluate(u, self.problem.p, states["cohesion"], step, tangent=False).state
            change = np.abs(grown["damage"] - held["damage"]).max(initial=0.0)
            held = grown
            if change < STAGGERED_TOLERANCE:
                if settings is self.newton:
                    return u, self.problem.evaluate(u, states, step, tangent=False), effort
                settings = self.newton
        raise NoConvergence(f"damage still changes by {change:.1e} after {STAGGERED_LOOPS} staggered loops")
