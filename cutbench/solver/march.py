"""Steps of blade travel: prediction, Newton, step control, contact updates, energy ledger."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cutbench.case.motion import Motion
from cutbench.forms.base import Step
from cutbench.solver.fixed_point import FixedPointIteration
from cutbench.solver.newton import BadGuess, NewtonSettings, NoConvergence
from cutbench.solver.predictor.history import History
from cutbench.solver.predictor.window import Window
from cutbench.solver.problem import Evaluation, Problem, damage_growth
from cutbench.solver.step_control import SETTLES, StepControl, StepRules, StepState


class Load:
    """What drives a march: a blade, which forms know by its place. Of the meshed part."""

    def force(self, problem: Problem, found: Evaluation) -> float:
        """Force along the travel, N."""
        return problem.force(found.states)

    def begun(self, u: np.ndarray, before: float, travel: float) -> np.ndarray:
        """Where a step from ``u``, at the travel ``before``, is looked for that goes on from none."""
        return u

    def placed(self, guess: np.ndarray, travel: float) -> np.ndarray:
        """``guess`` with the displacements that are given at ``travel``."""
        return guess


@dataclass
class _Found:
    """What was found for a step from ``begun``, where the blade's ``drive`` was ``drive_before``.

    Force and work are computed when they are asked for: many steps are refused before.
    """

    problem: Problem
    load: Load
    begun: dict[str, dict]
    step: Step
    drive_before: float
    slice_push: float
    u: np.ndarray
    result: Evaluation
    effort: list[int]
    solves: list

    @cached_property
    def work(self) -> dict[str, float]:
        return self.problem.work(self.u, self.begun, self.result.states, self.step)

    @cached_property
    def force(self) -> float:
        return self.load.force(self.problem, self.result)

    @cached_property
    def along(self) -> float:
        """The blade's force along its edge, where it goes that way."""
        return self.problem.force_along(self.result.states) if self.slice_push else 0.0

    @property
    def drive(self) -> float:
        """The blade's work per travel, N."""
        return self.force + self.slice_push * self.along

    @cached_property
    def spent(self) -> float:
        """The blade's work."""
        moved = float(np.real(self.step.centre_old - self.step.centre)[1])
        return (self.drive_before + self.drive) / 2 * moved

    @cached_property
    def left(self) -> float:
        """What the ledger leaves open of it."""
        return self.spent - sum(self.work.values())


@dataclass(frozen=True)
class Given:
    """A step to take instead of choosing one: its length in mm, 0 at rest, and the damping in units of its
    value; ``u``: displacements at its end in a march that hardly differs, from which they are looked for."""

    advance: float
    damping_factor: float = 1.0
    u: np.ndarray | None = None


@dataclass(frozen=True)
class Progress:
    """What a march is between two steps: enough to go on. ``pseudo_time_mm`` as in ``Accepted``."""

    pseudo_time_mm: float
    u: np.ndarray
    states: dict[str, dict]
    control: StepState
    u_before: np.ndarray | None = None
    size_before: float | None = None
    #: The blade's work per travel, N.
    drive: float = 0.0
    #: The blade's work so far, and what of it the ledger has left open.
    spent: float = 0.0
    left: float = 0.0
    #: What a new mesh has added, by mechanism, to the work that the state holds: forces give it back when
    #: they balance there.
    added: dict[str, float] = field(default_factory=dict)
    #: Whether damping had been raised on the way: rates of second order begin anew.
    jumped: bool = False
    #: Steps that predictions are made from.
    past: dict[str, list] | None = None

    def tree(self) -> dict:
        """As dictionaries of numbers and arrays."""
        return {**vars(self), "control": vars(self.control)}

    @classmethod
    def of(cls, tree: dict) -> Progress:
        """From what ``tree`` gave."""
        return cls(**{**tree, "control": StepState(**tree["control"])})


@dataclass(frozen=True)
class Accepted:
    """A converged step. ``pseudo_time_mm``: its end in the motion's time, × speed; what steps at rest take is
    in ``dt`` alone. ``along``: the force against the blade's way along its edge."""

    travel: float
    pseudo_time_mm: float
    dt: float
    u: np.ndarray
    states: dict[str, dict]
    force: float
    along: float
    reaction: float
    work: dict[str, float]
    #: What a new mesh has added, by mechanism, to the work that the state held at its beginning.
    added: dict[str, float]
    iterations: int
    step: Step
    #: Each inner solve: the states it began from and the displacements it found (one without augmentations).
    solves: list[tuple[dict[str, dict], np.ndarray]]
    #: The blade has been held meanwhile, and damping raised: a state between two points of the curve.
    between: bool
    #: Where the march goes on.
    progress: Progress
    #: Why steps from the same place were refused before.
    refused: tuple[str, ...]
    #: The step itself, to take it again.
    given: Given


