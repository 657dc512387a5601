"""Cohesive form: ∫ T(⟦u⟧)·δ⟦u⟧ dA on the cut plane (paper, eq. weak_form_cohesive).

On a symmetry plane only one side is meshed: ⟦u⟧ = 2 u_n and half of the work belongs to it.
"""

from __future__ import annotations

import numpy as np

from cutbench.base.compiled import compiled
from cutbench.base.fused import fused
from cutbench.forms.base import Form, Local, Step, add_states, blend, component_major, gather
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP, Points, cut_answers

#: Openings at the peak of the cohesion by which the faces of a pre-cut were apart: nothing is left of it.
PARTED = 100.0
#: Part of a fading rate term's traction at a step's end that follows from what is left of the term there and
#: the rate, the rest from its means over two steps. Each is of second order. Where steps are not short beside
#: the front, one lets the force fall too low, one holds it too high: gelatin's steady force, with short steps
#: 0.963 N, is 0.776 and 1.077 N with a ``damage_step`` of 0.7, and 0.970 N with both.
FADING = 1 / 3


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
        self._frame = np.ascontiguousarray(np.stack(axes))  # (nc, dim, nf)
        sides = [(plus, 1.0)] if minus is None else [(plus, 1.0), (minus, -1.0)]
        nodes = np.concatenate([side.nodes for side, _ in sides])
        # On a symmetry plane the other side moves oppositely: ⟦u⟧ = 2 u_n, half the work is ours.
        N = np.concatenate([sign * side.N for side, sign in sides], axis=1) / self.share
        self._N, self._w = np.ascontiguousarray(N), np.ascontiguousarray(plus.w * self.share)
        self.dofs = np.ascontiguousarray(component_major(nodes, dim))
        nq, nf = plus.w.shape
        X = np.zeros((3, nq * nf))
        X[:dim] = plus.X.reshape(dim, -1)
        self._X, self._depth = X, height - X[1]
        self._answers_of, self._traction_of = fused(answers), fused(traction)
        self._began: tuple = (None, None)
        self._weighed: tuple = (None, None)

    def part(self, columns):
        minus = None if self._minus is None else self._minus.some(columns)
        return CutForm(self.laws, self.faces.some(columns), self._height, minus, self.skins, self.closing)

    def with_laws(self, laws, skins) -> CutForm:
        """Others on the same faces."""
        return CutForm(laws, self.faces, self._height, self._minus, skins, self.closing)

    def start(self, p):
        n = self.faces.w.size
        state = add_states(*(law.start(n, p) for law in self.laws))
        made = self._depth < (precut := np.real(getattr(p, "precut", 0.0)))
        for law in self.laws:
            if law.role == "cohesive" and precut > 0:
                state |= {k: np.where(made, v, state[k]) for k, v in self._parted(law, n, p).items()}
        # Without a cohesive law nothing breaks.
        none = np.zeros((len(self.laws), 3, n))
        return {"damage": np.zeros(n), **state, "tractions": none, "means": none, "rate": np.zeros((3, n))}

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
        return _jumps(u, self.dofs, self._N, self._frame)

    def points(self, step: Step) -> Points:
        if self._began[0] is not step.u_old:
            self._began = step.u_old, self.jump(step.u_old)
        return Points(
            X=self._X, depth=self._depth, dt=step.dt, jump_old=self._began[1], held=step.damage_held,
            closing=self.closing,
        )  # fmt: skip

    def _weights(self, p, at) -> np.ndarray:
        """Quadrature weights times this side's share and the skins' factor (nq, nf)."""
        if self._weighed[0] is not p:  # parameters are never changed in place
            w = self._w
            for skin in self.skins:
                w = w * np.broadcast_to(skin.toughness(p, at), w.size).reshape(w.shape)
            self._weighed = p, w
        return self._weighed[1]

    def _answers(self, components: int, jump, p, state, at, step):
        given = self.laws, components, jump, p, state, at, *_ends(step)
        T, new, D, by_jump = self._answers_of(*given)
        kept = {name: state[name] for name in ("means", "rate")} if step.rests else {}
        return T, {**new, **kept, "tractions": T}, D, by_jump

    def evaluate(self, u, p, state, step):
        jump, at = self.jump(u), self.points(step)
        w = self._weights(p, at)
        total = self._traction_of(self.laws, jump, p, state, at, *_ends(step))
        vector, _ = self._forces(total, np.zeros((0, 0, 0), total.dtype), w)

        def slopes() -> np.ndarray:
            D = self._answers(self._frame.shape[0], jump, p, state, at, step)[2]
            return self._forces(total, D, w)[1]

        return Local(vector, slopes, lambda: self._answers(0, jump, p, state, at, step)[1])

    def ended(self, u, p, state, step: Step) -> dict:
        """The state alone of what ``evaluate`` answers."""
        return self._answers(0, self.jump(u), p, state, self.points(step), step)[1]

    def _forces(self, T: np.ndarray, D: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodal forces of tractions T (3, N), and their derivative from D (nc, nc, N), or empty."""
        nd, nf = self.dofs.shape
        size = (nd, nd, nf if D.size else 0)
        room = np.zeros((nd, nf), np.result_type(T, w)), np.zeros(size, np.result_type(D, w))
        return _projected(T, D, self._N, self._frame, w, *room)

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
        _, new, _, by_jump = self._answers(self._frame.shape[0], jump, p, state, at, step)
        w, d = self.faces.w, np.real(new["damage"])
        g = d**3 * (10 - 15 * d + 6 * d**2) if local else d
        by_damage = 30 * (d * (1 - d)) ** 2 if local else 1.0
        slope = (by_damage * by_jump).reshape(-1, *w.shape) * w
        along = np.einsum("cdf,cqf->dqf", self._frame, slope)
        return float(w.ravel() @ g), np.einsum("qaf,dqf->daf", self._N, along).reshape(self.dofs.shape)

    def stored(self, u, p, state):
        jump, at = self.jump(u), Points(X=self._X, depth=self._depth, held=True, closing=self.closing)
        w = self._weights(p, at).ravel()
        taken = {law.name: law.work(jump, p, state, at) for law in self.laws}
        return {name: float(w @ density) for name, density in taken.items() if density is not None}

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


def _ends(step: Step) -> tuple[float, float]:
    """``ahead`` and ``fading`` of ``answers``."""
    return step.ahead, FADING if step.ahead else 0.0


def _ended(laws, jump, p, state, at, ahead, fading) -> tuple:
    """What ``laws`` answer, their tractions at the step's end, and the jump's rate over the step."""
    found = cut_answers(laws, jump, p, state, at)
    seen = {law.role: each for law, each in zip(laws, found, strict=True)}
    rate, T = (jump - at.jump_old) / at.dt, []
    for law, each, last in zip(laws, found, state["means"], strict=True):
        end = each.traction
        if law.over_step:
            known = law.ending(rate + ahead * (rate - state["rate"]), p, seen)
            end = end + ahead * (end - last)
            end = end if known is None else end + fading * (known - end)
        T.append(end)
    return found, T, rate


def traction(laws, *given) -> np.ndarray:
    """Of all ``laws`` together at the step's end (3, N)."""
    jump = given[0]
    return sum(_ended(laws, *given)[1], 0 * jump)


def answers(laws, components: int, jump, p, state, at, ahead, fading) -> tuple:
    """Tractions (laws, 3, N) at the step's end, the new state, and derivatives by the first ``components`` of
    the jump: of the whole traction (components, components, N) and of the damage (components, N).

    A mean over the step goes on to its end by ``ahead`` of what it differs by from that over the last one. So
    does the jump's rate, for what a law knows of the end itself: that counts by ``fading``.
    """

    def ended(jump):
        return _ended(laws, jump, p, state, at, ahead, fading)

    found, T, rate = ended(jump)
    new = {"damage": state["damage"], **add_states(*(each.new for each in found)), "rate": rate}
    none = 0 * jump[:0]
    new["means"] = np.stack([each.traction for each in found]) if found else none[None]
    D, by_jump = [], []
    for c in range(components):
        probe = jump.astype(complex)
        probe[c] += 1j * STEP
        probed, moved, _ = ended(probe)
        D.append(sum(np.imag(each[:components]) for each in moved) / STEP + 0 * jump[:components])
        damages = [each.new["damage"] for each in probed if "damage" in each.new]
        by_jump.append(sum(map(np.imag, damages)) / STEP + 0 * jump[0])
    ends = np.stack(T) if T else new["means"]
    return ends, new, np.stack(D, axis=1) if D else none[None], np.stack(by_jump) if by_jump else none


def _local_jumps(u, dofs, N, frame):
    values = blend(N, gather(u, dofs, frame.shape[1]))  # (dim, nq, nf)
    out = np.zeros((3, values[0].size), dtype=values.dtype)
    for c, axis in enumerate(frame):
        out[c] = (axis[:, None] * values).sum(axis=0).ravel()
    return out


@compiled(_local_jumps)
def _jumps(u, dofs, N, frame):
    nc, dim, nf = frame.shape
    nq, nn, _ = N.shape
    out = np.zeros((3, nq * nf), u.dtype)
    at_nodes = np.zeros((nn, nf), u.dtype)
    for c in range(nc):
        at_nodes[:] = 0
        for a in range(nn):
            for d in range(dim):
                for f in range(nf):
                    at_nodes[a, f] += frame[c, d, f] * u[dofs[d * nn + a, f]]
        for q in range(nq):
            for a in range(nn):
                for f in range(nf):
                    out[c, q * nf + f] += N[q, a, f] * at_nodes[a, f]
    return out


def _project(total, D, N, frame, w, vector, matrix):
    (nq, nf), nc, nd = w.shape, len(frame), len(vector)
    t = np.einsum("cdf,cqf->dqf", frame, total[:nc].reshape(nc, nq, nf) * w)
    vector = np.einsum("qaf,dqf->daf", N, t).reshape(nd, nf)
    if matrix.size:
        turned = np.einsum("cdf,ceqf,ekf->qdkf", frame, D.reshape(nc, nc, nq, nf) * w, frame)
        matrix = np.einsum("qdkf,qabf->dakbf", turned, N[:, :, None] * N[:, None]).reshape(nd, nd, nf)
    return vector, matrix


@compiled(_project)
def _projected(total, D, N, frame, w, vector, matrix):
    """Nodal forces (nd, nf) of tractions (3, nq·nf) and, where ``matrix`` (nd, nd, nf) is not empty, their
    derivative, from that of the tractions, D (nc, nc, nq·nf)."""
    nc, dim, nf = frame.shape
    nq, nn, _ = N.shape
    t = np.zeros(nf, vector.dtype)
    turned = np.zeros(nf, matrix.dtype)
    for q in range(nq):
        for d in range(dim):
            t[:] = 0
            for c in range(nc):
                for f in range(nf):
                    t[f] += frame[c, d, f] * total[c, q * nf + f] * w[q, f]
            for a in range(nn):
                for f in range(nf):
                    vector[d * nn + a, f] += N[q, a, f] * t[f]
            if matrix.size == 0:
                continue
            for k in range(dim):
                turned[:] = 0
                for c in range(nc):
                    for e in range(nc):
                        for f in range(nf):
                            turned[f] += frame[c, d, f] * D[c, e, q * nf + f] * frame[e, k, f] * w[q, f]
                for a in range(nn):
                    for b in range(nn):
                        for f in range(nf):
                            matrix[d * nn + a, k * nn + b, f] += N[q, a, f] * N[q, b, f] * turned[f]
    return vector, matrix
