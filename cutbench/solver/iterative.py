"""Iterative solvers behind the interface of the direct ones: fewer factorizations, or none.

In three dimensions a factorization costs as much as tens of back-substitutions, and its fill outgrows the
memory before the matrix does. ``Kept`` preconditions GMRES with the last factorization until it is too old;
``Multigrid`` with an algebraic multigrid hierarchy (PyAMG, smoothed aggregation over the rigid motions),
kept as long. Both check their solutions as the direct solvers do.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import daxpy

from cutbench.base.compiled import COMPILED, compiled
from cutbench.base.errors import BadInput
from cutbench.base.threads import shared_out
from cutbench.solver.linear import RESIDUAL, SingularMatrix, make_solver

try:
    import pyamg
except ImportError:
    pyamg = None

#: Largest residual of a solution, relative to the right-hand side.
TOLERANCE = RESIDUAL / 10
#: The same for a direction of Newton's method, or a correction with an old tangent: the next one sets right
#: what it leaves.
DIRECTION = 0.1
#: Unknowns of a solid above which keeping a factorization gains anything; above which the symmetric part's,
#: which PARDISO has in three fifths of the time and half of the memory, makes up for its iterations.
SMALL, LARGE = 5_000, 15_000
#: Iterations that a factorization costs as much as.
WORTH = 15
#: Iterations after which the symmetric part, just factorized, is not worth what it saves.
HALF = 20
#: The same for a hierarchy, which is cheaper to make, and the largest number of iterations with a fresh one.
OLD_HIERARCHY, MAX_ITERATIONS = 60, 400
#: Directions that GMRES keeps before it restarts.
RESTART = 100


def solver_for(name: str, indptr, indices, n: int, symmetric: bool, modes: np.ndarray | None = None):
    """A solver for one CSR pattern, as ``make_solver``, with the iterative ones.

    ``modes`` (n, 6), the rigid motions, are given in three dimensions, and there ``auto`` keeps
    factorizations (``kept``). Raises BadInput for ``multigrid`` without PyAMG.
    """
    pattern = indptr, indices, n
    if name == "multigrid" and pyamg is None:
        wanted = "another solver, or PyAMG installed: pip install 'cutbench[large]'"
        raise BadInput(key="solver", value=name, expected=wanted)
    if name == "multigrid":
        return Multigrid(*pattern, symmetric, modes)
    if name == "auto" and modes is not None and n > SMALL:
        name = "kept"
    keeps = name == "kept"
    direct = make_solver("auto" if keeps else name, *pattern, symmetric)
    half = None
    if direct.name == "pardiso" and not symmetric and (n > LARGE if keeps else modes is None):
        with suppress(ValueError):  # what has another pattern than its transpose
            half = SymmetricPart(*pattern)
    if keeps:
        return Kept(direct, *pattern, symmetric, half)
    return direct if half is None else Kept(direct, *pattern, symmetric, half, worth=0)


def rigid_motions(X: np.ndarray) -> np.ndarray:
    """Displacements (dim·n, 6 or 3) of the rigid motions of nodes X (dim, n), numbered node·dim + i."""
    dim, n = X.shape
    X = X - X.mean(axis=1, keepdims=True)
    planes = [(0, 1)] if dim == 2 else [(0, 1), (1, 2), (2, 0)]
    modes = np.zeros((n, dim, dim + len(planes)))
    for i in range(dim):
        modes[:, i, i] = 1.0
    for k, (i, j) in enumerate(planes):
        modes[:, i, dim + k], modes[:, j, dim + k] = -X[j], X[i]
    return modes.reshape(n * dim, -1)


class Stagnation(ArithmeticError):
    """GMRES did not reach its tolerance in the ``iterations`` that it took."""

    def __init__(self, left: float, iterations: int):
        super().__init__(f"residual {left:.1e} after {iterations} iterations")
        self.iterations = iterations


def gmres(
    matvec: Callable[[np.ndarray], np.ndarray],
    precondition: Callable[[np.ndarray], np.ndarray],
    b: np.ndarray,
    *,
    tolerance: float,
    most: int,
    restart: int = RESTART,
    steady: bool = False,
    directions: list[tuple[np.ndarray, np.ndarray]] | None = None,
) -> tuple[np.ndarray, int]:
    """Solve A x = b by GMRES, preconditioned from the right, in the form of generalized conjugate residuals.

    So the residual it watches is that of the equations, and ends at ``tolerance`` times |b|. Preconditioned
    directions are kept: each iteration preconditions once, where making x of others would do so once more.
    They, with what the matrix makes of them, are added to ``directions``, and serve the next right-hand side.
    Returns x and the iterations; raises Stagnation after ``most``, or, if ``steady``, from the third on where
    ``most`` iterations like those so far would not do.
    """
    size, x, done = float(np.linalg.norm(b)), np.zeros_like(b), 0
    if size == 0:
        return x, 0
    r, left = b, 1.0
    directions = [] if directions is None else directions
    for direction, image in directions:
        along = image @ r
        x, r = daxpy(direction, x, a=along), r - along * image
    if directions:
        left = float(np.linalg.norm(r)) / size
    while left > tolerance and done < most:
        z = precondition(r)
        w = matvec(z)
        for direction, image in directions:
            along = image @ w
            z, w = daxpy(direction, z, a=-along), daxpy(image, w, a=-along)
        length = float(np.linalg.norm(w))
        if not 0 < length < np.inf:
            break
        z, w = z / length, w / length
        step = w @ r
        x, r = daxpy(z, x, a=step), r - step * w
        if len(directions) >= restart:
            directions.clear()
        directions.append((z, w))
        left, done = float(np.linalg.norm(r)) / size, done + 1
        if steady and done > 2 and left > tolerance ** (done / most):
            break
    if tolerance < DIRECTION:  # below that r may have lost what rounding takes
        left = float(np.linalg.norm(b - matvec(x))) / size
    if not left <= tolerance * (1 + 1e-3):  # rounding
        raise Stagnation(left, done)
    return x, done


class _Matrix:
    """The current matrix of a pattern; symmetric ones are given by their upper triangle."""

    def __init__(self, indptr, indices, n: int, symmetric: bool):
        self._A = sp.csr_matrix((np.zeros(indices.size), indices, indptr), shape=(n, n))
        self._symmetric = symmetric

    def set(self, data: np.ndarray) -> None:
        self._A.data = data
        self._mirror = sp.triu(self._A, 1).T.tocsr() if self._symmetric else None

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        y = _product(self._A, x)
        return y if self._mirror is None else y + _product(self._mirror, x)

    def full(self) -> sp.csr_matrix:
        return self._A if self._mirror is None else (self._A + self._mirror).tocsr()


class SymmetricPart:
    """The symmetric part (A + Aᵀ)/2 of a matrix with one CSR pattern, factorized. Of a tangent what is not
    symmetric is friction and pressure that turns with the surface, at few of the unknowns.

    Raises ValueError where the pattern is not that of the transpose, or not sorted.
    """

    def __init__(self, indptr, indices, n: int):
        rows = np.repeat(np.arange(n), np.diff(indptr))
        numbers = sp.csr_matrix((np.arange(1.0, indices.size + 1), indices, indptr), shape=(n, n))
        mirrored = numbers.T.tocsr()
        mirrored.sort_indices()
        if not (np.array_equal(mirrored.indices, indices) and np.array_equal(mirrored.indptr, indptr)):
            raise ValueError("the pattern is not symmetric, or its indices are not sorted")
        self._one = np.flatnonzero(indices >= rows).astype(np.uint32)
        self._other = mirrored.data[self._one].astype(np.uint32) - 1
        counts = np.bincount(rows[self._one], minlength=n)
        upper = np.concatenate([[0], np.cumsum(counts)]), indices[self._one]
        self._direct = make_solver("auto", *upper, n, True)

    def refactor(self, data: np.ndarray) -> None:
        mean = np.empty(self._one.size)
        shared_out(partial(_mean, data, self._one, self._other, mean), mean.size, mean.size)
        self._direct.refactor(mean)

    def back(self, b: np.ndarray) -> np.ndarray:
        return self._direct.back(b)


def _plain_mean(data, one, other, out, begin, end):
    out[begin:end] = (data[one[begin:end]] + data[other[begin:end]]) / 2


@compiled(_plain_mean)
def _mean(data, one, other, out, begin, end):
    for k in range(begin, end):
        out[k] = (data[one[k]] + data[other[k]]) / 2


def _product(A: sp.csr_matrix, x: np.ndarray) -> np.ndarray:
    if not COMPILED or x.ndim > 1:
        return A @ x
    y = np.empty(A.shape[0])
    # Compiled loops look at each place that has a sign whether it counts from the end.
    indptr, indices = (a.view(f"u{a.itemsize}") for a in (A.indptr, A.indices))
    shared_out(partial(_rows_times, indptr, indices, A.data, x, y), y.size, A.nnz)
    return y


@compiled()
def _rows_times(indptr, indices, data, x, y, begin, end):
    for i in range(begin, end):
        total = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            total += data[k] * x[indices[k]]
        y[i] = total


class Kept:
    """GMRES, preconditioned by the factorization of a matrix that this one once was: of its symmetric part
    ``half``, where that is given. It is renewed once the iterations that it has cost too many are ``worth`` a
    new one: at once where that is 0. Where even a new one of the symmetric part serves badly, the whole
    matrix is factorized from then on.
    """

    def __init__(
        self, direct, indptr, indices, n: int, symmetric: bool, half: SymmetricPart | None = None,
        worth: int = WORTH,
    ):  # fmt: skip
        self.name = direct.name
        self._direct, self._matrix = direct, _Matrix(indptr, indices, n, symmetric)
        self._half, self._worth, self._data = half, worth, np.zeros(0)
        self._have = self._fresh = False
        #: Unknowns (m,) whose part of the matrix somebody has factorized since, and that factorization.
        self._newer: tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]] | None = None
        #: Directions of solutions with the present matrix, and what it makes of them.
        self._directions: list[tuple[np.ndarray, np.ndarray]] = []
        self._spent = 0
        #: Iterations that the first solution with a factorization took: of a whole one it is done in one.
        self._least = 1
        #: Factorizations and GMRES iterations so far.
        self.counts = {"factorizations": 0, "gmres_iterations": 0}

    def refactor(self, data: np.ndarray) -> None:
        """Take the matrix of these CSR values; the factorization is renewed where it needs that."""
        self._data, self._fresh, self._directions = data, False, []
        self._matrix.set(data)
        if not self._have:
            self._renew()

    def renewed_at(self, where: np.ndarray, back: Callable[[np.ndarray], np.ndarray]) -> None:
        """Of the unknowns ``where`` (m,) there is a newer factorization, which solves by ``back``. While the
        matrix changes there alone, the old one of all of them serves on with it: each takes up what the other
        leaves over (multiplicative Schwarz; B. Smith, P. Bjørstad, W. Gropp, Domain Decomposition, 1996).
        """
        self._newer = where, back

    def _renew(self) -> None:
        self._have, self._newer = False, None
        (self._half or self._direct).refactor(self._data)
        self._have = self._fresh = True
        self._spent, self._least = 0, 1 if self._half is None else 0
        self.counts["factorizations"] += 1

    def back(self, b: np.ndarray) -> np.ndarray:
        """As a direct solver's: with what is factorized, not checked."""
        x = (self._half or self._direct).back(b)
        if self._newer is not None:
            where, back = self._newer
            x[where] += back((b - self._matrix @ x)[where])
        return x

    def solve(self, b: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
        if not self._fresh and self._spent < self._worth:
            try:
                return self._iterated(b, tolerance, self._least + self._worth, steady=True)
            except Stagnation as error:
                self.counts["gmres_iterations"] += error.iterations
        if not self._fresh:
            self._renew()
        if self._half is not None:
            try:
                return self._iterated(b, tolerance, HALF)
            except Stagnation as error:
                self.counts["gmres_iterations"] += error.iterations
            self._half = None
            self._renew()
        return self._direct.solve(b)

    def _iterated(self, b: np.ndarray, tolerance: float, most: int, steady: bool = False) -> np.ndarray:
        x, count = gmres(
            self._matrix.__matmul__, self.back, b, tolerance=tolerance, most=most, steady=steady,
            # Where each matrix is factorized one iteration does, and there is nothing to take over.
            directions=self._directions if self._worth else None,
        )  # fmt: skip
        self.counts["gmres_iterations"] += count
        self._spent += max(count - max(self._least, 1), 0)
        self._least = self._least or count
        return x

    def direction(self, b: np.ndarray) -> np.ndarray:
        """Of Newton's method, as exact as what follows it asks for."""
        return self.solve(b, DIRECTION)

    correction = direction


class Multigrid:
    """GMRES preconditioned by smoothed aggregation of the symmetric part; nothing is factorized.

    ``modes`` (n, 6): the rigid motions at the unknowns, which the coarse levels must hold. Raises
    SingularMatrix where GMRES does not converge: an indefinite or badly conditioned matrix, for which
    Newton's method then takes a smaller step.
    """

    name = "multigrid"

    def __init__(self, indptr, indices, n: int, symmetric: bool, modes: np.ndarray | None):
        self._matrix, self._modes = _Matrix(indptr, indices, n, symmetric), modes
        self._cycle: Callable[[np.ndarray], np.ndarray] | None = None
        self._fresh = False
        self.counts = {"hierarchies": 0, "gmres_iterations": 0}

    def refactor(self, data: np.ndarray) -> None:
        self._matrix.set(data)
        self._fresh = False
        if self._cycle is None:
            self._renew()

    def _renew(self) -> None:
        A = self._matrix.full()
        A = ((A + A.T) * 0.5).tocsr()
        smoother = ("gauss_seidel", {"sweep": "symmetric"})
        with np.errstate(all="ignore"):
            levels = pyamg.smoothed_aggregation_solver(
                A,
                B=self._modes,
                symmetry="symmetric",
                strength=("symmetric", {"theta": 0.02}),
                presmoother=smoother,
                postsmoother=smoother,
                max_coarse=500,
                coarse_solver="splu",
            )
        self._cycle = levels.aspreconditioner(cycle="V").matvec
        self._fresh = True
        self.counts["hierarchies"] += 1

    def direction(self, b: np.ndarray) -> np.ndarray:
        return self.solve(b, DIRECTION)

    correction = direction

    def solve(self, b: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
        for fresh in (self._fresh, True):
            if fresh and not self._fresh:
                self._renew()
            try:
                most = MAX_ITERATIONS if fresh else OLD_HIERARCHY
                assert self._cycle is not None, "a hierarchy is made before it is used"
                x, count = gmres(self._matrix.__matmul__, self._cycle, b, tolerance=tolerance, most=most)
            except Stagnation as error:
                if fresh:
                    self._cycle = None
                    raise SingularMatrix(f"multigrid: {error}") from error
                continue
            self.counts["gmres_iterations"] += count
            return x
        raise AssertionError("unreachable")