class Stalled(ArithmeticError):
    """No step that may be tried converges; ``refused``: why not, the last one last."""

    def __init__(self, refused: Sequence[str], reason: str):
        super().__init__(reason)
        self.refused, self.reason = tuple(refused), reason


@dataclass(frozen=True)
class March:
    """Drive the blade through its ``motion``: iterate over ``steps`` to get each accepted one.

    ``centre0`` (3,): the blade's apex at zero travel; it moves along −y, and along z where it slices.
    """

    problem: Problem
    centre0: np.ndarray
    motion: Motion
    bottom: np.ndarray  # degrees of freedom whose reaction balances the blade's force
    rules: StepRules = field(default_factory=StepRules)
    newton: NewtonSettings = field(default_factory=NewtonSettings)
    #: What happened some elements higher: how fast the cut grows, and what the window guesses.
    past: History | None = None
    #: Looks for the next state around the front first.
    window: Window | None = None
    load: Load = field(default_factory=Load)

    @property
    def speed(self) -> float:
        """Way per time, mm/s."""
        return self.motion.speed

    def centre(self, travel: float) -> np.ndarray:
        return self.centre0 + travel * np.array([0.0, -1.0, self.motion.slice_push])

    def __iter__(self) -> Iterator[Accepted]:
        return self.steps()

    def steps(
        self, begin: Progress | None = None, given: Iterable[Given] | None = None
    ) -> Iterator[Accepted]:
        """Each accepted step from ``begin`` on, or from rest, to the end of the motion, or of the steps
        ``given``. Raises Stalled.
        """
        problem, rules, motion = self.problem, self.rules, self.motion
        now = begin or Progress(
            0.0, np.zeros(problem.ndof), problem.start(), StepState(min(rules.first, rules.largest))
        )
        if self.past is not None:
            self.past.restore(now.past)
        control = StepControl(rules, any(form.name == "damping" for form in problem.forms))
        plan, pace, refused = None if given is None else iter(given), now.control, []
        while pace.rests or now.pseudo_time_mm < motion.end * (1 - 1e-9):
            known = None
            if plan is not None:
                given_step = next(plan, None)
                if given_step is None:
                    return
                pace, known = pace.with_next_step(given_step.advance, given_step.damping_factor), given_step.u
            if not pace.rests:
                pace = replace(pace, size=min(pace.size, motion.room(now.pseudo_time_mm)))
            pseudo_time_mm, u, states, size = now.pseudo_time_mm, now.u, now.states, pace.advance
            travel, ahead = motion.travel(pseudo_time_mm), motion.travel(pseudo_time_mm + size)
            straight, ratio = _straight(now, pace)
            smooth = (
                not now.jumped and ratio <= rules.ratio and pace.damping_factor == 1 and rules.second_order
            )
            step = Step(
                control.duration(pace) / self.speed, u, self.centre(ahead), self.centre(travel),
                pace.damping_factor, ratio=ratio if smooth else 0.0, rests=pace.rests,
            )  # fmt: skip
            begun, whole = problem.touched(states, step), self.whole(states)
            if straight is not None:
                straight = self.load.placed(straight, ahead)
            try:
                if now.jumped and ratio and not self._nearer(straight, u, begun, step):
                    straight = None
                straight = self._improved(straight, known, u, begun, step)
                found = self._first_converged_step(u, straight, begun, step, now.drive, travel, ahead)
                growth, nascent = (damage_growth(states, found.result.states, at) for at in (~whole, whole))
                # What the ledger leaves open is the error of the step, against the blade's work over the
                # largest step: within a small jump of a fine step nothing is gained by closing better than
                # that. A blade at rest is taken as one that moves.
                most = (abs(now.drive) + abs(found.drive)) / 2 * max(size, rules.largest)
                left = found.left - sum(now.added.values())
                defect = abs(left) / max(most, 1e-300)
                allowed = control.allowed(size, found.spent, left, now.spent, now.left)
                if plan is None:
                    control.check(pace, growth, defect, allowed, nascent)
            except NoConvergence as error:
                refused.append(f"{travel:.4f} mm, step {size:.2g} mm: {error.reason}")
                less = control.shorter(pace, error, pseudo_time_mm > 0) if plan is None else None
                if less is None:
                    raise Stalled(refused, error.reason) from error
                pace = less
                continue
            if self.past is not None:
                damage = np.real(found.result.states["cohesion"]["damage"])
                self.past.add(ahead, found.u, damage)
            u_before, size_before, jumped = _last_step(now, pace, found.u)
            taken, effort, added = pace, found.effort, now.added
            pace = control.after(pace, max(effort), growth, defect, allowed, nascent)
            pseudo_time_mm += size
            if motion.turns(pseudo_time_mm):
                u_before, pace = None, replace(pace, size=min(pace.size, rules.first))
            now = Progress(
                pseudo_time_mm, found.u, found.result.states, pace, u_before, size_before, found.drive,
                spent=now.spent + found.spent, left=now.left + left, jumped=jumped,
                past=None if self.past is None else self.past.state(),
            )  # fmt: skip
            yield Accepted(
                ahead, pseudo_time_mm, step.dt, found.u, found.result.states, found.force, found.along,
                found.result.residual[self.bottom].sum(), found.work, added, sum(effort), step, found.solves,
                taken.between, now, tuple(refused), Given(size, step.damping_factor, found.u),
            )  # fmt: skip
            refused = []

    def whole(self, states: dict[str, dict]) -> np.ndarray:
        """Which points of the cut plane (n,) lie where the cut has not begun in ``states``; none where
        elements are too large to tell."""
        cut, window = self.problem.cut, self.window
        if cut is None or window is None or self.past is None:
            return np.zeros(0 if cut is None else cut.faces.w.size, bool)
        lengths = window.strips.lengths(cut.cut_area(states["cohesion"]))
        return (lengths < self.rules.begun)[window.strips.at]

    def _nearer(self, guess, u, states, step) -> bool:
        """Whether ``guess`` leaves less of the forces than ``u``, the last state, does."""
        floor = self.newton.smallest_ratio * min(1.0, self.problem.bulk.smallest_volume_ratio(u))
        left, as_before = (self.problem.left(v, states, step, floor) for v in (guess, u))
        return left < as_before

    def _improved(self, straight, known, last, states, step) -> np.ndarray | None:
        """A better prediction than ``straight``: what is ``known``, or what the front's own solution says.
        None where the last state is better to begin from."""
        if known is not None:
            return known
        if straight is None or self.window is None:
            return straight
        began = time.perf_counter()
        try:
            return self.window.solved(straight, last, states, step, self.newton)
        except BadGuess:
            return straight
        except NoConvergence:
            # The whole may yield where a part does not. A shorter step is cheaper, where there is one.
            if abs(step.centre[1] - step.centre_old[1]) > self.rules.finest:
                raise
            return None
        finally:
            self.problem.timer.add("window", began)

    def _first_converged_step(self, u, straight, states, step, drive, before, travel) -> _Found:
        """A step from ``straight``; where it is None, or has elements inside out, from the last state."""
        try:
            guess = self.load.begun(u, before, travel) if straight is None else straight
            return self._found(guess, states, step, drive)
        except BadGuess:
            if straight is None:
                raise
            return self._found(self.load.placed(u, travel), states, step, drive)

    def _found(self, guess, states, step, drive) -> _Found:
        held = FixedPointIteration(self.problem, self.newton, self.rules.augmentations, self.rules.staggered)
        u, result = held.solved(guess, states, step)
        start = states, step, drive, self.motion.slice_push
        return _Found(self.problem, self.load, *start, u, result, held.effort, held.solves)


def _straight(now: Progress, pace: StepState) -> tuple[np.ndarray | None, float]:
    """Where a straight line through the last two states leads in the next step, if there is one, and that
    step's length by the last one's."""
    if pace.rests:
        return now.u, 0.0
    if now.u_before is None or now.size_before is None:
        return None, 0.0
    ratio = pace.advance / now.size_before
    return now.u + (now.u - now.u_before) * ratio, ratio


def _last_step(now: Progress, pace: StepState, u: np.ndarray) -> tuple[np.ndarray | None, float | None, bool]:
    """What predictions after a step from ``now`` to ``u`` begin from: the displacements before it, its length
    in mm, and whether damping had been raised."""
    if pace.blade == SETTLES:
        # Another mesh, the same way: what the last step did goes on.
        return None if now.u_before is None else now.u_before + u - now.u, now.size_before, now.jumped
    if pace.rests:
        return now.u_before, now.size_before, True
    return now.u, pace.advance, pace.between
