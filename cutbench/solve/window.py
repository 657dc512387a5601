"""First where the cut runs, then everywhere: a prediction that has contact and damage right.

From one step to the next the tip meets other faces and the front opens other points. Newton's method spends
most of its iterations on finding which, and solves the whole block each time. So they are found on the
elements around the front alone, with the rest of the block held where a straight line has it. What is left
then is smooth, and takes one or two iterations of the whole (nonlinear elimination: Lanzkron, Rose, Wilkes,
SIAM J. Sci. Comput. 17, 1996; Cai, Li, SIAM J. Sci. Comput. 33, 2011).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cutbench.forms.base import Form
from cutbench.forms.space import Faces, Space
from cutbench.solve.linear import make_solver
from cutbench.solve.newton import BadGuess, NewtonSettings, NoConvergence, newton
from cutbench.solve.problem import Problem

#: Half of the window's width, and how far it reaches ahead of the front and behind, in blade thicknesses.
REACH = 2.0
#: And at least this many elements of the cut plane.
ELEMENTS = 3
#: The window follows the front in steps of this part of that length.
FOLLOWS = 0.25
#: The window's residual, over its own forces, that is small enough; and iterations, at the most.
ENOUGH, ITERATIONS = 1e-3, 15
#: Where it stays above that, what is still a better beginning than a shorter step.
USABLE = 0.02


class Window:
    """The part of a problem around the front of its cut."""

    def __init__(self, problem: Problem, space: Space, cut: Faces, thickness: float):
        """``cut``: the faces of the cut plane; ``thickness`` of the blade in mm."""
        self._problem, self._space = problem, space
        self._height = cut.X[1].ravel()
        self._top = float(space.X[1].max())
        tall = float(np.median(np.ptp(space.X[1, cut.nodes], axis=0)))
        self._reach = max(REACH * thickness, ELEMENTS * tall)
        self._place: int | None = None
        self._part: _Part | None = None

    def solved(self, u: np.ndarray, last: np.ndarray, states: dict, step, settings: NewtonSettings):
        """``u``, which predicts the end of ``step`` from ``last``, with the window's unknowns solved for.

        Where Newton's method stops short of that, the state nearest to it will do, if it is near. Raises
        NoConvergence where none is.
        """
        part = self._around(states)
        states = {form.name: form.pick(states[form.name], columns) for form, columns in part.chosen}
        if part.damping is not None:
            part.damping.boost = next(form.boost for form in self._problem.forms if form.name == "damping")
        near = replace(settings, tolerance=max(ENOUGH, settings.tolerance), iterations=ITERATIONS)
        try:
            try:
                return newton(part.problem, u, states, step, near)[0]
            except BadGuess:
                # A straight line turns elements inside out: begin as it was, and yield to the edge.
                begin = last + part.extended(u - last)
                return newton(part.problem, begin, states, step, near)[0]
        except NoConvergence as error:
            left, nearest = error.nearest
            if left > USABLE:
                raise
            return nearest

    def _around(self, states: dict) -> _Part:
        """The part around the lowest point that is half broken. Of the state alone: a run may resume."""
        broken = self._height[np.real(states["cohesion"]["damage"]) > 0.5]
        depth = self._top - float(broken.min(initial=self._top))
        place = int(depth / (FOLLOWS * self._reach))
        if place != self._place:
            front = self._top - place * FOLLOWS * self._reach
            X = self._space.X
            near = (np.abs(X[0]) < self._reach) & (X[1] < front + self._reach)
            inside = near & (X[1] > front - (1 + FOLLOWS) * self._reach)
            self._place, self._part = place, _Part(self._problem, X.shape[0], inside)
        return self._part


class _Part:
    """A problem on some of the elements and faces; unknowns of others are held."""

    def __init__(self, whole: Problem, dim: int, inside: np.ndarray):
        """``inside`` (nnode,): the nodes that may move."""
        moving = np.repeat(inside, dim)
        free = np.concatenate([moving, np.ones(whole.ndof - moving.size, bool)])
        free[whole.fixed] = False
        able = [form for form in whole.forms if type(form).part is not Form.part]
        for form in whole.forms:
            if form not in able:
                free[form.dofs] = False
        #: The forms that have a part here, each with which of its columns that is.
        self.chosen = []
        for form in able:
            met = (free[form.dofs] & (form.dofs < moving.size)).any(axis=0)
            # What stands behind the displacements belongs to elements, all of which have to be here.
            others = form.dofs[:, ~met]
            free[others[others >= moving.size]] = False
            if met.any():
                self.chosen.append((form, np.flatnonzero(met)))
        parts = [form.part(columns) for form, columns in self.chosen]
        solver = "superlu" if whole.solver.name == "superlu" else "auto"
        self.problem = Problem(parts, whole.ndof, np.flatnonzero(~free), whole.p, solver=solver)
        self.damping = next((form for form in parts if form.name == "damping"), None)
        self._smooth = None

    def extended(self, du: np.ndarray) -> np.ndarray:
        """``du`` (ndof,) where it is held, and a harmonic function of that where it is free."""
        problem, du = self.problem, du.copy()
        free = problem.free
        du[free] = 0.0
        if self.damping is None:
            return du
        if self._smooth is None:
            data = problem.metric.copy()
            diagonal = problem.pattern.diagonal  # zero where no displacement stands
            data[diagonal[data[diagonal] == 0]] = 1.0
            pattern = problem.pattern
            name = problem.solver.name
            self._smooth = make_solver(name, pattern.indptr, pattern.indices, free.size, problem.symmetric)
            self._smooth.refactor(data)
        local = np.einsum("ije,je->ie", self.damping.unit_matrix, np.take(du, self.damping.dofs))
        du[free] = self._smooth.solve(-problem.pattern.vectors({"damping": local}).sum(axis=0)[free])
        return du
