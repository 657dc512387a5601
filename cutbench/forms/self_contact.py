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

import numpy as np

from cutbench.case.tuning import SelfContactTuning
from cutbench.forms.barrier import barrier, plain_barrier
from cutbench.forms.base import Form, Local, same
from cutbench.forms.surface_lines import crossings, meeting, near, room
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
        """``X`` (dim, nnode): positions of all nodes, which move in as many directions."""
        self._laws, self._tuning = tuple(laws), tuning
        self.reads = tuple(n for law in laws for n in (*law.reads, *(q.name for q in law.parameters)))
        self._dim = len(X)
        self._lines = [_Line.of(nodes, X[:, nodes], thickness, tuning) for nodes in lines]
        self._numbers = np.concatenate([line.nodes for line in self._lines])
        # Forces come as one column: any points may meet.
        self.dofs = (self._dim * self._numbers[:, None] + np.arange(2)).reshape(-1, 1)
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
            at, known = np.searchsorted(self._known[k], met), np.append(self._known[k], -1)
            if (known[at] == met).all():
                continue
            self._known[k] = np.union1d(self._known[k], line.pairs(x, self._tuning.ahead))
            grown = True
        if grown:
            tables = []
            for line, codes in zip(self._lines, self._known, strict=True):
                i, e = np.divmod(codes, line.nodes.size)
                nodes = line.nodes[np.stack([i, e, e + 1])]
                tables.append((self._dim * nodes[:, None] + np.arange(2)[:, None]).reshape(6, -1))
            self.couples = np.hstack(tables)
        return grown

    # -- energy, forces, tangent ------------------------------------------------------------------
    def stiffness(self, p):
        """κ in MPa."""
        return self._tuning.stiffness * sum(law.shear_modulus(p) for law in self._laws)

    def evaluate(self, u, p, state, step):
        moved = [line.moved(u) for line in self._lines]
        if not any(line.meeting(x).size for line, x in zip(self._lines, moved, strict=True)):
            return Local(np.zeros(self.dofs.shape, moved[0].dtype), None, {})
        none = np.zeros(0, int)
        found = [line.barrier(x, none, False)[1].ravel() for line, x in zip(self._lines, moved, strict=True)]
        return Local(self.stiffness(p) * np.concatenate(found)[:, None], lambda: self._slopes(u, p), {})

    def _slopes(self, u, p) -> np.ndarray | None:
        """Tangents (6, 6, n) of the ``couples``."""
        if not self.couples.size:
            return None
        known = zip(self._lines, self._known, strict=True)
        blocks = [line.barrier(line.moved(u), pairs, True)[2] for line, pairs in known]
        return np.real(self.stiffness(p)) * np.concatenate(blocks, axis=2)

    def stored(self, u, p, state):
        none = np.zeros(0, int)
        stored = sum(line.barrier(np.real(line.moved(u)), none, False)[0] for line in self._lines)
        return {self.name: float(np.real(self.stiffness(p)) * stored)}

    def work(self, u, p, old, new, step):
        before, after = self.stored(step.u_old, p, old), self.stored(u, p, new)
        return {self.name: after[self.name] - before[self.name]}


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
        apart = np.hypot(*np.diff(X[:2], axis=1))
        before, after = np.append(apart[:1], apart), np.append(apart, apart[-1:])
        length = (before + after) / 2
        length[[0, -1]] /= 2
        reach = np.minimum(tuning.part * np.minimum(before, after), tuning.reach * thickness)
        places = len(X) * nodes + np.arange(2)[:, None]
        return cls(nodes, np.ascontiguousarray(X[:2]), places, length, reach)

    def moved(self, u: np.ndarray) -> np.ndarray:
        return self.X + u.take(self.places)

    def pairs(self, x: np.ndarray, times: float) -> np.ndarray:
        """Codes of points and segments, none of them with itself, that may be nearer than so many d̂."""
        i, e = near(x, x, times * self.reach, 0)
        return (i * self.nodes.size + e)[(i != e) & (i != e + 1)]

    def meeting(self, x: np.ndarray) -> np.ndarray:
        """Codes of what is nearer than d̂, of the line through x (2, n)."""
        # Energy, forces and tangent are asked for one after the other.
        x = np.ascontiguousarray(np.real(x))
        if not (self._last and same(self._last[0].ravel(), x.ravel())):
            self._last[:] = x, np.sort(meeting(x, self.reach))
        return self._last[1]

    def barrier(
        self, x: np.ndarray, known: np.ndarray, tangent: bool
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy, forces (n, 2) and tangents (6, 6, k) of the pairs ``known``, for κ = 1."""
        by = plain_barrier if np.iscomplexobj(x) else barrier
        return by(x, self.meeting(x), self.length, self.reach, known, tangent)
