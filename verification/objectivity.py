"""Objectivity: a rotation of the deformed body turns the forces with it and costs nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutbench.solver.problem import Problem
from verification._common import (
    ELEMENTS,
    bulk_forms,
    parameters,
    space_of,
    split_block,
    step_at_rest,
)
from verification.base import Check, Reference


def rotation(dim: int) -> np.ndarray:
    """By 1 rad, in space about an oblique axis."""
    c, s = np.cos(1.0), np.sin(1.0)
    if dim == 2:
        return np.array([[c, -s], [s, c]])
    a = np.array([2.0, -1.0, 2.0]) / 3
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return c * np.eye(3) + s * cross + (1 - c) * np.outer(a, a)


def compute() -> Iterator[Check]:
    p = parameters("gelatin")
    for dim in (2, 3):
        for element in ELEMENTS:
            space = space_of(split_block(dim), element)
            forms, ndof = bulk_forms(space, element, 1.5)
            problem = Problem(forms, ndof, np.array([], int), p)
            rng = np.random.default_rng(2)
            X = space.X
            u = np.zeros(ndof)
            u[: space.ndof] = (0.15 * X[::-1] * X[:1] + 0.004 * rng.standard_normal(X.shape)).T.ravel()
            u[space.ndof :] = 0.3 * p.G * rng.standard_normal(ndof - space.ndof)
            Q, shift = rotation(dim), np.array([0.4, -0.3, 0.2])[:dim, None]
            turned = u.copy()
            turned[: space.ndof] = (Q @ (X + u[: space.ndof].reshape(-1, dim).T) + shift - X).T.ravel()
            step = step_at_rest(np.zeros(ndof))
            R, S = (problem.evaluate(v, problem.start(), step).residual for v in (u, turned))
            forces = Q @ R[: space.ndof].reshape(-1, dim).T
            off = np.abs(S[: space.ndof].reshape(-1, dim).T - forces).max() / np.abs(forces).max()
            stored = [sum(sum(form.energies(v, p, {}).values()) for form in forms) for v in (u, turned)]
            kind = f"{dim}D {element}"
            yield Check(f"{kind}: forces turn with the body, largest error", "1", 0.0, off, 1e-10)
            yield Check(f"{kind}: change of the stored energy", "1", 0.0, stored[1] / stored[0] - 1, 1e-10)


REFERENCE = Reference(
    "objectivity",
    "Strained pieces turned by 1 rad and shifted: forces turn with them, the energy stays.",
    "frame indifference, P(QF) = Q P(F)",
    compute,
    seconds=0.5,
)
