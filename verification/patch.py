"""Patch test across the cut plane: uniform strain on both sides, a uniform jump between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import root

from cutbench.forms.cut import CutForm
from cutbench.forms.geometry import paired
from cutbench.solver.problem import Problem
from verification._common import (
    ELEMENTS,
    bulk_forms,
    law,
    parameters,
    piola,
    solve,
    space_of,
    split_block,
    step_at_rest,
)
from verification.base import Check, Reference

#: The jump in units of δ_c: opening, sliding, and sliding along the blade.
JUMP = (0.3, 0.05, 0.04)


def compute() -> Iterator[Check]:
    p = parameters("gelatin")
    for dim in (2, 3):
        mesh = split_block(dim)
        jump = p.delta_c * np.array(JUMP) * ([1, 1, 0] if dim == 2 else [1, 1, 1])
        T = p.G_c / p.delta_c**2 * np.exp(-np.linalg.norm(jump) / p.delta_c) * jump
        F = strained(T, p, dim)
        for element in ELEMENTS:
            u, exact, force = solved(mesh, element, p, F, jump, T)
            kind = f"{dim}D {element}"
            off, pull = float(np.abs(u - exact).max() / np.linalg.norm(jump)), float(np.linalg.norm(T))
            yield Check(f"{kind}: largest error of a displacement, over the jump", "1", 0.0, off, 1e-6)
            yield Check(f"{kind}: force on the grip", "mN", 1.5e3 * pull, 1e3 * force, 1e-6)


def strained(T: np.ndarray, p, dim: int) -> np.ndarray:
    """F = 1 + g ⊗ e_x with P e_x = T."""

    def gradient(g: np.ndarray) -> np.ndarray:
        F = np.eye(3)
        F[:dim, 0] += g
        return F[:, :, None]

    def open_equation(g: np.ndarray) -> np.ndarray:
        return (piola(gradient(g), p.G, p.nu)[:, 0, 0] - T)[:dim] / p.G

    return gradient(root(open_equation, np.zeros(dim), tol=1e-13).x)[:, :, 0]


def solved(mesh, element: str, p, F: np.ndarray, jump: np.ndarray, T: np.ndarray):
    """Displacements at the nodes, the exact ones, and the force along T on the grip at x = 1, 1.5 mm²."""
    space = space_of(mesh, element)
    dim = space.dim
    forms, ndof = bulk_forms(space, element, 1.5)
    plus, minus = space.faces("cut", 4), space.faces("cut_minus", 4)
    forms.append(CutForm((law("smith_ferrante"),), plus, 1.5, paired(plus, minus, space.X)))
    right = space.X[0] > 0
    right[np.unique(plus.nodes)] = True
    side = np.where(right, 0.5, -0.5)
    exact = ((F - np.eye(3))[:dim, :dim] @ space.X + side * jump[:dim, None]).T.ravel()
    X = space.X
    ends = [(-1.0, 1.0), (0.0, 1.5), (-0.5, 0.5)][:dim]
    outer = np.zeros(X.shape[1], bool)
    for x, (low, high) in zip(X, ends, strict=True):
        outer |= (np.abs(x - low) < 1e-9) | (np.abs(x - high) < 1e-9)
    assert not outer.all(), "something must be free"
    fixed = (np.flatnonzero(outer) * dim + np.arange(dim)[:, None]).ravel()
    problem = Problem(forms, ndof, fixed, p)
    guess = np.zeros(ndof)
    guess[: space.ndof] = exact
    free = problem.free[problem.free < space.ndof]
    guess[free] += 0.02 * np.random.default_rng(1).uniform(-1, 1, free.size)
    u, result = solve(problem, guess, problem.start(), step_at_rest(np.zeros(ndof)), tolerance=1e-11)
    # Virtual work of all nodal forces on a field that grows from 0 at the cut to T/|T| at the grip.
    pull = np.zeros(ndof)
    pull[: space.ndof] = (np.where(right, X[0], 0.0) * T[:dim, None] / np.linalg.norm(T)).T.ravel()
    return u[: space.ndof], exact, float(pull @ result.residual)


REFERENCE = Reference(
    "patch",
    "Patch test across the cut plane, opening and sliding, two and three dimensions, every element.",
    "P(F) e_x = T(jump) with F and the jump uniform, from the formulas of both laws",
    compute,
    laws=("neo_hookean", "volumetric", "smith_ferrante"),
    seconds=2.0,
)
