"""From blocks of local vectors and matrices to one right-hand side and one CSR matrix.

The pattern and the places of all local entries are found once; afterwards an assembly is one sparse
product a block. scikit-fem's own assembly drops zeros and may change the pattern between iterations,
which would cost a symbolic factorization each time.
"""

from __future__ import annotations

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

    def __init__(self, ndof: int, fixed: np.ndarray, dof_tables: dict[str, np.ndarray], symmetric: bool):
        self.ndof, self.symmetric = ndof, symmetric
        free = np.ones(ndof, bool)
        free[fixed] = False
        self.free = np.flatnonzero(free)
        self.number = np.full(ndof, -1)
        self.number[self.free] = np.arange(self.free.size)
        n = self.free.size
        entries = {}
        for name, dofs in dof_tables.items():
            nd, count = dofs.shape
            # int32 keeps the index arrays of large meshes within memory.
            rows = self.number[np.broadcast_to(dofs[:, None], (nd, nd, count))].ravel()
            cols = self.number[np.broadcast_to(dofs[None], (nd, nd, count))].ravel()
            keep = (rows >= 0) & (cols >= 0)
            if symmetric:
                keep &= rows <= cols
            where = np.flatnonzero(keep)
            entries[name] = (rows[where].astype(np.int64) * n + cols[where], where)
        diagonal = np.arange(n, dtype=np.int64) * (n + 1)
        keys = np.unique(np.concatenate([diagonal, *(key for key, _ in entries.values())]))
        self.indices = (keys % n).astype(np.int32)
        self.indptr = np.searchsorted(keys, np.arange(n + 1, dtype=np.int64) * n).astype(np.int32)
        self.diagonal = np.searchsorted(keys, diagonal)
        self.blocks = {}
        self._stacks: dict[tuple[str, ...], sp.csr_matrix] = {}
        for name, dofs in dof_tables.items():
            key, where = entries.pop(name)
            places, row = np.unique(np.searchsorted(keys, key), return_inverse=True)
            matrix = sp.csr_matrix(
                (np.ones(row.size), (row, where)), shape=(places.size, dofs.shape[0] ** 2 * dofs.shape[1])
            )
            vector = sp.csr_matrix(
                (np.ones(dofs.size), (dofs.ravel(), np.arange(dofs.size))), shape=(ndof, dofs.size)
            )
            self.blocks[name] = Block(dofs, vector, places, matrix)

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
