"""Threads that share the work of one run: the same answers with any number of them."""

import json
import time

import numpy as np
import pytest
import scipy.sparse as sp
from typer.testing import CliRunner

import cutbench
from cutbench.base.threads import at_once, shared_out, sharing, threads, threads_of_a_run
from cutbench.cli.main import app
from cutbench.solver.linear import SHARED, SingularMatrix, available, make_solver

needs_pardiso = pytest.mark.skipif("pardiso" not in available(), reason="PARDISO is not there")
#: Small, and with a factorization that threads share.
BLOCK = {
    "width": "8 mm", "height": "6 mm", "length": "8 mm", "element": "P2", "h": "1.5", "corner": 0.5,
    "layers": 4, "depth": "0.3 mm", "until": "depth",
}  # fmt: skip


def solid(n: int, symmetric: bool, shift: float = 0.3) -> sp.csr_matrix:
    """Three unknowns at each point of a grid, that meet those of the neighbours."""
    line = sp.diags_array([-np.ones(n - 1), 2.2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    one = sp.eye_array(n)
    grid = (
        sp.kron(sp.kron(line, one), one) + sp.kron(sp.kron(one, line), one) + sp.kron(sp.kron(one, one), line)
    )
    own = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, 0.2], [0.5, 0.2, 4.0]])
    A = sp.kron(grid, own).tocsr()
    if not symmetric:
        A = (A + shift * sp.triu(A, 1)).tocsr()
    A.sort_indices()
    return A


@needs_pardiso
@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_factorization_that_is_shared_solves_the_same_equations(count, symmetric):
    A = solid(13, symmetric)
    given = sp.triu(A).tocsr() if symmetric else A
    given.sort_indices()
    b = np.cos(np.arange(2 * A.shape[0])).reshape(2, -1)
    assert A.shape[0] > SHARED
    with sharing(count):
        solver = make_solver("pardiso", given.indptr, given.indices, A.shape[0], symmetric)
        for factor in (1.0, 2.0):  # values are renewed on the same pattern
            solver.refactor(factor * given.data)
            np.testing.assert_allclose(factor * A @ solver.solve(b[0]), b[0], atol=1e-10)
        np.testing.assert_allclose(2 * A @ solver.back(b.T), b.T, atol=1e-10)


@needs_pardiso
def test_unknowns_that_do_not_resist_themselves_are_solved_for_too():
    A = solid(13, True)
    # A multiplier holds two unknowns together.
    hold = sp.csr_matrix(([1.0, -1.0], ([0, 0], [5, 900])), shape=(1, A.shape[0]))
    whole = sp.block_array([[A, hold.T], [hold, sp.csr_matrix((1, 1))]]).tocsr()
    given = (sp.triu(whole) + sp.csr_matrix(([1.0], ([A.shape[0]], [A.shape[0]])), shape=whole.shape)).tocsr()
    given.sort_indices()
    given.data[given.indptr[-2]] = 0.0
    b = np.sin(np.arange(whole.shape[0]))
    with sharing(2):
        solver = make_solver("pardiso", given.indptr, given.indices, whole.shape[0], True)
        solver.refactor(given.data)
        np.testing.assert_allclose(whole @ solver.solve(b), b, atol=1e-9)


@needs_pardiso
def test_a_singular_matrix_is_one_with_threads_too():
    A = solid(13, True)
    A.data[:] = 1.0
    given = sp.triu(A).tocsr()
    with sharing(2), pytest.raises(SingularMatrix):
        solver = make_solver("pardiso", given.indptr, given.indices, A.shape[0], True)
        solver.refactor(given.data)
        solver.solve(np.cos(np.arange(A.shape[0])))


def test_a_block_is_the_same_with_any_number_of_threads():
    one, two, four = (
        cutbench.run3d("gelatin", threads=count, snapshots_mm=(), **BLOCK) for count in (1, 2, 4)
    )
    assert one.counts["degrees_of_freedom"] > SHARED and one.outcome.done
    for other in (two, four):
        assert other.counts["steps"] == one.counts["steps"]
        for name in ("displacement_mm", "force_N", "reaction_N"):
            size = np.abs(one.curve[name]).max()
            np.testing.assert_allclose(
                other.curve[name], one.curve[name], rtol=0, atol=1e-7 * size, err_msg=name
            )


def test_work_is_shared_out_once_and_at_once():
    done, size = np.zeros(1000), 10**7
    with sharing(3):
        assert threads() == 3
        began = time.perf_counter()
        at_once(*[lambda: time.sleep(0.2)] * 3)
        assert time.perf_counter() - began < 0.4
        shared_out(lambda a, b: np.add(done[a:b], 1, out=done[a:b]), done.size, size)
        at_once(*[lambda: done.__iadd__(1)] * 1)
    assert threads() == 1 and np.all(done == 2)


def test_an_error_in_any_thread_is_the_callers_and_the_next_work_is_not_disturbed():
    seen = []

    def fail():
        raise ValueError("no")

    with sharing(2):
        for calls in ((fail, lambda: seen.append(1)), (lambda: seen.append(1), fail)):
            with pytest.raises(ValueError, match="no"):
                at_once(*calls)
        # More work than threads, and NumPy's errors as they are here.
        with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
            at_once(lambda: None, lambda: np.ones(1) / np.zeros(1))
        at_once(*[lambda: seen.append(1)] * 5)
    assert len(seen) == 7


def test_a_run_takes_the_threads_that_it_is_given(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert threads_of_a_run() == 3
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert threads_of_a_run() >= 1
    with pytest.raises(cutbench.BadInput, match="threads"):
        cutbench.run3d("gelatin", threads=0, **BLOCK)


@pytest.mark.parametrize("text", ["0", "two"])
def test_the_command_refuses_what_is_no_number_of_threads(text, tmp_path):
    done = CliRunner().invoke(app, ["run3d", "gelatin", f"--threads={text}", f"--out={tmp_path}"])
    assert done.exit_code == 2 and f"--threads = '{text}'" in done.output and "1 or more" in done.output


def test_the_command_says_how_many_threads_it_took(tmp_path):
    # Elements too large for use.
    changes = ["width=10 mm", "length=10 mm", "height=5 mm", "thickness=1 mm", "numerics=fast", "element=P1"]
    options = [f"--set={change}" for change in changes] + ["--h=2", "--depth=0.05", "--no-plane-strain"]
    done = CliRunner().invoke(app, ["run3d", "gelatin", "--threads=2", *options, f"--out={tmp_path}"])
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["platform"]["threads"] == 2
    assert threads() == 1
