"""Sparse solvers: every back end, symmetric or not, definite or not; a singular matrix is reported."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.sparse as sp

from cutbench.solver import iterative
from cutbench.solver.iterative import WORTH, Kept, SymmetricPart, solver_for
from cutbench.solver.linear import SingularMatrix, available, make_solver

solvers = pytest.mark.parametrize("name", available())


def laplace(n: int = 12) -> sp.csr_matrix:
    line = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n))
    eye = sp.eye(n)
    return sp.csr_matrix(sp.kron(line, eye) + sp.kron(eye, line))


def convection(n: int = 12) -> sp.csr_matrix:
    """Same pattern as ``laplace``, clearly unsymmetric values."""
    A = laplace(n).tocoo()
    values = A.data * np.where(A.row < A.col, 1.4, np.where(A.row > A.col, 0.5, 1.0))
    return sp.csr_matrix((values, (A.row, A.col)), shape=A.shape)


def saddle(compliance: float, n: int = 12) -> sp.csr_matrix:
    """[[K, B], [Bᵀ, −c M]]: displacements and pressures; c = 0 leaves an explicit zero block."""
    K = laplace(n)
    m = K.shape[0] // 4
    r = np.random.default_rng(3)
    B = sp.random(K.shape[0], m, 0.05, random_state=4, data_rvs=r.standard_normal) + sp.eye(K.shape[0], m)
    M = sp.diags(r.uniform(0.5, 1.5, m))
    A = sp.bmat([[K, B], [B.T, -M]], format="csr")
    zero = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    block = (zero >= K.shape[0]) & (A.indices >= K.shape[0])
    A.data[block] *= compliance
    return A


def build(name: str, A: sp.csr_matrix, symmetric: bool):
    given = sp.csr_matrix(sp.triu(A)) if symmetric else A
    given.sort_indices()
    solver = make_solver(name, given.indptr, given.indices, given.shape[0], symmetric)
    return solver, given.data


def check(solver, A: sp.csr_matrix, rtol: float = 1e-9) -> None:
    """Against a solution known beforehand, so that a wrong residual cannot hide it."""
    x = np.sin(np.arange(A.shape[0]) + 1.0)
    got = solver.solve(A @ x)
    np.testing.assert_allclose(got, x, rtol=0, atol=rtol)


def test_superlu_is_always_there():
    assert "superlu" in available()
    assert make_solver("auto", *parts(laplace()), False).name == available()[0]


def parts(A):
    return A.indptr, A.indices, A.shape[0]


@solvers
@pytest.mark.parametrize("symmetric", [True, False])
def test_definite(name, symmetric):
    A = laplace()
    solver, data = build(name, A, symmetric)
    solver.refactor(data)
    check(solver, A)


@solvers
def test_unsymmetric(name):
    A = convection()
    solver, data = build(name, A, False)
    solver.refactor(data)
    check(solver, A)
    wrong = np.abs(solver.solve(A.T @ np.ones(A.shape[0])) - 1).max()
    assert wrong > 1e-3, "a transposed matrix would have passed"


@solvers
@pytest.mark.parametrize("symmetric", [True, False])
def test_refactor_takes_the_new_values(name, symmetric):
    A = laplace()
    solver, data = build(name, A, symmetric)
    solver.refactor(data)
    shift = A + 3 * sp.eye(A.shape[0])
    for B in (shift, 1e-3 * A, A):
        _, data = build(name, sp.csr_matrix(B), symmetric)
        solver.refactor(data)
        check(solver, B)


@solvers
@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("compliance", [1.0, 1e-3, 0.0])
def test_saddle_point(name, symmetric, compliance):
    """Pressures under displacements: the diagonal has negative or zero entries."""
    A = saddle(compliance)
    solver, data = build(name, A, symmetric)
    solver.refactor(data)
    check(solver, A, 1e-8)


@solvers
@pytest.mark.parametrize("symmetric", [True, False])
def test_indefinite(name, symmetric):
    """A shifted Laplacian, as a softening tangent is: negative eigenvalues, none near zero."""
    A = sp.csr_matrix(laplace() - 1.2345 * sp.eye(144))
    assert (np.linalg.eigvalsh(A.toarray()) < 0).sum() > 3
    solver, data = build(name, A, symmetric)
    solver.refactor(data)
    check(solver, A, 1e-8)


def singular(kind: str) -> sp.csr_matrix:
    A = laplace().tolil()
    if kind == "empty row":
        A[7, :] = 0
        A[:, 7] = 0
        A[7, 7] = 0
        A = sp.csr_matrix(A)
        # The diagonal stays in the pattern, as the assembly keeps it.
        return sp.csr_matrix(A + sp.eye(144) - sp.eye(144))
    n = 12
    line = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n)).tolil()
    line[0, 0] = line[-1, -1] = 1.0  # nothing holds the body
    eye = sp.eye(n)
    return sp.csr_matrix(sp.kron(line, eye) + sp.kron(eye, line))


@solvers
@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("kind", ["empty row", "floating body"])
def test_a_singular_matrix_is_reported(name, symmetric, kind):
    A = singular(kind)
    assert np.linalg.matrix_rank(A.toarray()) < A.shape[0]
    b = np.ones(A.shape[0])
    solver, data = build(name, A, symmetric)
    with pytest.raises(SingularMatrix):
        solver.refactor(data)
        solver.solve(b)


@solvers
def test_a_solver_recovers_after_a_singular_matrix(name):
    """Newton's method adds to the tangent and tries again with the same solver."""
    A = singular("floating body")
    solver, data = build(name, A, True)
    try:
        solver.refactor(data)
        solver.solve(np.ones(A.shape[0]))
    except SingularMatrix:
        pass
    B = sp.csr_matrix(A + sp.eye(A.shape[0]))
    solver.refactor(build(name, B, True)[1])
    check(solver, B)


