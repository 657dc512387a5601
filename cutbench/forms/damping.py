"""A little bulk viscosity, ∫ η ∇₀u̇ : ∇₀δu dV, that carries the solution through snaps.

Where cutting is abrupt, equilibrium jumps at constant blade position. The term is negligible while
things move with the blade and dominates when they do not; what it dissipates is the energy that the
snap sets free, and stands in the ledger under its own name.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from cutbench.forms.base import Form, Local, component_major, spread
from cutbench.forms.space import Volume


class DampingForm(Form):
    """Linear and constant: its matrix is computed once. ``viscosity`` η in MPa s."""

    name = "damping"

    def __init__(self, volume: Volume, viscosity: float):
        self.dim = volume.X.shape[0]
        self.viscosity = viscosity
        self.dofs = component_major(volume.nodes, self.dim)
        grad = np.einsum("qma,mje->qjae", volume.dphi, volume.jinv)
        laplace = np.ascontiguousarray(np.einsum("qjae,qjbe,qe->abe", grad, grad, volume.w, optimize=True))
        nn, _, ne = laplace.shape
        self._laplace = laplace
        matrix = np.zeros((self.dim, nn, self.dim, nn, ne))
        for i in range(self.dim):
            matrix[i, :, i] = laplace
        #: ∫ ∇₀δu : ∇₀u dV: local matrices that a problem assembles once.
        self.unit_matrix = matrix.reshape(self.dim * nn, self.dim * nn, ne)

    def part(self, columns):
        some = copy(self)
        some.dofs = np.ascontiguousarray(self.dofs[:, columns])
        some._laplace = np.ascontiguousarray(self._laplace[..., columns])
        some.unit_matrix = np.ascontiguousarray(self.unit_matrix[..., columns])
        return some

    def factor(self, step) -> float:
        """What the tangent is in units of ``unit_matrix``."""
        return self.viscosity * step.damping_factor / step.dt

    def start(self, p):
        return {"force": np.zeros(self.dofs.shape)}

    def evaluate(self, u, p, state, step):
        force = spread(self._laplace, (self.factor(step) * (u - step.u_old)).take(self.dofs))
        return Local(force, lambda: self.factor(step) * self.unit_matrix, {"force": force})

    def work(self, u, p, old, new, step):
        # The mean of both ends, as everywhere in the ledger: the last step's force was in its balance.
        du = np.take(u - step.u_old, self.dofs)
        return {"snap": float((du * (old["force"] + new["force"])).sum() / 2)}
