"""Sparse direct solvers behind one interface: analyze once, refactor often, solve.

PARDISO (py-mkl-pardiso, MIT) where its wheels exist, SuperLU from scipy everywhere.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg.lapack import dgetrf, dgetrs

from cutbench.base.threads import at_once, threads
from cutbench.solver.dissection import dissected

try:
    import pymklpardiso as _mkl
except Exception:  # no wheel for this platform, or a broken MKL: SuperLU serves
    _mkl = None


class SingularMatrix(ArithmeticError):
    """The factorization failed or its solution does not satisfy the equations."""


def available() -> tuple[str, ...]:
    """Names of the solvers that this machine has, best first."""
    return ("pardiso", "superlu") if _mkl is not None else ("superlu",)


#: Mean number of entries in a row below which an ordering by minimum degree leaves less to factorize than
#: nested dissection: sections have some 22 with quadratic elements, solids 40 and more.
FLAT = 30

#: Unknowns from which on threads share a factorization.
SHARED = 4_000
#: Largest residual of a solution, relative to the right-hand side. A singular matrix leaves 1 or more.
RESIDUAL = 1e-6


def _checked(
    A: sp.csr_matrix, x: np.ndarray, b: np.ndarray, transposed: sp.spmatrix | None = None
) -> np.ndarray:
    """``x`` if it solves A x = b, else SingularMatrix: perturbed pivots return nonsense without an error."""
    Ax = A @ x if transposed is None else A @ x + transposed @ x
    # Sums of squares without BLAS: its threads cost more than they save on several columns of a section.
    error, size = (math.sqrt(np.square(each).sum()) for each in (Ax - b, b))
    if not error <= RESIDUAL * size:
        raise SingularMatrix(f"the solution leaves a residual of {error:.1e}")
    return x


def make_solver(name: str, indptr, indices, n: int, symmetric: bool) -> Pardiso | SuperLU:
    """A solver for one CSR pattern; ``symmetric``: the upper triangle is given."""
    if name == "auto":
        name = available()[0]
    if name == "pardiso":
        if _mkl is None:
            raise SingularMatrix("py-mkl-pardiso is not installed here")
        # Phases one by one are the package's own affair: where it has none, one thread does all.
        shared = threads() > 1 and n >= SHARED and hasattr(_mkl, "_PardisoSolver")
        return (Dissected if shared else Pardiso)(indptr, indices, n, symmetric)
    return SuperLU(indptr, indices, n, symmetric)


class Pardiso:
    """MKL PARDISO, type −2 (upper triangle) or 11; the symbolic part is kept."""

    name = "pardiso"

    def __init__(self, indptr, indices, n, symmetric):
        self._pattern = (indices.astype(np.int32), indptr.astype(np.int32))
        self._n, self._symmetric, self._solver = n, symmetric, None
        entries = (2 * indices.size - n) if symmetric else indices.size
        self._ordering = 0 if entries < FLAT * n else 2
        self._data = np.zeros(0)
        self._matrices: tuple = ()

    def refactor(self, data: np.ndarray) -> None:
        self._data, self._matrices = data, ()
        try:
            if self._solver is None:
                # iparm starts at zero with the first entry set: ordering by minimum degree or METIS, pivots
                # perturbed by 1e-8 (symmetric) or 1e-13, no refinement: the solution is checked. Scaling and
                # matching are for matrices with unknowns that do not resist themselves; they take a fifth of
                # the time.
                matrix = sp.csr_matrix((data, *self._pattern), shape=(self._n, self._n))
                match = 0 if matrix.diagonal().min(initial=np.inf) > 0 else 1
                perturbed = 8 if self._symmetric else 13
                iparms = {
                    0: 1, 1: self._ordering, 7: 0, 9: perturbed, 10: match, 12: match, 20: 1, 34: 1,
                }  # fmt: skip
                kind = _mkl.MTYPE_REAL_SYM_INDEF if self._symmetric else _mkl.MTYPE_REAL_NONSYM
                self._solver = _analyzed(matrix, kind, iparms)
            else:
                again = "refactor_values" if hasattr(self._solver, "refactor_values") else "refactor"
                getattr(self._solver, again)(data)
        except RuntimeError as error:
            self._solver = None
            raise SingularMatrix(str(error)) from error

    def back(self, b: np.ndarray) -> np.ndarray:
        """Back-substitution with the last factorization, not checked."""
        assert self._solver is not None, "a matrix is factorized before it is solved with"
        return self._solver.solve(np.ascontiguousarray(b))

    def solve(self, b: np.ndarray) -> np.ndarray:
        if not self._matrices:
            A = sp.csr_matrix((self._data, *self._pattern), shape=(self._n, self._n))
            self._matrices = A, sp.triu(A, 1).T if self._symmetric else None
        A, mirror = self._matrices
        return _checked(A, self.back(b), b, mirror)


class Dissected(Pardiso):
    """PARDISO by threads: unknowns are parted so that those of two parts meet in a border alone. What a part
    makes of the border (its Schur complement) is factorized and solved with by a thread of its own, the sum
    of all as a full matrix (A. George, SIAM J. Numer. Anal. 10, 1973). py-mkl-pardiso has one thread a
    factorization.
    """

    _parts: tuple = ()
    _full: list | None = None

    def _arrange(self) -> None:
        (indices, indptr), shape = self._pattern, (self._n, self._n)
        # Of the numbers of all entries, from 1 on, as a matrix.
        entries = sp.csr_matrix((np.arange(1.0, indices.size + 1), indices, indptr), shape=shape)
        self._diagonal = entries.diagonal().astype(int) - 1
        if self._symmetric:
            entries = (entries + sp.triu(entries, 1).T).tocsr()
        self._border, groups = dissected(entries.astype(bool), np.arange(self._n), threads())
        self._parts = tuple(_Part(group, self._border, entries, self._symmetric) for group in groups)
        self._within = entries[self._border][:, self._border].tocoo()

    def refactor(self, data: np.ndarray) -> None:
        if not self._parts:
            self._arrange()
        self._data, self._matrices, self._full = data, (), None
        # Schur complements are made without matching, which unknowns that do not resist themselves need.
        if len(self._parts) < 2 or not data[self._diagonal].min() > 0:
            return super().refactor(data)
        try:
            at_once(*(partial(part.refactor, data) for part in self._parts))
        except RuntimeError as error:
            raise SingularMatrix(str(error)) from error
        full, within = np.zeros((self._border.size, self._border.size)), self._within
        full[within.row, within.col] = data[within.data.astype(int) - 1]
        for part in self._parts:
            full[np.ix_(part.border, part.border)] += part.schur
        *self._full, singular = dgetrf(full)
        if singular:
            raise SingularMatrix("what parts of the matrix leave over is singular")

    def back(self, b: np.ndarray) -> np.ndarray:
        if self._full is None:
            return super().back(b)
        if b.ndim > 1:
            return np.stack([self.back(column) for column in b.T], axis=1)
        x, border = np.empty(self._n), b[self._border]
        at_once(*(partial(part.forward, b) for part in self._parts))
        for part in self._parts:
            border[part.border] += part.left
        x[self._border] = border = dgetrs(*self._full, border)[0]
        at_once(*(partial(part.backward, border, x) for part in self._parts))
        return x


class _Part:
    """The unknowns ``inside`` of a matrix with those of the ``border`` that they meet, and nothing of that
    itself; ``entries``: the numbers of all of its own, from 1 on."""

    def __init__(self, inside: np.ndarray, border: np.ndarray, entries: sp.csr_matrix, symmetric: bool):
        rows = entries[inside]
        self.inside, self.border = inside, np.flatnonzero(np.isin(border, rows.indices))
        met, count = border[self.border], inside.size
        # The solver wants a diagonal of the border, too.
        blocks = [[rows[:, inside], rows[:, met]], [entries[met][:, inside], -sp.eye_array(met.size)]]
        whole = sp.block_array(blocks, format="csr")
        whole = sp.csr_matrix(sp.triu(whole) if symmetric else whole)
        whole.sort_indices()
        n, self._take = count + met.size, np.maximum(whole.data - 1, 0).astype(int)
        self._corner = np.flatnonzero(whole.data < 0)
        kind = _mkl.MTYPE_REAL_SYM_INDEF if symmetric else _mkl.MTYPE_REAL_NONSYM
        self._solver = _opened(whole, kind, {0: 1, 1: 2, 9: 8 if symmetric else 13, 20: 1, 34: 1, 35: 2})
        self._solver.set_perm((np.arange(n) >= count).astype(np.int64))
        self._solver.run_phase(11)
        self._out, (self._b, self._y, self._x) = np.zeros(-(-(met.size**2) // n) * n), np.zeros((3, n))
        self.schur = self._out[: met.size**2].reshape(met.size, -1)
        #: What the last right-hand side leaves over for the border.
        self.left = self._y[count:]

    def refactor(self, data: np.ndarray) -> None:
        values, out = np.take(data, self._take), self._out.reshape(self._b.size, -1, order="F")
        values[self._corner] = 0.0
        self._solver.set_values(values)
        self._solver.run_phase_into(22, out, out)

    def forward(self, b: np.ndarray) -> None:
        self._b[: self.inside.size] = b[self.inside]
        self._solver.run_phase_into(331, self._b, self._y)

    def backward(self, border: np.ndarray, x: np.ndarray) -> None:
        """Of the unknowns' values, with those of the border, into ``x``."""
        self.left[:] = border[self.border]
        self._solver.run_phase_into(333, self._y, self._x)
        x[self.inside] = self._x[: self.inside.size]


