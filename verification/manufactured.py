"""Convergence rates with a manufactured solution: the error in L₂ falls as h^(k+1) for order k."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import skfem

from cutbench.forms.base import blend, component_major, gather
from cutbench.solver.problem import Problem
from verification._common import (
    DeadLoad,
    body_force,
    bulk_forms,
    solve,
    space_of,
    step_at_rest,
)
from verification.base import Check, Reference

G = 1.0
#: Amplitudes over the square's side: shear strains up to 0.3, changes of volume by 2e-5.
SHEAR, DILATION = 0.1 / np.pi, 2e-5
#: Element kind, Poisson's ratio, divisions of the side, order of the error.
CASES = (("P1", 0.3, (16, 32), 2), ("P2", 0.3, (8, 16), 3), ("P2P1", 0.4999, (16, 32), 3))


def field(X: np.ndarray) -> np.ndarray:
    """u (2, n) of x = X + D sin(2πX)/2π + S sin(πY), y = Y + S sin(πx), whose det F = 1 + D cos(2πX)."""
    ux = DILATION * np.sin(2 * np.pi * X[0]) / (2 * np.pi) + SHEAR * np.sin(np.pi * X[1])
    return np.stack([ux, SHEAR * np.sin(np.pi * (X[0] + ux))])


def gradient(X: np.ndarray) -> np.ndarray:
    """∂u_i/∂X_J (2, 2, n)."""
    by_x = DILATION * np.cos(2 * np.pi * X[0])
    by_y = np.pi * SHEAR * np.cos(np.pi * X[1])
    turn = np.pi * SHEAR * np.cos(np.pi * (X[0] + field(X)[0]))
    return np.stack([by_x, by_y, turn * (1 + by_x), turn * by_y]).reshape(2, 2, -1)


def error(element: str, n: int, nu: float) -> float:
    """‖u_h − u‖ in L₂ over ‖u‖ on n × n squares cut in two."""
    line = np.linspace(0, 1, n + 1)
    mesh = skfem.MeshTri.init_tensor(line, line)
    space = space_of(mesh, element)
    forms, ndof = bulk_forms(space, element)
    forms.append(DeadLoad.in_volume(space.volume(6), body_force(gradient, G, nu)))
    X = space.X
    exact = field(X)
    edge = np.flatnonzero((np.minimum(X, 1 - X) < 1e-9).any(axis=0))
    problem = Problem(forms, ndof, np.concatenate([2 * edge, 2 * edge + 1]), SimpleNamespace(G=G, nu=nu))
    # The nodes start on the solution sought, which is not the discrete one.
    u = np.zeros(ndof)
    u[: space.ndof] = exact.T.ravel()
    u, _ = solve(problem, u, problem.start(), step_at_rest(np.zeros(ndof)), tolerance=1e-10)
    fine = space.volume(6)
    N = np.repeat(fine.phi[:, :, None], fine.nodes.shape[1], axis=2)
    true = field(fine.X.reshape(2, -1)).reshape(fine.X.shape)
    off = blend(N, gather(u, component_major(fine.nodes, 2), 2)) - true
    return float(np.sqrt((off**2 * fine.w).sum() / (true**2 * fine.w).sum()))


def compute() -> Iterator[Check]:
    for element, nu, (coarse, fine), order in CASES:
        errors = error(element, coarse, nu), error(element, fine, nu)
        rate = np.log(errors[0] / errors[1]) / np.log(fine / coarse)
        yield Check(f"{element}, ν = {nu}: order of the error in L₂", "1", order, rate, 0.05)


REFERENCE = Reference(
    "manufactured",
    "Finite strain with a body force that makes known shears the solution: order of convergence.",
    "interpolation theory: order k + 1 in L₂ for polynomials of order k",
    compute,
    laws=("neo_hookean",),
    seconds=3.0,
)
