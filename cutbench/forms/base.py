"""What a form is: local residuals, tangents, new states and energies of one slot on one set of points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from cutbench.base.compiled import compiled
from cutbench.base.threads import shared_out


@dataclass
class Step:
    """One time step, as forms see it.

    ``u_old`` (ndof,) converged displacements at its start; ``centre``/``centre_old`` (3,) the
    blade's apex in mm; ``dt`` in s; ``damping_factor``: how many times its value the damping's viscosity
    is. ``damage_held``: the cut's damage stays what its state says. ``ratio``: its length over the last
    one's, where what that did goes on, else 0. ``rests``: the blade does, and what the last step did is kept
    for the next.
    """

    dt: float
    u_old: np.ndarray
    centre: np.ndarray
    centre_old: np.ndarray
    damping_factor: float = 1.0
    damage_held: bool = False
    ratio: float = 0.0
    rests: bool = False

    @property
    def ahead(self) -> float:
        """By how much of its change since the last step a rate's mean over the step goes on to its end. That
        of displacements is then the one of BDF2."""
        return self.ratio / (1 + self.ratio)

    def foreseen(self, now, before):
        """What is ``now``, at the step's start, and was ``before`` the last one: at its end."""
        return now + self.ratio * (now - before)


#: What a state is looked at with that no step begins from.
AT_REST = Step(1.0, np.zeros(0), np.zeros(3), np.zeros(3))


@lru_cache
def upper(dim: int, nn: int) -> tuple[np.ndarray, np.ndarray]:
    """Local rows and columns of what ``Packed`` keeps of matrices on ``nn`` nodes: for components i ≤ k of
    both all pairs of nodes a, b, but for i = k those with a ≤ b."""
    some, every = np.triu_indices(nn), np.indices((nn, nn)).reshape(2, -1)
    blocks = [(i, k, some if i == k else every) for i in range(dim) for k in range(i, dim)]
    rows, columns = zip(*((i * nn + a, k * nn + b) for i, k, (a, b) in blocks), strict=True)
    return np.concatenate(rows), np.concatenate(columns)


@dataclass(frozen=True)
class Packed:
    """Symmetric local matrices of ``dim`` components on ``nn`` nodes by their ``entries`` (m, n) at
    ``upper(dim, nn)``."""

    dim: int
    nn: int
    entries: np.ndarray

    def whole(self) -> np.ndarray:
        """All of them (nd, nd, n)."""
        (rows, columns), nd = upper(self.dim, self.nn), self.dim * self.nn
        out = np.empty((nd, nd, self.entries.shape[1]))
        out[rows, columns] = out[columns, rows] = self.entries
        return out


@dataclass
class Local:
    """What a form returns: local vectors (nd, n); its tangent, local matrices (nd, nd, n) or None; and the
    new state. Of the last two what finds them will do: of most evaluations they are not asked for."""

    vector: np.ndarray
    slope: np.ndarray | Packed | Callable[[], np.ndarray | Packed | None] | None
    found: dict[str, Any] | Callable[[], dict[str, Any]] = field(default_factory=dict)

    @cached_property
    def tangent(self) -> np.ndarray | Packed | None:
        return self.slope() if callable(self.slope) else self.slope

    @property
    def matrix(self) -> np.ndarray | None:
        """The tangent as whole matrices."""
        return self.tangent.whole() if isinstance(self.tangent, Packed) else self.tangent

    @cached_property
    def state(self) -> dict[str, Any]:
        return self.found() if callable(self.found) else self.found


