"""From blocks of local vectors and matrices to one right-hand side and one CSR matrix.

The pattern and the places of all local entries are found once; afterwards an assembly is one loop over them.
scikit-fem's own assembly drops zeros and may change the pattern between iterations, which would cost a
symbolic factorization each time.
"""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import scipy.sparse as sp

from cutbench.base.compiled import COMPILED, compiled
from cutbench.base.threads import GRAIN, at_once, shared_out, threads
from cutbench.forms.base import Packed, upper

#: Of places in arrays: short, and never negative, or what NumPy counts with.
_PLACE = np.uint32 if COMPILED else np.intp


@dataclass(frozen=True)
class Block:
    """Scatter of one kind of local contribution: places in a global vector of the local ones (nd·n,), and
    among CSR values of all entries of local matrices (nd·nd·n,), behind the last where one is not kept.
    """

    vectors: np.ndarray
    matrices: np.ndarray
    behind: int
    _packed: dict = field(default_factory=dict, init=False, repr=False)

    def packed(self, local: Packed, hands: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Places of the entries of ``local`` and of those opposite them, of a diagonal none, with the numbers
        of the entries; in as many parts as there are ``hands``, each with places of its own."""
        key = local.dim, local.nn, hands
        if key not in self._packed:
            rows, columns = upper(*key[:2])
            nd = local.dim * local.nn
            table = self.matrices.reshape(nd, nd, -1)
            one, other = table[rows, columns], table[columns, rows]
            other[rows == columns] = self.behind
            places = np.stack([one.ravel(), other.ravel()], axis=1).ravel()
            part = places.astype(np.intp) * hands // max(self.behind, 1)
            chosen = [np.flatnonzero(part == k).astype(_PLACE) for k in range(hands)]
            self._packed[key] = [(places[some], some // 2) for some in chosen]
        return self._packed[key]


class Pattern:
    """CSR pattern over the free degrees of freedom, with scatters for each block.

    ``symmetric``: only the upper triangle is kept (row ≤ column), as symmetric solvers want it.
    Local matrices come as (nd_i, nd_j, n) flattened.
    """

    def __init__(
        self,
        ndof: int,
        fixed: np.ndarray,
        dof_tables: dict[str, np.ndarray],
        symmetric: bool,
        idle: Collection[str] = (),
        couples: dict[str, np.ndarray] | None = None,
    ):
        """``idle``: names of blocks that have vectors alone. ``couples``: tables of local matrices by name,
        where those are not the tables of the vectors."""
        self.ndof, self.symmetric = ndof, symmetric
        free = np.ones(ndof, bool)
        free[fixed] = False
        self.free = np.flatnonzero(free)
        self._number = np.full(ndof, -1)
        self._number[self.free] = np.arange(self.free.size)
        coupled = {name: dofs for name, dofs in dof_tables.items() if name not in idle} | (couples or {})
        distinct: list[np.ndarray] = []
        which = {name: _numbered(dofs, distinct) for name, dofs in coupled.items()}
        met = _meeting([self._number[dofs] for dofs in distinct], self.free.size)
        if symmetric:
            met = sp.triu(met, format="csr")
        met.sort_indices()
        self._hold(np.repeat(np.arange(met.shape[0]), np.diff(met.indptr)), met.indices, met.indptr)
        placed = [self._placed(dofs) for dofs in distinct]
        self.blocks: dict[str, Block] = {}
        for name, dofs in dof_tables.items():
            matrices = placed[which[name]] if name in which else np.zeros(0, _PLACE)
            self.blocks[name] = Block(dofs.astype(_PLACE).ravel(), matrices, self.indices.size)

    def _hold(self, rows: np.ndarray, indices: np.ndarray, indptr: np.ndarray) -> None:
        self._rows = rows
        self.indices, self.indptr = indices.astype(np.int32), indptr.astype(np.int32)
        #: Where each diagonal entry is among the CSR values.
        self.diagonal = np.flatnonzero(rows == self.indices)

    def _placed(self, dofs: np.ndarray) -> np.ndarray:
        """Places of all entries of local matrices on ``dofs`` (nd, count)."""
        return _places(self.indptr, self.indices, self._number[dofs].astype(np.int32), self.symmetric)

    def grown(self, name: str, couples: np.ndarray) -> tuple[Pattern, np.ndarray]:
        """The pattern with other ``couples`` (nd, n) of the block ``name``, no entry less; and where the CSR
        values of this one are in it."""
        n, number = self.free.size, self._number[couples]
        rows, columns = np.broadcast_arrays(number[:, None], number[None])
        kept = (rows >= 0) & (columns >= (rows if self.symmetric else 0))
        wanted = np.unique(rows[kept] * n + columns[kept])
        codes = self._rows * n + self.indices  # rising
        at = np.searchsorted(codes, wanted)
        fresh = np.append(codes, -1)[at] != wanted
        (rows, columns), at = np.divmod(wanted[fresh], n), at[fresh]
        beyond = np.bincount(at, minlength=codes.size + 1)
        moved = (np.arange(codes.size + 1) + np.cumsum(beyond)).astype(_PLACE)
        indptr = self.indptr + np.append(0, np.cumsum(np.bincount(rows, minlength=n)))
        more = copy(self)
        more._hold(np.insert(self._rows, at, rows), np.insert(self.indices, at, columns), indptr)
        held = {id(block.matrices): block.matrices for block in self.blocks.values()}
        placed = {key: moved[matrices] for key, matrices in held.items()}
        size = more.indices.size
        more.blocks = {k: Block(b.vectors, placed[id(b.matrices)], size) for k, b in self.blocks.items()}
        more.blocks[name] = Block(self.blocks[name].vectors, more._placed(couples), size)
        return more, moved[:-1]

    @property
    def shape(self) -> tuple[int, int]:
        return self.free.size, self.free.size

    def vector(self, name: str, local: np.ndarray) -> np.ndarray:
        """Sum local vectors (nd, n) into a global one (ndof,), real or complex."""
        out = np.zeros(self.ndof, dtype=local.dtype)
        _scatter(out, self.blocks[name].vectors, local.ravel())
        return out

    def add(self, data: np.ndarray, name: str, local: np.ndarray | Packed) -> None:
        """Add local matrices (nd, nd, n) to the CSR values ``data``."""
        data += self.matrices({name: local})

    def balance(self, locals_: dict[str, np.ndarray], apart: np.ndarray) -> tuple[np.ndarray, float]:
        """Sum (ndof,) of several blocks' local vectors, and the sum of the lengths of their own global ones
        but for the unknowns ``apart``."""
        total = np.zeros(self.ndof, dtype=np.result_type(*locals_.values()))
        one, scale = np.empty_like(total), 0.0
        by = _plain_weighed if total.dtype.kind == "c" else _weighed
        for name, local in locals_.items():
            scale += by(total, one, self.blocks[name].vectors, local.ravel(), apart)
        return total, scale

    def matrices(
        self, locals_: dict[str, np.ndarray | Packed], factor: float = 0.0, begin: np.ndarray | None = None
    ) -> np.ndarray:
        """CSR values of the sum of several blocks' local matrices, and of the values ``begin`` times
        ``factor``."""
        size = self.indices.size
        data = np.zeros(size + 1) if begin is None else np.empty(size + 1)
        data[-1] = 0.0
        if begin is not None:
            shared_out(lambda a, b: np.multiply(factor, begin[a:b], out=data[a:b]), size, size)
        for name, local in locals_.items():
            block = self.blocks[name]
            if isinstance(local, Packed):
                values = local.entries.ravel()
                parts = block.packed(local, threads() if values.size > GRAIN else 1)
                at_once(*(partial(_scatter_some, data, *part, values) for part in parts))
            else:
                _scatter(data, block.matrices, local.ravel())
        return data[:-1]

    def csr(self, data: np.ndarray) -> sp.csr_matrix:
        return sp.csr_matrix((data, self.indices, self.indptr), shape=self.shape)


def _numbered(dofs: np.ndarray, distinct: list[np.ndarray]) -> int:
    """Which of the ``distinct`` tables ``dofs`` is, which is put there where it is none."""
    for k, other in enumerate(distinct):
        if np.array_equal(dofs, other):
            return k
    distinct.append(dofs)
    return len(distinct) - 1


def _meeting(tables: list[np.ndarray], n: int) -> sp.csr_matrix:
    """True (n, n) where an unknown meets another in a column of one of ``tables`` (nd, count), or itself; −1
    in them is none. A product of incidences, without a list of all local entries."""
    numbers, columns, count = [np.arange(n)], [np.arange(n)], n
    for table in tables:
        free = table >= 0
        numbers.append(table[free])
        columns.append(np.broadcast_to(np.arange(count, count + table.shape[1]), table.shape)[free])
        count += table.shape[1]
    row, column = np.concatenate(numbers), np.concatenate(columns)
    meets = sp.csr_matrix((np.ones(row.size, bool), (row, column)), shape=(n, count))
    return meets @ meets.T


def _plain_scatter(out, places, values):
    if np.iscomplexobj(values):
        out += np.bincount(places, values.real, out.size) + 1j * np.bincount(places, values.imag, out.size)
    else:
        out += np.bincount(places, values, out.size)


@compiled(_plain_scatter)
def _scatter(out, places, values):
    """Add ``values`` to ``out`` at ``places``, which may repeat."""
    for k in range(places.size):
        out[places[k]] += values[k]


@compiled(lambda out, places, numbers, values: np.add.at(out, places, values[numbers]))
def _scatter_some(out, places, numbers, values):
    for k in range(places.size):
        out[places[k]] += values[numbers[k]]


def _plain_weighed(total, one, places, values, apart):
    one[:] = 0.0
    _plain_scatter(one, places, values)
    total += one
    one[apart] = 0.0
    return float(np.linalg.norm(one.real))


@compiled(_plain_weighed)
def _weighed(total, one, places, values, apart):
    """Sum ``values`` at ``places`` up in ``one``, add that to ``total``, and say how long it is."""
    one[:] = 0.0
    for k in range(places.size):
        one[places[k]] += values[k]
    for k in range(one.size):
        total[k] += one[k]
    for k in apart:
        one[k] = 0.0
    parts = np.zeros(4)  # a processor adds up some at a time
    for k in range(one.size // 4):
        for m in range(4):
            parts[m] += one[4 * k + m] ** 2
    for k in range(one.size // 4 * 4, one.size):
        parts[0] += one[k] ** 2
    return np.sqrt(parts.sum())


def _plain_places(indptr, indices, numbers, symmetric):
    (nd, count), n = numbers.shape, indptr.size - 1
    numbered = sp.csr_matrix((np.arange(indices.size), indices, indptr), shape=(n, n))
    places = np.full((nd, nd * count), indices.size, _PLACE)
    for i in range(nd):  # a row of all local matrices at a time, to spare memory
        row = np.broadcast_to(numbers[i], (nd, count)).ravel()
        column = numbers.ravel()
        kept = np.flatnonzero((row >= 0) & (column >= (row if symmetric else 0)))
        if kept.size:  # a sparse matrix has no empty selection
            places[i, kept] = np.asarray(numbered[row[kept], column[kept]]).ravel()
    return places.ravel()


@compiled(_plain_places)
def _places(indptr, indices, numbers, symmetric):
    """Places among the values of a CSR pattern of all pairs in the columns of ``numbers`` (nd, count), behind
    the last where one is negative or, if ``symmetric``, below the diagonal."""
    nd, count = numbers.shape
    places = np.full(nd * nd * count, indices.size, _PLACE)
    for i in range(nd):
        for j in range(nd):
            for e in range(count):
                row, column = numbers[i, e], numbers[j, e]
                if row < 0 or column < 0 or (symmetric and column < row):
                    continue
                low, high = indptr[row], indptr[row + 1]
                while low < high - 1:
                    middle = (low + high) // 2
                    if indices[middle] <= column:
                        low = middle
                    else:
                        high = middle
                places[(i * nd + j) * count + e] = low
    return places