def _opened(matrix: sp.csr_matrix, kind: int, iparms: dict[int, int]):
    """PARDISO with the pattern of ``matrix``."""
    solver = _mkl._PardisoSolver(kind, 0)
    for index, value in iparms.items():
        solver.set_iparm(index, value)
    indptr, indices = (np.asarray(a, np.int64) for a in (matrix.indptr, matrix.indices))
    solver.set_pattern(ia=indptr, ja=indices, n=matrix.shape[0])
    return solver


def _analyzed(matrix: sp.csr_matrix, kind: int, iparms: dict[int, int]):
    """PARDISO with the ``matrix`` factorized. The package's own front end looks at each row of it in Python,
    which takes three times as long as PARDISO."""
    if not hasattr(_mkl, "_PardisoSolver"):  # it is the package's own affair what stands behind
        return _mkl.PardisoSolver(matrix, kind, iparms=iparms)
    solver = _opened(matrix, kind, iparms)
    solver.factor(matrix.data)
    return solver


class SuperLU:
    """SuperLU with the ordering found once, no pivoting where that is safe, checked by its residual."""

    name = "superlu"

    def __init__(self, indptr, indices, n, symmetric):
        self._pattern, self._n, self._symmetric = (indices, indptr), n, symmetric
        self._order: np.ndarray | None = None

    def _full(self, data):
        A = sp.csr_matrix((data, *self._pattern), shape=(self._n, self._n))
        if self._symmetric:
            A = A + sp.triu(A, 1).T
        return A.tocsc()

    def refactor(self, data: np.ndarray) -> None:
        A = self._full(data)
        self._A = A
        if self._order is None:
            # The ordering needs the pattern alone: a matrix of its kind that can always be factorized.
            safe = A.copy()
            safe.data = np.full(A.nnz, -1.0)
            safe.setdiag(1.0 + np.diff(A.indptr))
            lu = spla.splu(
                safe.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
            self._order = np.argsort(lu.perm_c)
        P = A[self._order][:, self._order]
        try:
            lu = spla.splu(P, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            self._lu, self._permuted = lu, True
            probe = A @ np.ones(self._n)
            error = np.abs(self.back(probe) - 1).max()
            if np.isfinite(error) and error < 1e-4:
                return
        except RuntimeError:
            pass
        try:
            self._lu, self._permuted = spla.splu(A), False
        except RuntimeError as error:
            raise SingularMatrix(str(error)) from error

    def back(self, b: np.ndarray) -> np.ndarray:
        """Back-substitution with the last factorization, not checked."""
        if not self._permuted:
            return self._lu.solve(b)
        x = np.empty_like(b)
        x[self._order] = self._lu.solve(b[self._order])
        return x

    def solve(self, b: np.ndarray) -> np.ndarray:
        x = self.back(b)
        return _checked(self._A, x + self.back(b - self._A @ x), b)
