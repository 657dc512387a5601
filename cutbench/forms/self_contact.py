"""Self-contact of a section's surface: a barrier between parts of a line that are no neighbours,
½ Σ_i w_i κ d̂_i Σ_e b(d_ie/d̂_i), with b(s) = −(s − 1)² ln s below s = 1, else 0.

Point i stands for the length w_i of its line, d_ie is its distance from segment e, and κ a multiple of the
shear modulus. A point beside a corner meets both of its segments, and once less the corner itself: the sum is
smooth, and goes on to an integral as segments get shorter (incremental potential contact: Li et al., ACM
Trans. Graph. 39, 2020; Li et al., Convergent IPC, arXiv 2307.15908). It grows without bound before anything
touches: with steps that end before that, nothing passes through itself. There is no friction in it.

No list of who meets whom is kept, each evaluation looks. The tangent's pattern alone knows pairs, and grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cutbench.case.tuning import SelfContactTuning
from cutbench.forms.barrier import barrier, plain_barrier
from cutbench.forms.base import Form, Local
from cutbench.forms.line import crossings, meeting, near, room
from cutbench.mechanisms.base import Bulk


class SelfContactForm(Form):
    """On ``lines`` of nodes, each with itself. ``laws`` give the modulus; ``thickness`` of the blade."""

    name = "self_contact"

    def __init__(
        self,
        lines: Sequence[np.ndarray],
        X: np.ndarray,
        laws: Sequence[Bulk],
        thickness: float,
        tuning: SelfContactTuning,
    ):
        """``X`` (2, nnode): positions of all nodes."""
        self._laws, self._tuning = tuple(laws), tuning
        self.reads = tuple(n for law in laws for n in (*law.reads, *(q.name for q in law.parameters)))
        self._lines = [_Line.of(nodes, X[:, nodes], thickness, tuning) for nodes in lines]
        self._numbers = np.concatenate([line.nodes for line in self._lines])
        # Forces come as one column: any points may meet.
        self.dofs = (2 * self._numbers[:, None] + np.arange(2)).reshape(-1, 1)
        self._known = [np.zeros(0, int) for _ in self._lines]
        #: Unknowns (6, n) that the tangent's pattern joins.
        self.couples = np.zeros((6, 0), int)

    def part(self, columns):
        # Points that are held are in the way of others.
        some = copy(self)
        some._known = [*self._known]
        return some

    def idle(self, p):
        return not self.couples.size

    # -- where lines are --------------------------------------------------------------------------
    def crosses(self, u: np.ndarray) -> bool:
        """Whether a line passes through itself."""
        return any(crossings(line.moved(u)).size for line in self._lines)

    def room(self, u: np.ndarray, du: np.ndarray) -> float:
        """The part of ``du`` that ends safely before lines touch; infinite where none do."""
        parts = (room(line.moved(u), line.moved(u + du)) for line in self._lines)
        return self._tuning.room * min(parts, default=np.inf)

    def places(self, u: np.ndarray) -> np.ndarray:
        """Where (2, n) in the undeformed body the surface meets itself at ``u``."""
        found = [np.zeros((2, 0))]
        for line in self._lines:
            i, e = np.divmod(line.meeting(line.moved(u)), line.nodes.size)
            found.append(line.X[:, np.unique(np.concatenate([i, e, e + 1]))])
        return np.hstack(found)

    def learn(self, u: np.ndarray) -> bool:
        """Whether ``couples`` had to grow for what meets at ``u``."""
        grown = False
        for k, line in enumerate(self._lines):
            x = line.moved(u)
            met = line.meeting(x)
            if met.size == 0 or np.isin(met, self._known[k], assume_unique=True).all():
                continue
            self._known[k] = np.union1d(self._known[k], line.pairs(x, self._tuning.ahead))
            grown = True
        if grown:
            tables = []
            for line, codes in zip(self._lines, self._known, strict=True):
                i, e = np.divmod(codes, line.nodes.size)
                nodes = line.nodes[np.stack([i, e, e + 1])]
                tables.append((2 * nodes[:, None] + np.arange(2)[:, None]).reshape(6, -1))
            self.couples = np.hstack(tables)
        return grown

    # -- energy, forces, tangent ------------------------------------------------------------------
    def stiffness(self, p):
        """κ in MPa."""
        return self._tuning.stiffness * sum(law.shear_modulus(p) for law in self._laws)

    def evaluate(self, u, p, state, step, tangent=True):
        kappa, forces, blocks = self.stiffness(p), [], []
        tangent = tangent and self.couples.size > 0
        for line, known in zip(self._lines, self._known, strict=True):
            x = line.moved(u)
            force = np.zeros((line.nodes.size, 2), dtype=x.dtype)
            block = np.zeros((6, 6, known.size if tangent else 0))
            forces.append(force.reshape(-1))
            blocks.append(block)
            if line.meeting(x).size == 0:
                continue
            met = line.barrier(x, tangent)
            np.add.at(force, met.points, met.slope.reshape(3, 2, -1).transpose(0, 2, 1))
            if tangent:
                here = np.isin(met.codes, known, assume_unique=True)
                block[..., np.searchsorted(known, met.codes[here])] = met.curvature[..., here]
        matrix = np.real(kappa) * np.concatenate(blocks, axis=2) if tangent else None
        return Local(kappa * np.concatenate(forces)[:, None], matrix, {})

    def stored(self, u, p, state):
        """Stored energy in mJ per mm of length."""
        stored = sum(line.barrier(np.real(line.moved(u)), False).energy.sum() for line in self._lines)
        return float(np.real(self.stiffness(p)) * stored)

    def work(self, u, p, old, new, step):
        return {self.name: self.stored(u, p, new) - self.stored(step.u_old, p, old)}


@dataclass(frozen=True)
class _Line:
    """``nodes`` (n,) in their order, their positions ``X`` and ``places`` among the unknowns (2, n), the
    ``length`` that each stands for, and its d̂, ``reach``, in mm."""

    nodes: np.ndarray
    X: np.ndarray
    places: np.ndarray
    length: np.ndarray
    reach: np.ndarray
    _last: list = field(default_factory=list, repr=False)

    @classmethod
    def of(cls, nodes: np.ndarray, X: np.ndarray, thickness: float, tuning: SelfContactTuning) -> _Line:
        apart = np.hypot(*np.diff(X, axis=1))
        before, after = np.append(apart[:1], apart), np.append(apart, apart[-1:])
        length = (before + after) / 2
        length[[0, -1]] /= 2
        reach = np.minimum(tuning.part * np.minimum(before, after), tuning.reach * thickness)
        places = 2 * nodes + np.arange(2)[:, None]
        return cls(nodes, np.ascontiguousarray(X), places, length, reach)

    def moved(self, u: np.ndarray) -> np.ndarray:
        return self.X + np.take(u, self.places)

    def pairs(self, x: np.ndarray, times: float) -> np.ndarray:
        """Codes of points and segments, none of them with itself, that may be nearer than so many d̂."""
        i, e = near(x, x, times * self.reach, True)
        return (i * self.nodes.size + e)[(i != e) & (i != e + 1)]

    def meeting(self, x: np.ndarray) -> np.ndarray:
        """Codes of what is nearer than d̂, of the line through x (2, n)."""
        # Energy, forces and tangent are asked for one after the other.
        x = np.real(x)
        if not (self._last and np.array_equal(self._last[0], x)):
            self._last[:] = x, meeting(np.ascontiguousarray(x), self.reach)
        return self._last[1]

    def barrier(self, x: np.ndarray, tangent: bool) -> Barrier:
        """Of what is nearer than d̂, for κ = 1."""
        codes = self.meeting(x)
        i, e = np.divmod(codes, self.nodes.size)
        # A corner between two segments that both count: not beside the point itself, nor at the line's end.
        corner = (e > 0) & (np.abs(i - e) > 1)
        by = plain_barrier if np.iscomplexobj(x) else barrier
        first = x[:, e]
        found = by(x[:, i] - first, x[:, e + 1] - first, corner, self.length[i] / 2, self.reach[i], tangent)
        return Barrier(codes, np.stack([i, e, e + 1]), *found)


class Barrier(NamedTuple):
    """Pairs by their ``codes``, rising: the ``points`` (3, n) of each, energy (n,), derivatives (6, n) and
    second ones (6, 6, n)."""

    codes: np.ndarray
    points: np.ndarray
    energy: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray
