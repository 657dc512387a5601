"""Newton's method with a consistent tangent, a guard against inverted elements and a line search."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cutbench.case.tuning import NewtonTuning
from cutbench.forms.base import Step
from cutbench.solver.linear import SingularMatrix
from cutbench.solver.problem import Problem


class NoConvergence(ArithmeticError):
    """Newton's method gave up; ``reason`` says how. ``nearest``: the smallest residual that it came to, over
    the forces, and the displacements there."""

    def __init__(self, reason: str, nearest: tuple[float, np.ndarray] = (np.inf, np.empty(0))):
        super().__init__(reason)
        self.reason, self.nearest = reason, nearest


#: Iterations before a residual that does not fall counts as cycling.
CYCLE = 20


class BadGuess(NoConvergence):
    """The state to begin from has inverted elements, or crosses itself: another may do."""


@dataclass(frozen=True)
class NewtonSettings(NewtonTuning):
    """The tuned numbers with what a user chooses: ``tolerance`` is relative to the forces in balance."""

    tolerance: float = 1e-8


def newton(
    problem: Problem,
    u: np.ndarray,
    states: dict,
    step: Step,
    settings: NewtonSettings,
    *,
    near: bool = False,
    strict: bool = False,
):
    """Solve R(u) = 0 from the guess ``u``. Returns (u, Evaluation, iterations); raises NoConvergence.

    ``near``: the guess solves a problem that hardly differs, and the solver still has its factorization.
    Steps with that come first; they may suffice, and then no tangent is assembled. A guess with inverted
    elements, or that passes through itself, is left for a state on the way to it, unless ``strict``: then
    BadGuess is raised.
    """
    norm = problem.out_of_balance
    # Elements may lose volume, but not most of what the last step left them.
    floor = settings.smallest_ratio * min(1.0, problem.bulk.smallest_volume_ratio(step.u_old))
    if not problem.sound(u, floor):
        if strict:
            raise BadGuess("the predicted state has inverted elements, or passes through itself")
        u = on_the_way(problem, step.u_old, u, floor)
    current = problem.evaluate(u, states, step)
    size = norm(current)
    if near:
        u, current, size = _chords(problem, u, current, size, states, step, settings, learns=True)
    wrong = size > settings.far * current.scale and problem.metric is not None
    shift, history = Shift(settings.relax, settings.cautious if wrong else 0.0), []
    nearest = (np.inf, u)
    for iteration in range(settings.iterations + 1):
        if size <= settings.tolerance * current.scale:
            return u, current, iteration
        if iteration == settings.iterations:
            break
        du, alpha = _direction(problem, u, current, settings, shift, floor)
        before, base = size, (u, current)
        u, current = _search(problem, u, du, alpha, current, states, step, settings, floor)
        size = norm(current)
        if shift.now == 0 and settings.tolerance * current.scale < size < settings.close * before:
            u, current, size = _chords(problem, u, current, size, states, step, settings)
        if iteration >= CYCLE and size > 0.9 * before:
            # The active sets cycle: now the residual itself has to fall.
            size, u, current = min(
                (
                    (norm(e), base[0] + a * du, e)
                    for a, e in _shorter(problem, base[0], du, alpha, states, step)
                ),
                key=lambda item: item[0],
            )
        if not np.isfinite(size):
            raise NoConvergence("the residual is not finite")
        history.append(size / current.scale)
        nearest = min(nearest, (history[-1], u), key=lambda item: item[0])
        if iteration >= 2 * CYCLE and min(history[-CYCLE:]) > 0.5 * min(history[:-CYCLE]):
            if size <= settings.stagnant * current.scale:
                return u, current, iteration
            raise NoConvergence(
                f"residual stays at {history[-1]:.1e} of the forces after {iteration} iterations",
                nearest,
            )
    raise NoConvergence(
        f"{settings.iterations} iterations, residual {size / current.scale:.1e} of the forces", nearest
    )


def on_the_way(problem: Problem, u: np.ndarray, guess: np.ndarray, floor: float) -> np.ndarray:
    """``guess`` with its free unknowns on the way from ``u``, before elements invert or the surface meets
    itself. Raises BadGuess where ``u`` is no better."""
    start = guess.copy()
    start[problem.free] = u[problem.free]
    du = guess - start
    alpha = min(1.0, problem.room(start, du))
    for _ in range(8):
        if problem.sound(start + alpha * du, floor):
            return start + alpha * du
        alpha /= 2
    raise BadGuess("the state to begin from has inverted elements, or passes through itself")


def _chords(problem, u, current, size, states, step, settings, learns=False):
    """Go on with the old factorization while each step still takes most of the residual away.

    Near the solution the tangent hardly changes: a residual and a back-substitution cost a third of
    a full Newton step. What ``learns`` corrects the factorization by the steps taken with it (Broyden; as
    C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations, 1995, has it): the tangent is older.
    """
    goal = settings.tolerance * current.scale
    taken: list[np.ndarray] = []
    while size > goal:
        du = problem.back_substitute(current.residual, how="correction")
        if learns:
            for one, other in pairwise(taken):
                du = du + (one @ du) / (one @ one) * other
            if taken:
                du = du / (1 - (taken[-1] @ du) / (taken[-1] @ taken[-1]))
            taken.append(du)
        trial_u = u + du
        if problem.room(u, du) < 1:
            break
        trial = problem.evaluate(trial_u, states, step)
        r = problem.out_of_balance(trial)
        if not r < settings.chord * size:
            break
        u, current, size = trial_u, trial, r
    # The scale may have fallen below what the goal was set by: then Newton's method goes on from here.
    return u, current, size


@dataclass
class Shift:
    """Regularisation in units of the shear modulus, and whether the last iteration had to raise it."""

    relax: float
    now: float = 0.0
    raised: bool = False

    def relaxed(self) -> float:
        """What to try next: little less where less has just failed."""
        value = self.now / (2.0 if self.raised else self.relax)
        return value if value > 0.05 else 0.0


def _direction(problem, u, current, settings, shift, floor):
    """Newton direction, and the part of it that inverts no element; ``shift`` keeps the regularisation it
    needed.

    Where softening makes the tangent indefinite or nearly singular, the direction leads uphill or far
    away: further than ``trust``, or than small elements bear. A multiple of the Laplacian added to the
    tangent shortens and turns it (Levenberg, Marquardt).
    """
    free, moving = problem.free, problem.displacements
    shift.now = shift.relaxed()
    best = None
    for attempt in range(8):
        data = current.data
        if shift.now != 0:
            data = data + shift.now * problem.shear_modulus * problem.metric
        fault = None
        try:
            problem.factorize(data)
            du = problem.back_substitute(current.residual, how="direction")
            largest = np.abs(du[moving]).max()
            if np.isfinite(largest):
                alpha = min(1.0, settings.reach / largest) if largest > 0 else 1.0
                while alpha > 1e-3 and problem.bulk.smallest_volume_ratio(u + alpha * du) <= floor:
                    alpha /= 2
                # What is in the way pushes back in the next iteration: no reason to regularise.
                free_way = problem.room(u, alpha * du)
                downhill = du[free] @ current.residual[free] < 0
                if downhill and largest <= settings.trust and alpha >= settings.whole:
                    shift.raised = attempt > 0
                    return du, alpha * min(1.0, free_way)
                alpha *= min(1.0, free_way)
                if alpha > 1e-3 and (best is None or (downhill and largest <= settings.trust)):
                    best = du, alpha
            else:
                fault = "the linear solution is not finite"
        except SingularMatrix as error:
            fault = f"singular tangent: {error}"
        if problem.metric is None or shift.now > settings.largest_shift:
            break
        shift.now = max(1.0, 4 * shift.now)
    if best is None:
        raise NoConvergence(fault or "elements invert along the Newton direction")
    return best


def _shorter(problem, u, du, alpha, states, step):
    for part in (0.5, 0.25, 0.1):
        yield part * alpha, problem.evaluate(u + part * alpha * du, states, step)


def _search(problem, u, du, alpha, current, states, step, settings, floor):
    """Along ``du``, find where the work of the residual on it has fallen well below its start.

    This is the energy line search of Matthies and Strang (1979): where contact and damage switch, a
    full step can jump between two branches for ever; the residual's norm need not tell. The evaluation that
    is returned has no tangent: the last ones are not asked for theirs.
    """
    free, moving = problem.free, problem.displacements
    direction = du[free]
    start = float(direction @ current.residual[free])
    e = problem.evaluate(u + alpha * du, states, step)
    if start >= 0:  # not a descent direction: an indefinite tangent, the full step is as good as any
        return u + alpha * du, e
    low, s_low, high, s_high = 0.0, start, alpha, float(direction @ e.residual[free])
    best = (abs(s_high), alpha, e)
    largest = np.abs(du[moving]).max()
    # Sliding down a long slope (a snap under way): go on while the forces still push.
    while s_high < (settings.slack - 1) * abs(start) and 2 * high * largest <= settings.reach:
        if problem.bulk.smallest_volume_ratio(u + 2 * high * du) <= floor:
            break
        if problem.room(u, 2 * high * du) < 1:
            break
        low, s_low = high, s_high
        high *= 2
        e = problem.evaluate(u + high * du, states, step)
        s_high = float(direction @ e.residual[free])
        if s_high <= 0 or s_high < best[0]:
            best = (abs(s_high), high, e)
    for _ in range(6):  # each costs a third of an iteration
        if best[0] <= settings.slack * abs(start) or s_high <= 0:
            break
        trial = high - s_high * (high - low) / (s_high - s_low)
        trial = min(max(trial, low + 0.1 * (high - low)), high - 0.1 * (high - low))
        e = problem.evaluate(u + trial * du, states, step)
        s = float(direction @ e.residual[free])
        if abs(s) < best[0]:
            best = (abs(s), trial, e)
        if s <= 0:
            low, s_low = trial, s
        else:  # beyond the minimum, or where an element inverted and nothing is finite
            high, s_high = trial, s if np.isfinite(s) else -start
    return u + best[1] * du, best[2]
