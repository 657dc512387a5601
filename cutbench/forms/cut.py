"""Cohesive form: ∫ T(⟦u⟧)·δ⟦u⟧ dA on the cut plane (paper, eq. weak_form_cohesive).

On a symmetry plane only one side is meshed: ⟦u⟧ = 2 u_n and half of the work belongs to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from cutbench.forms.base import Form, Local, Step, add_states, blend, component_major, gather
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP, Points, cut_answers

#: Openings at the peak of the cohesion by which the faces of a pre-cut were apart: nothing is left of it.
PARTED = 100.0


class CutForm(Form):
    """The cut laws' traction on one side (symmetric) or between two matching sides.

    ``skins`` make it vary with place; the tractions in the state are without their factor.
    """

    name = "cohesion"

    def __init__(
        self, laws, plus: Faces, height: float, minus: Faces | None = None, skins=(), closing=Points.closing
    ):
        """``plus`` is the side at x > 0; ``minus`` its partner, face by face and node by node. ``closing`` as
        in ``Points``."""
        self.laws, self.skins, self.closing = tuple(laws), tuple(skins), closing
        self._minus, self._height = minus, height
        dim = plus.X.shape[0]
        self.dim, self.faces = dim, plus
        self.share = 1.0 if minus is not None else 0.5
        opening = -plus.normal  # from the minus side to the plus side
        axes = [opening]
        if minus is not None:
            # The tangents complete a right-handed local frame.
            if dim == 2:
                axes.append(np.stack([-opening[1], opening[0]]))
            else:
                up = np.zeros_like(opening)
                up[1] = 1.0
                axes += [up, np.cross(opening.T, up.T).T]
        self._frame = np.stack(axes)  # (nc, dim, nf)
        sides = [(plus, 1.0)] if minus is None else [(plus, 1.0), (minus, -1.0)]
        nodes = np.concatenate([side.nodes for side, _ in sides])
        # On a symmetry plane the other side moves oppositely: ⟦u⟧ = 2 u_n, half the work is ours.
        self._N = np.concatenate([sign * side.N for side, sign in sides], axis=1) / self.share
        self._NN = self._N[:, :, None] * self._N[:, None]
        self.dofs = component_major(nodes, dim)
        nq, nf = plus.w.shape
        X = np.zeros((3, nq * nf))
        X[:dim] = plus.X.reshape(dim, -1)
        self._X, self._depth = X, height - X[1]

    @cached_property
    def width(self) -> float:
        """Of the cut plane, mm; 1 in two dimensions."""
        return float(self.faces.w.sum() / np.ptp(self.faces.X[1]))

    def part(self, columns):
        minus = None if self._minus is None else self._minus.some(columns)
        return CutForm(self.laws, self.faces.some(columns), self._height, minus, self.skins, self.closing)

    def start(self, p):
        n = self.faces.w.size
        state = add_states(*(law.start(n, p) for law in self.laws))
        made = self._depth < (precut := np.real(getattr(p, "precut", 0.0)))
        for law in self.laws:
            if law.role == "cohesive" and precut > 0:
                state |= {k: np.where(made, v, state[k]) for k, v in self._parted(law, n, p).items()}
        # Without a cohesive law nothing breaks.
        return {"damage": np.zeros(n), **state, "tractions": np.zeros((len(self.laws), 3, n))}

    def _parted(self, law, n: int, p) -> dict:
        """The state of a cohesive law whose faces were pulled far apart before."""
        jump = np.zeros((3, n))
        jump[0] = PARTED * np.real(law.estimate(p, 0.0, 0.0).opening)
        at = Points(X=self._X, depth=self._depth, dt=1.0, jump_old=jump, closing=self.closing)
        state = law.start(n, p)
        for _ in range(2):  # once to get there, once at rest, for means over a step
            _, state = law.traction(jump, p, state, at)
        return state

    def carried(self, other, state, p):
        return {name: self.faces.from_others(other.faces, value) for name, value in state.items()}

    def jump(self, u: np.ndarray) -> np.ndarray:
        """⟦u⟧ (3, nq·nf) in the local frame: opening, then sliding."""
        values = blend(self._N, gather(u, self.dofs, self.dim))  # (dim, nq, nf)
        out = np.zeros((3, self.faces.w.size), dtype=values.dtype)
        for c, axis in enumerate(self._frame):
            out[c] = (axis[:, None] * values).sum(axis=0).ravel()
        return out

    def points(self, step: Step) -> Points:
        jump_old = self.jump(step.u_old)
        return Points(
            X=self._X, depth=self._depth, dt=step.dt, jump_old=jump_old, held=step.damage_held,
            closing=self.closing,
        )  # fmt: skip

    def _weights(self, p, at) -> np.ndarray:
        """Quadrature weights times this side's share and the skins' factor (nq, nf)."""
        w = self.faces.w * self.share
        for skin in self.skins:
            w = w * np.broadcast_to(skin.toughness(p, at), w.size).reshape(w.shape)
        return w

    def _answers(self, jump, p, state, at) -> tuple[np.ndarray, dict]:
        """Tractions (laws, 3, nq·nf) and the new state."""
        found = cut_answers(self.laws, jump, p, state, at)
        T = np.stack([each.traction for each in found]) if found else np.zeros((0, *jump.shape))
        return T, {"damage": state["damage"], **add_states(*(each.new for each in found))}

    def _probed(self, jump, p, state, at) -> Iterator[tuple[np.ndarray, dict]]:
        """``_answers`` to a complex step of each component of the frame."""
        for c in range(self._frame.shape[0]):
            probe = jump.astype(complex)
            probe[c] += 1j * STEP
            yield self._answers(probe, p, state, at)

    def evaluate(self, u, p, state, step, tangent=True):
        jump, at = self.jump(u), self.points(step)
        T, new = self._answers(jump, p, state, at)
        new["tractions"] = T
        total = T.sum(axis=0)
        nq, nf = self.faces.w.shape
        nc = self._frame.shape[0]
        w = self._weights(p, at)
        t = np.einsum("cdf,cqf->dqf", self._frame, total[:nc].reshape(nc, nq, nf) * w)
        vector = np.einsum("qaf,dqf->daf", self._N, t)
        matrix = None
        if tangent:
            D = np.empty((nc, nc, nq, nf))
            for c, (tractions, _) in enumerate(self._probed(jump, p, state, at)):
                D[:, c] = (tractions.sum(axis=0)[:nc].imag / STEP).reshape(nc, nq, nf)
            nd = self.dofs.shape[0]
            D = (D * w).transpose(2, 0, 1, 3).reshape(nq, nc, nc, nf)
            matrix = np.einsum("qcef,qabf->ceabf", D, self._NN)
            matrix = np.einsum("cdf,ceabf,ekf->dakbf", self._frame, matrix, self._frame)
            matrix = matrix.reshape(nd, nd, nf)
        return Local(vector.reshape(self.dofs.shape[0], -1), matrix, new)

    def cut_area(self, state) -> np.ndarray:
        """Of each point (n,) what has lost its cohesion, mm or mm²: from half damage on, in proportion,
        (2d − 1)₊, so that it grows smoothly."""
        return self.faces.w.ravel() * np.clip(2 * np.real(state["damage"]) - 1, 0, 1)

    def broken(self, u, p, state, step, local: bool = True) -> tuple[float, np.ndarray]:
        """Length or area of the cut, ∫ g(d) dA, and its derivative by the local displacements (nd, nf).

        ``local``: g = d³(10 − 15 d + 6 d²) counts where the cut is made, neither the whole plane ahead, which
        has some damage, nor faces that are open already; else g = d. Damage never heals, so both grow along
        every path of equilibria, whichever way the blade goes.
        """
        jump, at = self.jump(u), self.points(step)
        w, d = self.faces.w, np.real(self._answers(jump, p, state, at)[1]["damage"])
        g = d**3 * (10 - 15 * d + 6 * d**2) if local else d
        by_damage = 30 * (d * (1 - d)) ** 2 if local else 1.0
        by_jump = [np.imag(new["damage"]) / STEP for _, new in self._probed(jump, p, state, at)]
        slope = np.stack([(by_damage * each).reshape(w.shape) * w for each in by_jump])
        along = np.einsum("cdf,cqf->dqf", self._frame, slope)
        return float(w.ravel() @ g), np.einsum("qaf,dqf->daf", self._N, along).reshape(self.dofs.shape)

    def stored(self, u, p, state):
        jump, at = self.jump(u), Points(X=self._X, depth=self._depth, held=True, closing=self.closing)
        w = self._weights(p, at).ravel()
        taken = (law.work(jump, p, state, at) for law in self.laws)
        return sum(float(w @ density) for density in taken if density is not None)

    def work(self, u, p, old, new, step):
        jump, at = self.jump(u), self.points(step)
        w = self._weights(p, at).ravel()
        out = {}
        for i, law in enumerate(self.laws):
            after = law.work(jump, p, new, at)
            if after is None:
                mean = (old["tractions"][i] + new["tractions"][i]) / 2
                density = (mean * (jump - at.jump_old)).sum(axis=0)
            else:
                density = after - law.work(at.jump_old, p, old, at)
            out[law.name] = float(w @ density)
        return out