class Form:
    """Base of the forms. ``dofs`` (nd, n) numbers, component-major: local index = i·nn + a."""

    name: str
    dofs: np.ndarray
    #: False where the local matrix is not symmetric for the laws in use.
    symmetric: bool = True

    def start(self, p) -> dict[str, Any]:
        """The virgin state."""
        return {}

    def idle(self, p) -> bool:
        """Whether it is switched off at ``p``: it has no matrix then, and couples no unknowns."""
        return False

    def evaluate(self, u: np.ndarray, p, state: dict, step: Step) -> Local:
        """Residual contribution at displacements u; nothing is stored."""
        raise NotImplementedError

    def part(self, columns: np.ndarray) -> Form | None:
        """The same on some of its elements or faces, in rising order; None where it is not to be had."""
        return None

    def pick(self, state: dict, columns: np.ndarray) -> dict[str, Any]:
        """What ``part(columns)`` has of a state, whose arrays end with columns, or points of all columns."""
        n = self.dofs.shape[1]

        def picked(value):
            if np.ndim(value) == 0:
                return value
            if value.shape[-1] == n:
                return value[..., columns]
            some = value.reshape(*value.shape[:-1], -1, n)[..., columns]
            return some.reshape(*value.shape[:-1], -1)

        return {name: picked(value) for name, value in state.items()}

    def carried(self, other: Form, state: dict, p) -> dict[str, Any]:
        """The state that ``other``, the same form on another mesh of the same block, has, at our points. The
        virgin one where that is no matter.
        """
        return self.start(p)

    def stored(self, u, p, state: dict) -> dict[str, float]:
        """Of the work taken up by each mechanism what is a function of displacements and state."""
        return {}

    def work(self, u, p, old: dict, new: dict, step: Step) -> dict[str, float]:
        """Work taken up by each mechanism over the step, in mJ per mm of length (2D) or mJ (3D)."""
        return {}


def component_major(nodes: np.ndarray, dim: int) -> np.ndarray:
    """Numbers of the degrees of freedom (dim·nn, n) for nodes (nn, n); global number = node·dim + i."""
    return (nodes[None] * dim + np.arange(dim)[:, None, None]).reshape(dim * nodes.shape[0], -1)


def gather(u: np.ndarray, places: np.ndarray, dim: int) -> np.ndarray:
    """Values (dim, nn, n) at the nodes of each element or face, from its numbers by ``component_major``."""
    return u.take(places).reshape(dim, len(places) // dim, -1)


def _plain_blend(N: np.ndarray, values: np.ndarray) -> np.ndarray:
    out = N[None, :, 0] * values[:, None, 0]
    for a in range(1, N.shape[1]):
        out += N[None, :, a] * values[:, None, a]
    return out


@compiled(_plain_blend)
def blend(N, values):
    """Σ_a N_a values_a: (q, nn, f) and (dim, nn, f) to (dim, q, f)."""
    (nq, nn, nf), dim = N.shape, len(values)
    out = np.zeros((dim, nq, nf), values.dtype)
    for i in range(dim):
        for q in range(nq):
            for a in range(nn):
                for f in range(nf):
                    out[i, q, f] += N[q, a, f] * values[i, a, f]
    return out


@compiled(np.array_equal)
def same(one, other):
    """Whether two vectors are equal."""
    k, n = 0, min(one.size, other.size)
    while k < n and one[k] == other[k]:
        k += 1
    return k == one.size == other.size


def spread(matrices: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Local ``matrices`` (nn, nn, n) times each component of local vectors (c·nn, n), real or complex."""
    out = np.zeros_like(local)
    work = partial(_plain_spread if local.dtype.kind == "c" else _spread, matrices, local, out)
    shared_out(work, local.shape[1], matrices.size)
    return out


def _plain_spread(matrices, local, out, begin, end):
    parts = local.reshape(-1, *matrices.shape[1:])[..., begin:end]
    added = np.einsum("abe,ibe->iae", matrices[..., begin:end], parts)
    out[:, begin:end] = added.reshape(len(local), -1)


@compiled(_plain_spread)
def _spread(matrices, local, out, begin, end):
    nn = len(matrices)
    for i in range(0, len(local), nn):
        for a in range(nn):
            for b in range(nn):
                for e in range(begin, end):
                    out[i + a, e] += matrices[a, b, e] * local[i + b, e]


def add_states(*parts: dict) -> dict:
    """One dict out of several; a clash of names is a mistake in a law."""
    out: dict = {}
    for part in parts:
        clash = out.keys() & part.keys()
        if clash:
            raise ValueError(f"two laws keep a state called {sorted(clash)}")
        out.update(part)
    return out
