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
from cutbench.forms.base import Form, Local
from cutbench.forms.line import Pairs, crossings, near, room
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
        self._X, self._laws, self._tuning = X, tuple(laws), tuning
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
    def _moved(self, line: _Line, u: np.ndarray) -> np.ndarray:
        return self._X[:, line.nodes] + u[2 * line.nodes + np.arange(2)[:, None]]

    def crosses(self, u: np.ndarray) -> bool:
        """Whether a line passes through itself."""
        return any(crossings(self._moved(line, u)).size for line in self._lines)

    def room(self, u: np.ndarray, du: np.ndarray) -> float:
        """The part of ``du`` that ends safely before lines touch; infinite where none do."""
        parts = (room(self._moved(line, u), self._moved(line, u + du)) for line in self._lines)
        return self._tuning.room * min(parts, default=np.inf)

    def places(self, u: np.ndarray) -> np.ndarray:
        """Where (2, n) in the undeformed body the surface meets itself at ``u``."""
        found = [np.zeros((2, 0))]
        for line in self._lines:
            met = line.meeting(self._moved(line, u))
            i, e = met.point, met.segment
            found.append(self._X[:, line.nodes[np.unique(np.concatenate([i, e, e + 1]))]])
        return np.hstack(found)

    def learn(self, u: np.ndarray) -> bool:
        """Whether ``couples`` had to grow for what meets at ``u``."""
        grown = False
        for k, line in enumerate(self._lines):
            x = self._moved(line, u)
            if np.isin(line.meeting(x).codes, self._known[k], assume_unique=True).all():
                continue
            # A new pattern costs as much as two tangents.
            pairs = line.pairs(x, self._tuning.ahead)
            self._known[k] = np.union1d(self._known[k], pairs[0] * line.nodes.size + pairs[1])
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
        for line, known in zip(self._lines, self._known, strict=True):
            met, block = line.meeting(self._moved(line, u)), np.zeros((6, 6, known.size))
            force = np.zeros((line.nodes.size, 2), dtype=met.r.dtype)
            forces.append(force.reshape(-1))
            blocks.append(block)
            if met.point.size == 0:
                continue
            _, slope, curvature = met.derivatives(tangent)
            at = np.stack([met.point, met.segment, met.segment + 1])
            np.add.at(force, at, slope.reshape(3, 2, -1).transpose(0, 2, 1))
            if tangent:
                here = np.isin(met.codes, known, assume_unique=True)
                block[..., np.searchsorted(known, met.codes[here])] = curvature[..., here]
        matrix = None
        if tangent and self.couples.size:
            matrix = np.real(kappa) * np.concatenate(blocks, axis=2)
        return Local(kappa * np.concatenate(forces)[:, None], matrix, {})

    def stored(self, u, p, state):
        """Stored energy in mJ per mm of length."""
        met = [line.meeting(self._moved(line, u)) for line in self._lines]
        stored = sum(each.derivatives(False)[0].sum() for each in met if each.point.size)
        return float(np.real(self.stiffness(p)) * stored)

    def work(self, u, p, old, new, step):
        return {self.name: self.stored(u, p, new) - self.stored(step.u_old, p, old)}


@dataclass(frozen=True)
class _Line:
    """``nodes`` (n,) in their order, the ``length`` that each stands for, and its d̂, ``reach``, in mm."""

    nodes: np.ndarray
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
        return cls(nodes, length, reach)

    def pairs(self, x: np.ndarray, times: float = 1.0) -> Pairs:
        """Points and segments (2, k), none of them with itself, that may be nearer than so many d̂."""
        x = np.real(x)
        i, e = near(x, x, times * self.reach)
        apart = (i != e) & (i != e + 1)
        return np.stack([i[apart], e[apart]])

    def meeting(self, x: np.ndarray) -> _Met:
        """What is nearer than d̂, of the line through x (2, n)."""
        # Energy, forces and tangent are asked for one after the other.
        if self._last and np.array_equal(self._last[0], x):
            return self._last[1]
        self._last[:] = x, self._met(x)
        return self._last[1]

    def _met(self, x: np.ndarray) -> _Met:
        i, e = self.pairs(x)
        p, a, b = x[:, i], x[:, e], x[:, e + 1]
        r, long = p - a, b - a
        along = np.real((r * long).sum(axis=0)) / np.maximum(np.real((long * long).sum(axis=0)), 1e-300)
        foot = r - np.clip(along, 0, 1) * long
        close = np.real((foot * foot).sum(axis=0)) < self.reach[i] ** 2
        order = np.flatnonzero(close)
        order = order[np.argsort(i[order] * self.nodes.size + e[order], kind="stable")]
        i, e = i[order], e[order]
        # A corner between two segments that both count: not beside the point itself, nor at the line's end.
        corner = (e > 0) & (np.abs(i - e) > 1)
        return _Met(
            i, e, i * self.nodes.size + e, r[:, order], long[:, order], along[order], corner,
            self.length[i] / 2, self.reach[i],
        )  # fmt: skip


