"""A part of a problem: some of its elements and faces, with all other unknowns held."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cutbench.forms.base import Form
from cutbench.solver.linear import Pardiso, SuperLU, make_solver
from cutbench.solver.problem import Problem


class SubProblem:
    """The problem on the elements and faces around some nodes; only these move."""

    def __init__(self, whole: Problem, dim: int, inside: np.ndarray):
        """``inside`` (nnode,): the nodes that may move."""
        self.inside = np.flatnonzero(inside)
        moving = np.repeat(inside, dim)
        free = np.concatenate([moving, np.ones(whole.ndof - moving.size, bool)])
        free[whole.fixed] = False
        able = [form for form in whole.forms if type(form).part is not Form.part]
        for form in whole.forms:
            if form not in able:
                free[form.dofs] = False
        #: The forms that have a part here, each with which of its columns that is.
        self.chosen: list[tuple[Form, np.ndarray]] = []
        for form in able:
            met = (free[form.dofs] & (form.dofs < moving.size)).any(axis=0)
            # What stands behind the displacements belongs to elements, all of which have to be here.
            others = form.dofs[:, ~met]
            free[others[others >= moving.size]] = False
            if met.any():
                self.chosen.append((form, np.flatnonzero(met)))
        parts = [part for form, columns in self.chosen if (part := form.part(columns)) is not None]
        solver = "superlu" if whole.solver.name == "superlu" else "auto"
        held, timer = np.flatnonzero(~free), whole.timer.within("window")
        self.problem = Problem(parts, whole.ndof, held, whole.p, solver=solver, timer=timer)
        elements = self.problem.bulk.volume.nodes
        #: Nodes (n,) of its elements, with those at its edge.
        self.nodes, local = np.unique(elements, return_inverse=True)
        local = local.reshape(elements.shape)
        number = np.broadcast_to(np.arange(elements.shape[1]), elements.shape)
        meets = sp.csr_array((np.ones(elements.size), (local.ravel(), number.ravel())))
        #: (n, n): mean over the nodes of all elements that a node belongs to.
        self.average = sp.diags_array(1 / (meets.sum(axis=1) * elements.shape[0])) @ meets @ meets.T
        self._smooth: Pardiso | SuperLU | None = None

    def picked(self, states: dict) -> dict:
        """What the part has of ``states``, by form."""
        return {form.name: form.pick(states[form.name], columns) for form, columns in self.chosen}

    def extended(self, du: np.ndarray) -> np.ndarray:
        """``du`` (ndof,) where it is held, and a harmonic function of that where it is free."""
        problem, damping, du = self.problem, self.problem.damping, du.copy()
        free = problem.free
        du[free] = 0.0
        if damping is None or problem.metric is None:
            return du
        if self._smooth is None:
            data = problem.metric.copy()
            diagonal = problem.pattern.diagonal  # zero where no displacement stands
            data[diagonal[data[diagonal] == 0]] = 1.0
            pattern = problem.pattern
            name = problem.solver.name
            self._smooth = make_solver(name, pattern.indptr, pattern.indices, free.size, problem.symmetric)
            self._smooth.refactor(data)
        local = np.einsum("ije,je->ie", damping.unit_matrix, np.take(du, damping.dofs))
        du[free] = self._smooth.solve(-problem.pattern.vector("damping", local)[free])
        return du
