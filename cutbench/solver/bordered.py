"""Newton's method for an equilibrium together with the blade's travel: the growth ΔC of the cut is given.

For R(u, travel) = 0 and C(u) − C(u_old) = ΔC each iteration factorizes the tangent K once and solves twice:
K w = −R and K v = −∂R/∂travel; then δtravel = (ΔC − [C(u) − C(u_old)] − C'·w)/(C'·v), δu = w + δtravel v.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cutbench.forms.base import Step
from cutbench.forms.cut import CutForm
from cutbench.mechanisms.base import STEP
from cutbench.solver.linear import SingularMatrix
from cutbench.solver.newton import NewtonSettings, NoConvergence
from cutbench.solver.problem import Problem


def step_to(
    centre0: np.ndarray, travel: float, before: float, u_old: np.ndarray, damping_factor: float = 0.0
) -> Step:
    """A step of the blade from the travel ``before``, mm, in 1 s; undamped, it has nothing of time."""
    down = np.array([0.0, 1.0, 0.0])
    return Step(1.0, u_old, centre0 - travel * down, centre0 - before * down, damping_factor)


#: At the most: where Newton's method needs more, another branch is found.
ITERATIONS = 10


class Bordered:
    """Finds u and the travel where C, the damage summed over the plane of ``cut``, has grown as asked."""

    def __init__(
        self,
        problem: Problem,
        cut: CutForm,
        centre0: np.ndarray,
        settings: NewtonSettings,
    ):
        self._problem, self._cut, self._centre0 = problem, cut, centre0
        self._settings = settings
        #: Whether C counts where the cut is made, or else all damage.
        self.local = True
        zero = np.zeros(problem.ndof)
        self._slopes = {True: zero, False: zero}

    def solve(self, amount, old, travel, states, broken, u, reached):
        """From ``old`` at ``travel``, where C is ``broken``, on by ``amount`` of C, first looked for at ``u``
        and the travel ``reached``. Returns (Step, u, Evaluation, iterations) or raises NoConvergence."""
        problem, settings = self._problem, self._settings
        moving = problem.displacements
        floor = settings.smallest_ratio * min(1.0, problem.bulk.smallest_volume_ratio(old))
        if not problem.sound(u, floor):
            raise NoConvergence("the predicted state has inverted elements, or passes through itself")
        current, C, slope, step = self._evaluated(u, reached, travel, states, old)
        for iteration in range(ITERATIONS + 1):
            gap = amount - (C - broken)
            size, worst = problem.out_of_balance(current), problem.relative_residual(current)
            if not np.isfinite(size):
                raise NoConvergence("the residual is not finite")
            near = settings.tolerance if iteration < ITERATIONS else settings.stagnant
            if worst <= near and abs(gap) <= 1e-6 * amount:
                return step, u, current, iteration
            if iteration == ITERATIONS:
                break
            try:
                problem.factorize(current.data)
                w = problem.back_substitute(current.residual)
                v = problem.back_substitute(self._residual_by_travel(u, states, step))
            except SingularMatrix as error:
                raise NoConvergence(f"singular tangent: {error}") from error
            speed = float(slope @ v)
            if speed == 0.0:
                raise NoConvergence("nothing breaks here")
            way = (gap - float(slope @ w)) / speed
            du = w + way * v
            largest = max(np.abs(du[moving]).max(), abs(way))
            if not np.isfinite(largest):
                raise NoConvergence("the linear solution is not finite")
            alpha = min(1.0, settings.reach / largest) if largest > 0 else 1.0
            while problem.bulk.smallest_volume_ratio(u + alpha * du) <= floor:
                alpha /= 2
                if alpha < 1e-3:
                    raise NoConvergence("elements invert along the Newton direction")
            alpha *= min(1.0, problem.room(u, alpha * du))
            # A step may raise the residual at first; later that is contact or damage switching to and fro.
            allowed = 2.0 if iteration < 3 else 0.9
            best = None
            for part in (1.0, 0.5, 0.25, 0.1, 0.03):
                trial = (u + part * alpha * du, reached + part * alpha * way)
                seen = self._evaluated(*trial, travel, states, old)
                r = problem.out_of_balance(seen[0])
                if np.isfinite(r) and (best is None or r < best[0]):
                    best = (r, trial, seen)
                if r <= allowed * max(size, settings.tolerance * current.scale):
                    break
            if best is None:
                raise NoConvergence("the residual is not finite")
            (u, reached), (current, C, slope, step) = best[1:]
        raise NoConvergence(f"{iteration} iterations, residual {worst:.1e} of the forces")

    def _evaluated(self, u, reached, travel, states, old):
        step = step_to(self._centre0, reached, travel, old)
        current = self._problem.evaluate(u, states, step)
        return current, *self.broken(u, states, step), step

    def _residual_by_travel(self, u, states, step) -> np.ndarray:
        """∂R/∂travel (ndof,): the blade moves against a body that stands still."""
        moving = replace(step, centre=step.centre - 1j * STEP * np.array([0.0, 1.0, 0.0]))
        out = np.zeros(self._problem.ndof)
        for form in self._problem.blades:
            local = form.evaluate(u, self._problem.p, states[form.name], moving)
            out += self._problem.pattern.vector(form.name, local.vector).imag / STEP
        return out

    def broken(self, u, states, step) -> tuple[float, np.ndarray]:
        """C and its derivative (ndof,)."""
        C, local = self._cut.broken(u, self._problem.p, states["cohesion"], step, self.local)
        slope = self._problem.pattern.vector("cohesion", local)
        slope[self._problem.fixed] = 0.0
        if slope.any():
            self._slopes[self.local] = slope
        # At the start of a step, and where a trial has unloaded all, nothing grows: what grew last will do.
        own = self._slopes[self.local]
        return C, own if own.any() else self._slopes[not self.local]