@dataclass(frozen=True)
class _Met:
    """Pairs of a ``point`` and a ``segment`` within d̂, ``reach``, of one another, in the order of their
    ``codes``.

    ``r`` from the segment's first point, ``long`` the segment, ``along`` it the foot; ``corner``: whether
    its first point is one that counts once less.
    """

    point: np.ndarray
    segment: np.ndarray
    codes: np.ndarray
    r: np.ndarray
    long: np.ndarray
    along: np.ndarray
    corner: np.ndarray
    weight: np.ndarray
    reach: np.ndarray

    def derivatives(self, tangent: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy (n,) for κ = 1, its derivatives (6, n) by the point and the segment's ends, and second ones
        (6, 6, n), empty without ``tangent``."""
        from_line = _from_line(self.r, self.long, tangent)
        for end, clipped in ((1, self.along <= 0), (2, self.along >= 1)):
            r = self.r if end == 1 else self.r - self.long
            for mine, other in zip(from_line, _from_point(r, end, tangent), strict=True):
                np.copyto(mine, other, where=clipped[: mine.shape[-1]])
        whole = self._barrier(*from_line)
        corner = self._barrier(*_from_point(self.r, 1, tangent))
        value, slope, curvature = (
            a - self.corner[: a.shape[-1]] * b for a, b in zip(whole, corner, strict=True)
        )
        return value, slope, curvature

    def _barrier(self, q, slope, curvature):
        """w d̂ b(√q/d̂), from the squared distance q and its derivatives."""
        d, inside = self.reach, np.real(q) < self.reach**2
        s = np.sqrt(np.where(inside, q, d**2)) / d
        log = np.log(s)
        first = -2 * (s - 1) * log - (s - 1) ** 2 / s
        by_q = self.weight * first / (2 * s * d)
        if curvature.shape[-1]:
            second = -2 * log - 4 * (s - 1) / s + (s - 1) ** 2 / s**2
            by_qq = self.weight * (second / s**2 - first / s**3) / (4 * d**3)
            curvature = by_q * curvature + np.where(inside, by_qq, 0.0) * slope[:, None] * slope[None]
        return -self.weight * d * (s - 1) ** 2 * log, by_q * slope, curvature


#: ∂/∂(point, first, last) of r = point − first and of the segment, last − first, as signs.
_R, _LONG = np.array([1.0, -1.0, 0.0]), np.array([0.0, -1.0, 1.0])
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


def _from_line(r, long, tangent):
    """Squared distance c²/l from the line through a segment, c = long × r, l = long², and derivatives."""
    c, l = long[0] * r[1] - long[1] * r[0], (long * long).sum(axis=0)
    dc = np.concatenate([_R[k] * -(_TURN @ long) + _LONG[k] * (_TURN @ r) for k in range(3)])
    dl = np.concatenate([2 * _LONG[k] * long for k in range(3)])
    q = c * c / l
    slope = 2 * c / l * dc - q / l * dl
    if not tangent:
        return q, slope, np.zeros((6, 6, 0))
    # c = longᵀ T r.
    ddc = np.kron(np.outer(_LONG, _R), _TURN)
    ddc = (ddc + ddc.T)[..., None]
    ddl = 2 * np.kron(np.outer(_LONG, _LONG), np.eye(2))[..., None]
    mixed = dc[:, None] * dl[None]
    curvature = (
        2 / l * dc[:, None] * dc[None]
        + 2 * c / l * ddc
        - 2 * c / l**2 * (mixed + mixed.transpose(1, 0, 2))
        + 2 * q / l**2 * dl[:, None] * dl[None]
        - q / l * ddl
    )
    return q, slope, curvature


def _from_point(r, end, tangent):
    """Squared distance from an ``end`` of the segment, 1 or 2, and derivatives."""
    signs = np.zeros(3)
    signs[0], signs[end] = 1.0, -1.0
    slope = np.concatenate([2 * sign * r for sign in signs])
    ddq = 2 * np.kron(np.outer(signs, signs), np.eye(2))[..., None]
    curvature = np.repeat(ddq, r.shape[1], axis=2) if tangent else np.zeros((6, 6, 0))
    return (r * r).sum(axis=0), slope, curvature
