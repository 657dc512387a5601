"""Iterative solvers: against direct ones, kept factorizations, multigrid, and what cannot be solved."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import cutbench.solver.iterative as iterative
from cutbench.case.case import load_case
from cutbench.run.build import build
from cutbench.solver.iterative import Kept, Multigrid, Stagnation, gmres, rigid_motions, solver_for
from cutbench.solver.linear import SingularMatrix, make_solver

with_pyamg = pytest.mark.skipif(iterative.pyamg is None, reason="PyAMG is not installed")

SMALL = {
    "numerics": "tetrahedra", "width": "6 mm", "height": "6 mm", "length": "8 mm", "element": "P1",
    "h": "1.2 mm",
}  # fmt: skip


def some(n, seed=0):
    """A well conditioned unsymmetric matrix."""
    rng = np.random.default_rng(seed)
    A = sp.random(n, n, 0.1, random_state=rng, format="csr") + 3 * sp.eye(n, format="csr")
    return A.tocsr(), rng.standard_normal(n)


@pytest.mark.parametrize("restart", [5, 100])
def test_gmres_solves_to_its_tolerance(restart):
    A, b = some(80)
    calls = []

    def count(x):
        calls.append(1)
        return A @ x

    x, iterations = gmres(count, lambda r: r / 3, b, tolerance=1e-10, most=200, restart=restart)
    assert np.linalg.norm(A @ x - b) <= 1e-10 * np.linalg.norm(b)
    assert 0 < iterations <= 200 and len(calls) >= iterations
    x, iterations = gmres(
        lambda v: A @ v, lambda r: np.linalg.solve(A.toarray(), r), b, tolerance=1e-9, most=5
    )
    assert iterations == 1
    assert gmres(lambda v: A @ v, lambda r: r, 0 * b, tolerance=1e-9, most=5)[1] == 0


def test_gmres_says_when_it_gets_nowhere():
    A, b = some(80)
    with pytest.raises(Stagnation, match="after 3 iterations"):
        gmres(lambda v: A @ v, lambda r: r, b, tolerance=1e-12, most=3)
    with pytest.raises(Stagnation):
        gmres(lambda v: 0 * v, lambda r: r, b, tolerance=1e-12, most=30)


def parts(A):
    A = A.tocsr()
    A.sort_indices()
    return A.indptr, A.indices, A.shape[0]


@pytest.mark.parametrize("symmetric", [False, True])
def test_a_kept_factorization_serves_a_matrix_that_has_changed_a_little(symmetric):
    A, b = some(200)
    if symmetric:
        A = sp.triu(A + A.T).tocsr()
    A.sort_indices()
    kept = Kept(make_solver("superlu", *parts(A), symmetric), *parts(A), symmetric)
    rng = np.random.default_rng(1)
    for change in (0.0, 1e-3, 1e-2, 0.5):
        data = A.data * (1 + change * rng.standard_normal(A.nnz))
        kept.refactor(data)
        now = sp.csr_matrix((data, A.indices, A.indptr), A.shape)
        now = now + sp.triu(now, 1).T if symmetric else now
        assert np.linalg.norm(now @ kept.solve(b) - b) < 1e-6 * np.linalg.norm(b)
        assert np.linalg.norm(now @ kept.direction(b) - b) < 1.1 * iterative.DIRECTION * np.linalg.norm(b)
    # A small change needs no new factorization, a large one does.
    assert 1 <= kept.counts["factorizations"] <= 3
    assert kept.counts["gmres_iterations"] > 0


def test_a_singular_matrix_is_told():
    A, b = some(50)
    kept = Kept(make_solver("superlu", *parts(A), False), *parts(A), False)
    kept.refactor(A.data)
    with pytest.raises(SingularMatrix):
        kept.refactor(0 * A.data)
        kept.solve(b)


@pytest.fixture(scope="module")
def solid():
    """A block's problem a little into the indentation, with its tangent and residual."""
    built = build(load_case("gelatin", {**SMALL, "depth": "0.1 mm"}, dim=3))
    problem, found = built.problem, []
    keep = problem.factorize
    problem.factorize = lambda data: (found.append(data.copy()), keep(data))
    for _ in built.march:
        pass
    return problem, found[-1], built


@with_pyamg
def test_multigrid_solves_a_nearly_incompressible_block(solid):
    problem, data, built = solid
    pattern = problem.pattern
    modes = rigid_motions(built.space.X)[problem.free]
    args = (pattern.indptr, pattern.indices, problem.free.size, problem.symmetric, modes)
    with_modes = Multigrid(*args)
    b = np.random.default_rng(2).standard_normal(problem.free.size)
    direct = make_solver("superlu", *args[:4])
    direct.refactor(data)
    wanted = direct.solve(b)
    with_modes.refactor(data)
    x = with_modes.solve(b)
    assert np.linalg.norm(pattern.csr(data) @ x - b) < 1e-6 * np.linalg.norm(b)
    assert np.linalg.norm(x - wanted) < 1e-3 * np.linalg.norm(wanted)
    assert with_modes.counts["gmres_iterations"] < 100
    assert with_modes.counts["hierarchies"] == 1


@with_pyamg
def test_multigrid_gives_up_on_what_is_not_elasticity():
    n = 60
    A = sp.diags([np.where(np.arange(n) % 2, -1.0, 1.0), np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsr()
    A.data[:] = np.random.default_rng(0).standard_normal(A.nnz)
    A[5] = 0 * A[5]
    A.sort_indices()
    grid = Multigrid(*parts(A), False, None)
    with pytest.raises(SingularMatrix):
        grid.refactor(A.data)
        grid.solve(np.ones(n))


def test_a_rigid_motion_strains_nothing():
    X = np.random.default_rng(0).standard_normal((3, 20))
    modes = rigid_motions(X).reshape(20, 3, 6)
    for k in range(6):
        u = modes[:, :, k].T
        a, b = X[:, 0], X[:, 7]
        # To first order no distance changes: (b − a)·(u_b − u_a) = 0.
        assert (b - a) @ (u[:, 7] - u[:, 0]) == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.matrix_rank(modes.reshape(60, 6)) == 6


def test_auto_keeps_factorizations_in_solids_and_nowhere_else():
    n = iterative.SMALL + 1
    A = sp.diags([-1.0, 4.0, -1.0], [-1, 0, 1], shape=(n, n), format="csr")
    modes = np.zeros((n, 6))
    assert isinstance(solver_for("auto", *parts(A), False, modes), Kept)
    section = solver_for("auto", *parts(A), False)
    if not isinstance(section, Kept):  # without PARDISO it is a direct solver
        return
    for factor in (1.0, 1.001):
        section.refactor(factor * A.data)
        section.solve(np.ones(n))
    assert section.counts["factorizations"] == 2


@pytest.fixture(scope="module")
def directly():
    return forces("superlu")


def forces(solver: str) -> np.ndarray:
    case = load_case("gelatin", {**SMALL, "depth": "0.6 mm", "solver": solver}, dim=3)
    return np.array([step.force for step in build(case).march])


@pytest.mark.parametrize("name", ["kept", pytest.param("multigrid", marks=with_pyamg)])
def test_a_run_is_the_same_with_every_solver(directly, name):
    assert forces(name) == pytest.approx(directly, rel=1e-5)
