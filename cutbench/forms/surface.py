"""What forms of the surface share: an energy that is there as far as the cut plane is whole, or is cut.

E = c Σ f e(u): e of pieces of a surface, c from the law, f = 1, or the damage d of the cut plane, or 1 − d. d
is that of the step's start, so that within a step forces have a potential. What d changes at rest takes no
work: the energy of new faces is a part of G_c.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cutbench.forms.base import Form, Local
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP, Skin


@dataclass(frozen=True)
class Share:
    """How much of each of n pieces is there: ``whole`` and, times the damage at the point ``at`` of the cut
    plane, ``slope``."""

    whole: np.ndarray
    slope: np.ndarray
    at: np.ndarray

    @classmethod
    def all_of(cls, n: int) -> Share:
        return cls(np.ones(n), np.zeros(n), np.zeros(n, int))

    def until_cut(self, which: np.ndarray, at: np.ndarray) -> Share:
        """With ``which`` (n,) of the pieces there as far as the points ``at`` are whole."""
        slope, points = self.slope.copy(), self.at.copy()
        slope[which], points[which] = -1.0, at
        return Share(self.whole, slope, points)

    @classmethod
    def as_cut(cls, n: int) -> Share:
        """Of pieces that are points of the cut plane."""
        return cls(np.zeros(n), np.ones(n), np.arange(n))

    def rate(self, damage: np.ndarray) -> np.ndarray:
        return self.slope * damage[self.at]

    def some(self, pick: Callable[[np.ndarray], np.ndarray]) -> Share:
        return Share(pick(self.whole), pick(self.slope), pick(self.at))


class SurfaceForm(Form):
    """One law on one surface. A subclass says its ``energies`` and ``forces`` for c = 1."""

    def __init__(self, name: str, law: Skin, dofs: np.ndarray, share: Share):
        self.name, self.law, self.dofs, self.share = name, law, dofs, share

    def coefficient(self, p):
        """c, real or complex."""
        raise NotImplementedError

    def energies(self, U: np.ndarray) -> np.ndarray:
        """Of each piece (n,), at local displacements U (nd, columns)."""
        raise NotImplementedError

    def forces(self, U: np.ndarray, there: np.ndarray) -> np.ndarray:
        """Derivative (nd, columns) of Σ there · energies by U."""
        raise NotImplementedError

    def slopes(self, U: np.ndarray, there: np.ndarray) -> np.ndarray:
        """Derivative (nd, nd, columns) of ``forces`` by U, both real."""
        found = np.empty((len(U), *U.shape))
        for k in range(len(U)):
            probe = U.astype(complex)
            probe[k] += 1j * STEP
            found[:, k] = self.forces(probe, there).imag / STEP
        return found

    def idle(self, p):
        return bool(np.real(self.coefficient(p)) == 0)

    def part(self, columns):
        some = copy(self)
        some.dofs = np.ascontiguousarray(self.dofs[:, columns])
        some.share = self.share.some(lambda value: self.pick({"": value}, columns)[""])
        return some

    # -- state: how much of each piece is there in this step, and was in the one before ----------------
    def start(self, p):
        return {"there": self.share.whole, "before": self.share.whole}

    def begun(self, state: dict, damage: np.ndarray) -> dict:
        """As a step begins where the cut plane has the ``damage`` (n,)."""
        return {"there": self.share.whole + self.share.rate(damage), "before": state["there"]}

    def carried(self, other, state, p):
        joins, joined = self.share.slope != 0, other.share.slope != 0

        def at_ours(value):
            return np.where(joins, value[joined].mean() if joined.any() else 1.0, self.share.whole)

        return {name: at_ours(value) for name, value in state.items()}

    # -- evaluation --------------------------------------------------------------------------------
    def evaluate(self, u, p, state, step):
        c, U, there = self.coefficient(p), u.take(self.dofs), state["there"]
        if c == 0:
            return Local(np.zeros_like(U), None, state)
        slope = None if np.real(c) == 0 else lambda: np.real(c) * self.slopes(U, np.real(there))
        return Local(c * self.forces(U, there), slope, state)

    def stored(self, u, p, state):
        energies = self.energies(np.take(u, self.dofs))
        return {self.law.name: float(self.coefficient(p) * (state["there"] @ energies))}

    def work(self, u, p, old, new, step):
        # The mean of the forces at both ends: each has a factor of its own.
        there = (old["before"] + new["there"]) / 2
        before, after = (self.energies(np.take(v, self.dofs)) for v in (step.u_old, u))
        return {self.law.name: float(self.coefficient(p) * (there @ (after - before)))}


def edge_of(pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ridges (m, n) at the edge of a surface of the pieces (m+1, k), the corners (n,) opposite them, and the
    numbers (n,) of their pieces."""
    ridges = np.hstack([np.sort(np.delete(pieces, k, axis=0), axis=0) for k in range(len(pieces))])
    _, first, count = np.unique(ridges, axis=1, return_index=True, return_counts=True)
    alone = first[count == 1]
    return ridges[:, alone], pieces.ravel()[alone], alone % pieces.shape[1]


def edge_lines(nodes: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points, or lines with their middle, at the edge of faces with the ``nodes`` (nn, nf): (1 to 3, n), and
    the corners (n,) opposite them. ``X`` (dim, nnode) positions of all nodes."""
    ridges, opposite, face = edge_of(nodes[: X.shape[0]])
    middles = nodes[X.shape[0] :, face]
    if len(ridges) == 2 and len(middles):
        away = np.linalg.norm(X[:, middles] - X[:, ridges].mean(axis=1)[:, None], axis=0)
        ridges = np.vstack([ridges, np.take_along_axis(middles, away.argmin(axis=0)[None], axis=0)])
    return ridges, opposite


@dataclass(frozen=True)
class Rim:
    """Where the top meets the cut plane: nodes ``plus`` (n,) and, of a split block, ``minus`` opposite them.

    ``points``: those of the cut plane whose damage says whether both sides are joined there.
    """

    plus: np.ndarray
    minus: np.ndarray | None
    points: np.ndarray

    @classmethod
    def of(cls, top: Faces, cut: Faces, minus: Faces | None, X: np.ndarray) -> Rim:
        """``X`` (dim, nnode) positions of all nodes."""
        plus = np.intersect1d(top.nodes, cut.nodes)
        other = None
        if minus is not None:
            found = np.intersect1d(top.nodes, minus.nodes)
            other = found[cKDTree(X[:, found].T).query(X[:, plus].T)[1]]
        return cls(plus, other, cls.nearest(cut, X[:, plus]))

    @staticmethod
    def nearest(cut: Faces, X: np.ndarray) -> np.ndarray:
        """Numbers (n,) of the points of ``cut`` next to the places X (dim, n)."""
        return cKDTree(cut.X.reshape(X.shape[0], -1).T).query(X.T)[1]