def test_an_unknown_back_end_says_so_or_falls_back():
    """PARDISO asked for where it is missing is an error, not a silent change of solver."""
    if "pardiso" in available():
        assert make_solver("pardiso", *parts(laplace()), False).name == "pardiso"
    else:
        with pytest.raises(SingularMatrix):
            make_solver("pardiso", *parts(laplace()), False)


def test_a_factorization_is_kept_until_it_has_cost_what_a_new_one_does():
    """Few iterations too many in each of many solutions are many."""
    A = laplace()
    moved = (A + 0.3 * sp.diags(np.sin(np.arange(A.shape[0])))).tocsr()
    kept = Kept(make_solver("superlu", *parts(A), False), *parts(A), False)
    kept.refactor(A.data)
    b = np.cos(np.arange(A.shape[0]))
    solutions = 0
    while kept.counts["factorizations"] == 1:
        kept.refactor(moved.data)
        x = kept.correction(b)
        assert np.linalg.norm(moved @ x - b) < 1.1 * iterative.DIRECTION * np.linalg.norm(b)
        solutions += 1
        assert solutions <= WORTH + 1
    spent = kept.counts["gmres_iterations"]
    assert WORTH <= spent - (solutions - 1) < WORTH + 10, "the first of each would be needed anyway"
    assert np.linalg.norm(moved @ kept.correction(b) - b) < 1e-9
    assert kept.counts == {"factorizations": 2, "gmres_iterations": spent}


def test_directions_of_one_solution_serve_the_next_with_the_same_matrix():
    A = laplace()
    moved = (A + 0.3 * sp.diags(np.sin(np.arange(A.shape[0])))).tocsr()
    kept, b = Kept(make_solver("superlu", *parts(A), False), *parts(A), False), np.cos(np.arange(A.shape[0]))
    kept.refactor(A.data)
    kept.refactor(moved.data)
    kept.solve(b)
    first = kept.counts["gmres_iterations"]
    x = kept.solve(2.0 * b)
    assert first > 1 and kept.counts["gmres_iterations"] == first
    assert np.linalg.norm(moved @ x - 2.0 * b) < 1e-6 * np.linalg.norm(b)


@pytest.mark.skipif("pardiso" not in available(), reason="py-mkl-pardiso is not installed")
@pytest.mark.parametrize("skew", [0.0, 0.01, 1.0])
def test_the_symmetric_part_serves_a_matrix_that_is_nearly_symmetric_and_no_other(skew):
    n = math.isqrt(iterative.LARGE) + 1
    symmetric, whole = laplace(n), convection(n)
    A = (symmetric + skew * 40 * (whole - whole.T)).tocsr()
    A.sort_indices()
    kept, b = solver_for("kept", *parts(A), False), np.cos(np.arange(A.shape[0]))
    for change in (0.0, 1e-3, 0.5):
        now = sp.csr_matrix((A.data * (1 + change), A.indices, A.indptr), A.shape)
        kept.refactor(now.data)
        for solve, error in (
            (kept.solve, 1e-6),
            (kept.direction, 1.1 * iterative.DIRECTION),
            (kept.correction, 1.1 * iterative.DIRECTION),
        ):
            assert np.linalg.norm(now @ solve(b) - b) < error * np.linalg.norm(b)


def test_a_pattern_that_is_not_symmetric_has_no_symmetric_part():
    A = sp.csr_matrix(np.array([[1.0, 2.0], [0.0, 1.0]]))
    with pytest.raises(ValueError, match="not symmetric"):
        SymmetricPart(*parts(A))
