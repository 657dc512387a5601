"""First where the cut runs, then everywhere: a prediction that has contact and damage right.

From one step to the next the tip meets other faces and the front opens other points. Newton's method spends
most of its iterations on finding which, and solves the whole block each time. So they are found on the
elements around the front alone, with the rest of the block held where a straight line has it. What is left
then is smooth, and takes one or two iterations of the whole (nonlinear elimination: Lanzkron, Rose, Wilkes,
SIAM J. Sci. Comput. 17, 1996; Cai, Li, SIAM J. Sci. Comput. 33, 2011).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cutbench.case.tuning import WindowTuning
from cutbench.forms.space import Faces, Space
from cutbench.forms.strips import Strips
from cutbench.solver.newton import BadGuess, NewtonSettings, NoConvergence, newton, on_the_way
from cutbench.solver.predictor.history import History
from cutbench.solver.predictor.sub_problem import SubProblem
from cutbench.solver.problem import Problem


class Window:
    """The part of a problem around the front of its cut."""

    def __init__(
        self,
        problem: Problem,
        space: Space,
        cut: Faces,
        thickness: float,
        past: History | None,
        tuning: WindowTuning,
    ):
        """``cut``: the faces of the cut plane, in whose strips are fronts; ``thickness`` of the blade in mm;
        ``past``: what the march remembers."""
        self._problem, self._space, self._past, self._tuning = problem, space, past, tuning
        assert problem.cut is not None, "a window is around the front of a cut"
        self._cut, self.strips = problem.cut, Strips(space, cut)
        self._strip_of = self.strips.of(space.X)
        self._height = cut.X[1].ravel()
        self._top = float(space.X[1].max())
        # Where elements are large against what the front goes in a step, neither a moved front nor other
        # parts saved anything: then nothing is remembered.
        self._flat = past is not None
        self._tall = float(np.median(np.ptp(space.X[1, cut.nodes], axis=0)))
        self._reach = max(tuning.reach * thickness, tuning.elements * self._tall)
        self._touch = tuning.touch * thickness
        self._smoothed = max(tuning.near * thickness, self._tall)
        self._place: tuple[int, ...] | None = None
        self._part: SubProblem

    def solved(self, u: np.ndarray, last: np.ndarray, states: dict, step, settings: NewtonSettings):
        """``u``, which predicts the end of ``step`` from ``last``, with the unknowns of the parts solved for.

        Where Newton's method stops short of that, the state nearest to it will do, if it is near. Raises
        NoConvergence where none is at the front.
        """
        part = self.around(states)
        of_part = part.picked(states)
        if self._flat and any(self._place or ()):
            u = self.beside(u, last, states, step, part)
        begin = self._begun(u, last, np.real(states["cohesion"]["damage"]), part, of_part, step, settings)
        # What has been moved is wrong by little, but by much in the element at the front: without
        # regularisation the first directions invert elements.
        moved = (
            settings
            if begin is u
            else replace(settings, cautious=self._tuning.cautious, relax=self._tuning.relax)
        )
        try:
            u = self._newton(part, begin, of_part, step, moved, strict=True)
        except BadGuess:
            # All turn elements inside out: begin as it was, and yield to the edge.
            try:
                u = self._newton(part, last + part.extended(u - last), of_part, step, settings)
            except BadGuess:
                floor = settings.smallest_ratio * min(1.0, self._problem.bulk.smallest_volume_ratio(last))
                u = on_the_way(self._problem, last, u, floor)
                u = self._newton(part, u, of_part, step, settings)
        self._problem.renewed_around(part.problem)
        return u

    def _newton(
        self, part: SubProblem, u, states, step, settings: NewtonSettings, strict: bool = False
    ) -> np.ndarray:
        tolerance = max(self._tuning.enough, settings.tolerance)
        near = replace(settings, tolerance=tolerance, iterations=self._tuning.iterations)
        try:
            return newton(part.problem, u, states, step, near, strict=strict)[0]
        except NoConvergence as error:
            left, nearest = error.nearest
            if left > self._tuning.usable:
                raise
            return nearest

    # -- at the front -----------------------------------------------------------------------------
    def around(self, states: dict) -> SubProblem:
        """The part around the front. Of the state alone: a run may resume."""
        stride = self._tuning.follows * self._reach
        place = tuple(map(int, self._depths(np.real(states["cohesion"]["damage"])) / stride))
        if place != self._place:
            X, below = self._space.X, self._tuning.follows * self._reach + self._reach
            front = (self._top - np.array(place) * stride)[self._strip_of]
            near = (np.abs(X[0]) < self._reach) & (X[1] < front + self._reach)
            inside = near & (X[1] > front - below)
            self._place, self._part = place, SubProblem(self._problem, X.shape[0], inside)
        return self._part

    def _depths(self, damage: np.ndarray) -> np.ndarray:
        """How deep the front is in each strip, 0 where the cut has not begun."""
        return self._top - self.strips.lowest(self._height, damage > 0.5, self._top)

    def _begun(self, u, last, damage, part: SubProblem, states, step, settings) -> np.ndarray:
        """The best beginning: ``u``, or that with what happened some elements higher, or with the front moved
        on. ``states`` of the part."""
        if not (self._flat and (damage > 0.5).any()):
            return u
        advance = self._advance(u, last, damage)
        if not (advance > 0).any():
            return u
        floor = settings.smallest_ratio * min(1.0, part.problem.bulk.smallest_volume_ratio(last))
        best, begin = part.problem.left(u, states, step, floor), u
        moved = (self.moved(u, last, damage, part, caution * advance) for caution in self._tuning.caution)
        for guesses in (self._repeated(u, last, part, step), moved):
            for guess in guesses:
                left = part.problem.left(guess, states, step, floor)
                if left < best:
                    best, begin = left, guess
                if np.isfinite(left):
                    break
            if begin is not u:
                break
        return begin

    def _repeated(self, u, last, part: SubProblem, step) -> Iterator[np.ndarray]:
        """``u``, but around the front with what ``last`` led to when that was some elements higher."""
        size = float(step.centre_old[1] - step.centre[1])
        free = part.problem.free
        for repeated in self._past.guesses(size, last) if self._past is not None and size > 0 else ():
            guess = u.copy()
            guess[free] = repeated[free]
            yield guess

    def beside(self, u, last, states: dict, step, part: SubProblem) -> np.ndarray:
        """``u`` with nodes that touch the blade as far from it as they were in ``last``, but for the part.

        A straight line lets them leave the flanks, or press into them, by micrometres: contacts then change
        all along the blade.
        """
        problem, dim, u = self._problem, self._space.dim, u.copy()
        before = replace(step, centre=step.centre_old)
        for form in problem.blades:
            (gap, normal, nodes), was = (
                form.gap_of_nodes(self._space.X, v, states[form.name], problem.p, at)
                for v, at in ((u, step), (last, before))
            )
            near = was[0] < self._touch
            for i in range(dim):
                places = nodes * dim + i
                held = near & problem.is_free[places] & ~part.problem.is_free[places]
                u[places[held]] -= ((gap - was[0]) * normal[i])[held]
        return u

    def _advance(self, u: np.ndarray, last: np.ndarray, damage: np.ndarray) -> np.ndarray:
        """How far the front goes down in each strip, mm, while displacements go on from ``last`` to ``u``."""
        strips, broken = self.strips, damage > 0.5
        now, before = (self._cut.jump(v)[0] for v in (last, 2 * last - u))
        lowest = strips.lowest(self._height, broken, np.inf)
        at_front = broken & (self._height < lowest[strips.at] + self._tall)
        sums, counts = (
            np.bincount(strips.at[at_front], some, strips.z.size) for some in (now[at_front], None)
        )
        scale = (sums / np.maximum(counts, 1))[strips.at]
        opens = scale > 0
        scale = np.where(opens, scale, 1.0)
        opened = np.exp(-np.maximum(before, 0) / scale) - np.exp(-np.maximum(now, 0) / scale)
        return np.maximum(strips.lengths(self._cut.faces.w.ravel() * opened * opens), 0)

    def moved(self, u, last, damage, part: SubProblem, advance: np.ndarray) -> np.ndarray:
        """``u``, which goes on from ``last`` on a straight line, but with the front lower, in each strip by
        its ``advance`` (n,), mm.

        What surrounds the front moves with it, by about an element in a step; a straight line opens a point
        that is open already by as much again. So the last state comes from above, u_n(X + a), with what that
        lacked in the last step, Δu(X + a) − (u_n(X + a) − u_n(X)). This is smooth, and is smoothed near the
        front, where it holds differences between places in an element.
        """
        space, nodes, dim = self._space, part.nodes, self._space.dim
        strip = self._strip_of[nodes]
        points = space.inside[:, nodes]
        points[1] = np.minimum(points[1] + advance[strip], self._top * (1 - 1e-12))
        above = space.probes(points)
        now, change = (v[: space.ndof].reshape(-1, dim) for v in (last, u - last))
        moved = above @ now
        lacked = above @ change - (moved - now[nodes])
        depth = self._depths(damage)[strip]
        near = np.hypot(space.X[0, nodes], self._top - space.X[1, nodes] - depth) < self._smoothed
        for _ in range(4):
            lacked[near] = (part.average @ lacked)[near]
        guess = u.copy()
        places = nodes[:, None] * dim + np.arange(dim)
        free = np.isin(places, part.problem.free)
        guess[places[free]] = (moved + lacked)[free]
        return guess
