"""From blocks of local vectors and matrices to one right-hand side and one CSR matrix.

The pattern and the places of all local entries are found once; afterwards an assembly is one sparse
product a block. scikit-fem's own assembly drops zeros and may change the pattern between iterations,
which would cost a symbolic factorization each time.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class Block:
    """Scatter of one kind of local contribution: ``dofs`` (nd, n) global numbers.

    ``places`` are the CSR values that the local matrices reach: few for a block of faces.
    """

    dofs: np.ndarray
    vector: sp.csr_matrix  # (ndof, nd·n)
    places: np.ndarray  # (reached,)
    matrix: sp.csr_matrix  # (reached, entries)


class Pattern:
    """CSR pattern over the free degrees of freedom, with scatters for each block.

    ``symmetric``: only the upper triangle is kept (row ≤ column), as symmetric solvers want it.
    Local matrices come as (nd_i, nd_j, n) flattened; ``pairs`` of a block may restrict them.
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
        couples = couples or {}
        self.ndof, self.symmetric = ndof, symmetric
        free = np.ones(ndof, bool)
        free[fixed] = False
        self.free = np.flatnonzero(free)
        self.number = np.full(ndof, -1)
        self.number[self.free] = np.arange(self.free.size)
        n = self.free.size
        # Which degrees of freedom meet: products of incidences, without a list of all local entries.
        met = sp.identity(n, dtype=bool, format="csr")
        coupled = {name: dofs for name, dofs in dof_tables.items() if name not in idle} | couples
        for dofs in _distinct(coupled):
            met = met + _incidence(self.number[dofs], n)
        if symmetric:
            met = sp.triu(met, format="csr")
        met.sort_indices()
        self.indices, self.indptr = met.indices.astype(np.int32), met.indptr.astype(np.int32)
        numbered = sp.csr_matrix((np.arange(1, met.nnz + 1), self.indices, self.indptr), shape=(n, n))
        self.diagonal = numbered.diagonal() - 1
        self.blocks: dict[str, Block] = {}
        self._stacks: dict[tuple[str, ...], sp.csr_matrix] = {}
        for name, dofs in coupled.items():
            twin = next((block for block in self.blocks.values() if np.array_equal(block.dofs, dofs)), None)
            vectors = dof_tables[name]
            self.blocks[name] = twin or self._block(vectors, dofs, numbered)
        for name in dof_tables.keys() - coupled.keys():
            dofs, nothing = dof_tables[name], sp.csr_matrix((0, dof_tables[name].size))
            self.blocks[name] = Block(dofs, self._vector(dofs), np.zeros(0, int), nothing)

    def _block(self, vectors: np.ndarray, dofs: np.ndarray, numbered: sp.csr_matrix) -> Block:
        """Scatter of local ``vectors``, and of the local entries of ``dofs``; ``numbered`` holds places in
        the CSR values, from 1."""
        nd, count = dofs.shape
        entries, reached = [], []
        for i in range(nd):  # a row of all local matrices at a time, to spare memory
            row = np.broadcast_to(self.number[dofs[i]], (nd, count)).ravel()
            col = self.number[dofs].ravel()
            keep = (row >= 0) & (col >= 0)
            if self.symmetric:
                keep &= row <= col
            chosen = np.flatnonzero(keep)
            entries.append(chosen + i * nd * count)
            if chosen.size == 0:  # all of it fixed: a sparse matrix has no empty selection
                reached.append(np.zeros(0, int))
                continue
            reached.append(np.asarray(numbered[row[chosen], col[chosen]]).ravel() - 1)
        at, where = np.concatenate(reached), np.concatenate(entries)
        used = np.zeros(self.indices.size, bool)
        used[at] = True
        row = (np.cumsum(used) - 1)[at]
        places = np.flatnonzero(used)
        matrix = sp.csr_matrix((np.ones(row.size), (row, where)), shape=(places.size, nd * nd * count))
        return Block(vectors, self._vector(vectors), places, matrix)

    def _vector(self, dofs: np.ndarray) -> sp.csr_matrix:
        ones = np.ones(dofs.size)
        return sp.csr_matrix((ones, (dofs.ravel(), np.arange(dofs.size))), shape=(self.ndof, dofs.size))

    @property
    def shape(self) -> tuple[int, int]:
        return self.free.size, self.free.size

    def vector(self, name: str, local: np.ndarray) -> np.ndarray:
        """Sum local vectors (nd, n) into a global one (ndof,), real or complex."""
        return self.blocks[name].vector @ local.ravel()

    def add(self, data: np.ndarray, name: str, local: np.ndarray) -> None:
        """Add local matrices (nd, nd, n) to the CSR values ``data``."""
        block = self.blocks[name]
        values = block.matrix @ local.ravel()
        if block.places.size == data.size:
            data += values
        else:
            data[block.places] += values

    def vectors(self, locals_: dict[str, np.ndarray]) -> np.ndarray:
        """As ``vector`` for several blocks in one product: (blocks, ndof), in the order given."""
        names = tuple(locals_)
        scatter = self._stacks.get(names)
        if scatter is None:
            scatter = sp.block_diag([self.blocks[name].vector for name in names], format="csr")
            self._stacks[names] = scatter
        stacked = np.concatenate([local.ravel() for local in locals_.values()])
        return (scatter @ stacked).reshape(len(names), -1)

    def matrices(self, locals_: dict[str, np.ndarray]) -> np.ndarray:
        """CSR values of the sum of several blocks' local matrices, in one product."""
        names = (*locals_, "matrices")
        scatter = self._stacks.get(names)
        if scatter is None:
            parts = []
            for name in locals_:
                block = self.blocks[name]
                rows = sp.csr_matrix(
                    (np.ones(block.places.size), (block.places, np.arange(block.places.size))),
                    shape=(self.indices.size, block.places.size),
                )
                parts.append(rows @ block.matrix)
            scatter = sp.hstack(parts, format="csr")
            self._stacks[names] = scatter
        return scatter @ np.concatenate([local.ravel() for local in locals_.values()])

    def csr(self, data: np.ndarray) -> sp.csr_matrix:
        return sp.csr_matrix((data, self.indices, self.indptr), shape=self.shape)


def _distinct(tables: dict[str, np.ndarray]) -> list[np.ndarray]:
    found: list[np.ndarray] = []
    for dofs in tables.values():
        if not any(np.array_equal(dofs, other) for other in found):
            found.append(dofs)
    return found


def _incidence(numbers: np.ndarray, n: int) -> sp.csr_matrix:
    """True (n, n) where two of the unknowns stand in one column of ``numbers`` (nd, count); −1 is none."""
    free = numbers >= 0
    of = np.broadcast_to(np.arange(numbers.shape[1]), numbers.shape)[free]
    meets = sp.csr_matrix((np.ones(of.size, bool), (numbers[free], of)), shape=(n, numbers.shape[1]))
    return meets @ meets.T
