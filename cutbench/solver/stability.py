"""How far a state of equilibrium is from losing its stability: the tangent's lowest eigenvalue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cutbench.solver.arc_length import PathPoint
from cutbench.solver.linear import SingularMatrix
from cutbench.solver.problem import Problem

MAX_DENSE_UNKNOWNS = (
    200  # unknowns: as dense matrices below. Arnoldi breaks down where it spans nearly all there is.
)


def lowest_eigenvalue(problem: Problem, point: PathPoint, of: int = 4) -> float:
    """Lowest eigenvalue of the tangent K at ``point``, in K x = λ G L x; nan where none is found.

    L is the Laplacian ∫ ∇₀u : ∇₀u dV, so λ is the stiffness of the softest motion against that of a body of
    shear modulus G, whatever the mesh. Below zero the state is unstable; one eigenvalue passes zero where a
    path turns smoothly. Looked for among the ``of`` eigenvalues nearest to zero; real part, as friction and
    the material's normal make K unsymmetric. Shift-invert Arnoldi (scipy's eigs), or all eigenvalues of dense
    matrices where there are fewer than ``MAX_DENSE_UNKNOWNS`` unknowns.
    """
    if problem.metric is None:
        return np.nan
    current = problem.evaluate(point.u, point.begun, replace(point.step, damping_factor=0.0))
    pattern, free = problem.pattern, problem.free

    def whole(data):
        upper = pattern.csr(data)
        return upper + sp.triu(upper, 1).T if problem.symmetric else upper

    def inverse(x):
        b = np.zeros(problem.ndof)
        b[free] = -x
        return problem.back_substitute(b)[free]

    K, L = whole(current.data), problem.shear_modulus * whole(problem.metric)
    if free.size < MAX_DENSE_UNKNOWNS:
        values = sl.eigvals(K.toarray(), L.toarray())
        values = values[np.isfinite(values)]  # L does not see a body that moves as a whole
        nearest = values[np.argsort(abs(values))[:of]]
        return float(np.real(nearest).min()) if nearest.size else np.nan
    try:
        problem.factorize(current.data)
        inverted = spla.LinearOperator((free.size, free.size), inverse, dtype=float)
        # L does not see a body that moves as a whole: begin with something that has none of that.
        v0 = inverted @ (L @ np.cos(np.arange(free.size)))
        how = {"k": min(of, free.size - 2), "ncv": min(20, free.size), "v0": v0, "tol": 1e-3}
        values = spla.eigs(K, M=L, sigma=0.0, OPinv=inverted, return_eigenvectors=False, **how)
    except (SingularMatrix, spla.ArpackError, RuntimeError):
        return np.nan
    return float(np.real(values).min())
