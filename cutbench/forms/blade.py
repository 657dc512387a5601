"""Blade form: contact, friction and adhesion on the faces that the blade can meet (paper, eqs.
normal_traction_augmented to the return mapping). Tractions act per reference area, as in the paper.

What a law's strength depends on — pressure and Θ — is that of the last converged step. The paper does so
with Θ; with the pressure too, friction no longer feeds back on contact within a step, and runs with
Coulomb friction get through onsets at which they stall otherwise. Refining the step removes the lag.

The traction may act along the tool's normal (that of the obstacle: frictionless contact then has a
potential) or along the material's, n = F⁻ᵀN/|F⁻ᵀN| (the paper's: on the cut faces it is a wedge). A face that
has folded inside the blade is held there by its own normal: "blended" turns to the tool's with the depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from cutbench.forms.base import Form, Local, blend, component_major, gather
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP, Points
from cutbench.mechanisms.blade._tool import GAPS


@dataclass(frozen=True)
class ContactNumerics:
    """Numerical choices of the contact. ``stiffness`` ε_N in MPa per unit of the gap (mm, or 1 for the
    ellipse), ``tangential`` in MPa/mm; ``normal``: tool or material; ``gap``: distance or ellipse.

    Neither depends on the mesh: material gives way by p/ε_N, and results have a limit under refinement."""

    stiffness: float
    tangential: float
    normal: str = "tool"
    gap: str = "distance"


#: Added to the gap beyond the blade's ends, mm.
FAR = 1e6


class BladeForm(Form):
    """All blade laws on the faces ``faces``; ``keep_touched`` names the sets of them where Θ holds once a
    point has touched."""

    name = "blade"
    #: Points farther beside the blade than this cannot touch it within a step, mm.
    reach = 0.25

    def __init__(
        self, laws, faces: Faces, numerics: ContactNumerics, *, keep_touched: Sequence[str], height: float
    ):
        self.contact = next(law for law in laws if law.role == "contact")
        self.frictions = tuple(law for law in laws if law.role != "contact")
        self.faces, self.dim = faces, faces.X.shape[0]
        self._keeps = np.zeros(faces.size.size)
        for name, part in faces.parts.items():
            self._keeps[part] = name in keep_touched
        self.dofs = component_major(faces.nodes, self.dim)
        self._gap = GAPS[numerics.gap]
        self._unit_gradient = numerics.gap == "distance"
        self._material = numerics.normal in ("material", "blended")
        self._blended = numerics.normal == "blended"
        self._stiffness = numerics.stiffness
        self._tangential = numerics.tangential
        self._height = height
        # Only the tool's normal without shear has a potential: friction is unsymmetric where the blade
        # is curved, and the material's normal turns with the face.
        self.symmetric = not self._material and not self.frictions
        # A face belongs to one flank for good: material pressed across the mid-plane is pushed back to
        # its own side, not out on the other.
        middle = faces.X[0].mean(axis=0)
        on_plane = np.abs(middle) < 1e-9 * height
        self._flank = np.sign(np.where(on_plane, -faces.normal[0], middle))
        self._upper = faces.X[1].max(axis=0)
        self._patch: _Patch | None = None
        if self._material:
            reference = np.broadcast_to(
                faces.tangents[:, :, None], (self.dim - 1, self.dim, 1, faces.size.size)
            )
            along = np.einsum("dqf,df->qf", _cross(reference), faces.normal)
            self._sign = np.sign(along)

    def with_numerics(self, numerics: ContactNumerics) -> BladeForm:
        """The same faces and laws with other stiffnesses, which may be complex."""
        other = copy(self)
        other._stiffness = numerics.stiffness
        other._tangential = numerics.tangential
        return other

    # -- state ----------------------------------------------------------------------------------
    def start(self, p):
        nq, nf = self.faces.w.shape
        zero = np.zeros((nq, nf))
        laws = len(self.frictions)
        return {
            "multiplier": zero,
            "pressure": zero,
            "touched": zero,
            "slid": zero,
            "active": zero,
            "normal_traction": np.zeros((self.dim, nq, nf)),
            "shear": np.zeros((self.dim, nq, nf)),
            "shares": np.zeros((laws, nq, nf)),
        }

    def touch(self, state: dict) -> dict:
        """Θ for the next step (paper: from the last known pressure, kept on the cut faces)."""
        now = (state["pressure"] > 0).astype(float)
        return {**state, "touched": np.maximum(now, self._keeps * state["touched"])}

    def augment(self, state: dict) -> dict:
        """Uzawa update: the multiplier takes over the pressure (paper, eq. update:ALN)."""
        return {**state, "multiplier": state["pressure"]}

    # -- kinematics -----------------------------------------------------------------------------
    def _near(self, u, p, state, step) -> np.ndarray:
        """Faces that can touch the blade or carry shear."""
        U = gather(u.real, self.dofs, self.dim)
        turn = np.real(p.tilt) if self.dim == 3 else 0.0
        X, across = _across(self.faces.X, turn), _across(U, turn)
        left, right = X.min(axis=0) + across.min(axis=0), X.max(axis=0) + across.max(axis=0)
        y = self._upper + U[1].max(axis=0)
        tip = np.real(step.centre[1] - p.tip)
        half = np.real(p.thickness) / 2 + self.reach
        near = (left < half) & (right > -half) & (y > tip - self.reach)
        return np.flatnonzero(near | (state["touched"].max(axis=0) > 0))

    def _patch_of(self, near: np.ndarray) -> _Patch:
        """The faces ``near`` alone; from one evaluation to the next they are mostly the same."""
        if self._patch is None or not np.array_equal(self._patch.near, near):
            self._patch = _Patch.of(self.faces, self.dofs, near)
        return self._patch

    # -- evaluation -----------------------------------------------------------------------------
    def evaluate(self, u, p, state, step, tangent=True):
        dim = self.dim
        nd, nf = self.dofs.shape
        near = self._near(u, p, state, step)
        # Any of these may carry a complex step.
        given = (u, step.u_old, step.centre, step.dt, self._stiffness, *state.values(), *vars(p).values())
        kind = np.result_type(float, *given)
        vector = np.zeros((nd, nf), dtype=kind)
        matrix = np.zeros((nd, nd, nf)) if tangent else None
        new = {**state}
        for key in ("pressure", "active", "normal_traction", "shear", "shares"):
            new[key] = np.zeros_like(state[key])
        if near.size == 0:
            return Local(vector, matrix, new)
        if np.iscomplexobj(vector):
            new = {k: v.astype(complex) for k, v in new.items()}
        patch = self._patch_of(near)
        f = patch.faces
        U = gather(u, patch.dofs, dim)
        shift = blend(f.N, U)
        nq, count = f.w.shape
        g, gradient, H = self._gap_at(f.X + shift, near, p, step)
        direction, dn = (gradient, H) if self._unit_gradient else self._unit(gradient, H)
        stiffness = np.full((nq, count), self._stiffness)
        t_N, dp = self.contact.pressure(g, state["multiplier"][:, near], stiffness, p)
        push, turn, along_tool = direction, (), 1.0
        if self._material:
            slopes = [f.tangents[s][:, None] + blend(f.dN[s], U) for s in range(dim - 1)]
            push, turn = self._material_direction(slopes, self._sign[:, near], tangent)
            along_tool, by_gap = 0.0, 0.0
            if self._blended:
                along_tool, by_gap = _turned(g, p.thickness / 2)
                by_gap = by_gap * (direction - push)
                push = push + along_tool * (direction - push)
        normal_traction = t_N * push
        total = normal_traction
        shear = None
        if self.frictions:
            moved = gather(u - step.u_old, patch.dofs, dim)
            slip = blend(f.N, moved) - (step.centre - step.centre_old)[:dim, None, None]
            shear = self._shear(near, t_N, direction, slip, dn, p, state, step, tangent)
            total = total + shear["traction"]
            new["shear"][:, :, near] = shear["traction"]
            new["shares"][:, :, near] = shear["shares"]
            new["slid"] = new["slid"].copy()
            new["slid"][:, near] += shear["advance"]
        new["pressure"][:, near] = t_N
        new["active"][:, near] = np.real(t_N) > 0
        new["normal_traction"][:, :, near] = normal_traction
        vector[:, near] = -np.einsum("qaf,dqf->daf", f.N, total * f.w).reshape(nd, count)
        if tangent:
            D = dp * push[:, None] * gradient[None]
            if not self._material:
                D += t_N * dn
            elif self._blended:
                D += t_N * (along_tool * dn + by_gap[:, None] * gradient[None])
            if shear is not None:
                D += shear["D"]
            K = _sandwich(D * f.w, patch.NN)
            for dt, NdN in zip(turn, patch.NdN, strict=False):
                K += _sandwich(dt * (t_N * (1 - along_tool) * f.w), NdN)
            matrix[:, :, near] = -K.reshape(nd, nd, count)
        return Local(vector, matrix, new)

    def _gap_at(self, x, near, p, step):
        """Gap (nq, nf), gradient (dim, nq, nf) and second derivative (dim, dim, nq, nf)."""
        dim, shape = self.dim, x.shape[1:]
        a, b = self.contact.half_axes(p)
        flank = np.broadcast_to(self._flank[near], shape).ravel()
        turn = p.tilt if dim == 3 else 0.0
        rx = (_across(x, turn) - step.centre[0]).ravel() * flank
        ry = (x[1] - step.centre[1]).ravel() + (p.tip - b)  # a shorter tip has its apex at the same place
        over = np.where(np.real(rx) < 0, rx, 0)  # beyond the mid-plane the gap goes on linearly
        g, n, H = self._gap(rx - over, ry, a, b)
        g = g + over * n[0]
        n[1] = n[1] + over * H[0, 1]
        n[0], H[0, 1], H[1, 0] = flank * n[0], flank * H[0, 1], flank * H[1, 0]
        H[0, 0] = np.where(np.real(over) < 0, 0, H[0, 0])
        bent = np.flatnonzero(over * H[0, 1])
        if bent.size and not np.iscomplexobj(rx):  # third derivative of the gap, by a complex step
            ahead = self._gap((rx - over)[bent], ry[bent] + 1j * STEP, a, b)[2]
            H[1, 1, bent] += over[bent] * ahead[0, 1].imag / STEP
        if not self._unit_gradient:
            # In mm: on the band the paper's number is 2/a times the distance, to first order.
            g, n, H = (p.thickness / 4 * part for part in (g, n, H))
        gradient = np.zeros((dim, *shape), dtype=n.dtype)
        second = np.zeros((dim, dim, *shape), dtype=n.dtype)
        gradient[:2] = n.reshape(2, *shape)
        second[:2, :2] = H.reshape(2, 2, *shape)
        g = g.reshape(shape)
        if dim == 3:
            if turn != 0:
                c, s = np.cos(turn), np.sin(turn)
                back = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
                gradient = np.einsum("ji,jqf->iqf", back, gradient)
                second = np.einsum("ji,jkqf,kl->ilqf", back, second, back)
            if np.real(p.overhang) < 0:
                # The blade ends inside the block: points beyond it, as they lay before loading, stay free.
                X = self.faces.X[:, :, near]
                along = X[2] * np.cos(np.real(turn)) + X[0] * np.sin(np.real(turn))
                g = np.where(np.abs(along) > np.real(p.length) / 2 + np.real(p.overhang), g + FAR, g)
        return g, gradient, second

    @staticmethod
    def _unit(n, H):
        """Unit normal and its derivative, for a gap whose gradient may not have length 1."""
        size = np.sqrt((n * n).sum(axis=0))
        e = n / size
        He = np.einsum("ikqf,kqf->iqf", H, e)
        return e, (H - e[:, None] * He[None]) / size

    def _material_direction(self, slopes, sign, tangent):
        """Inward material normal and its derivative by each tangent (dim, dim, nq, nf)."""
        c = _cross(slopes) * sign
        size = np.sqrt((c * c).sum(axis=0))
        n = c / size
        if not tangent:
            return -n, ()
        scale = sign / size
        turn = []
        for dc in _cross_slopes(slopes):
            along = (n[:, None] * dc).sum(axis=0)
            turn.append(scale * (n[:, None] * along[None] - dc))
        return -n, turn

    def _shear(self, near, t_N, n, slip, dn, p, state, step, tangent):
        """Return mapping of the tangential traction; strengths of all laws add up."""
        dim = self.dim
        stick = self._tangential
        v = state["shear"][:, :, near] - stick * slip
        nv = (n * v).sum(axis=0)
        trial = v - n * nv
        m2 = (trial * trial).sum(axis=0)
        m = np.sqrt(np.where(m2.real > 0, m2, 1.0))
        tangential = slip - n * (n * slip).sum(axis=0)
        s2 = (tangential * tangential).sum(axis=0)
        distance = np.sqrt(np.where(s2.real > 0, s2, 0.0))
        at = Points(
            X=self.faces.X[:, :, near],
            touched=state["touched"][:, near],
            slid=state["slid"][:, near],
            slip_rate=distance / step.dt,
            speed=p.speed,
            dt=step.dt,
        )
        known = state["pressure"][:, near]
        parts = np.stack([law.strength(known, p, state, at) + 0 * t_N for law in self.frictions])
        strength = parts.sum(axis=0)
        slips = m.real > strength.real
        ratio = np.where(slips, strength / m, 1.0)
        ratio = np.where(m2.real > 0, ratio, 0.0)
        traction = ratio * trial
        total = np.where(strength.real > 0, strength, 1.0)
        # What passes the blade at a distance does not rub.
        rubs = (np.real(at.touched) > 0) | (np.real(t_N) > 0)
        out = {"traction": traction, "shares": parts / total, "advance": np.where(rubs, distance, 0)}
        if not tangent:
            return out
        nn = n[:, None] * n[None]
        dv = (v[:, None] * dn).sum(axis=0)
        dtrial = stick * nn - dn * nv - n[:, None] * dv[None]
        for i in range(dim):
            dtrial[i, i] -= stick
        e = trial / m
        along = np.where(slips, (e[:, None] * dtrial).sum(axis=0), 0.0)
        D = ratio * (dtrial - e[:, None] * along[None])
        faster = Points(**{**vars(at), "slip_rate": at.slip_rate + 1j * STEP})
        by_rate = sum(np.imag(law.strength(known, p, state, faster)) for law in self.frictions) / STEP
        by_rate = np.where(slips & (distance > 0), by_rate, 0.0)
        if by_rate.any():
            # In small steps this is what resists most: the strength grows with Δs/Δt.
            s = tangential / np.where(distance > 0, distance, 1.0)
            longer = s - (s[:, None] * dn).sum(axis=0) * (n * slip).sum(axis=0)
            D = D + e[:, None] * (by_rate / step.dt * longer)[None]
        out["D"] = D
        return out

    # -- results --------------------------------------------------------------------------------
    def force(self, state: dict) -> np.ndarray:
        """Force (dim,) of the material on the blade, per mm of length in 2D."""
        return -((state["normal_traction"] + state["shear"]) * self.faces.w).sum(axis=(1, 2))

    def work(self, u, p, old, new, step):
        f, dim = self.faces, self.dim
        slip = blend(f.N, gather(u - step.u_old, self.dofs, dim))
        slip = slip - (step.centre - step.centre_old)[:dim, None, None]

        def mean(key):
            return (old[key] + new[key]) / 2

        out = {self.contact.name: -float((mean("normal_traction") * slip * f.w).sum())}
        for i, law in enumerate(self.frictions):
            part = (old["shares"][i] * old["shear"] + new["shares"][i] * new["shear"]) / 2
            out[law.name] = -float((part * slip * f.w).sum())
        return out


@dataclass(frozen=True)
class _Patch:
    """Some of the faces, with the products of their shape functions that tangents need."""

    near: np.ndarray  # (count,) their numbers
    dofs: np.ndarray  # (nd, count)
    faces: Faces
    NN: np.ndarray  # (nq, nn, nn, count)
    NdN: list[np.ndarray]  # (nq, nn, nn, count) for each tangent

    @classmethod
    def of(cls, faces: Faces, dofs: np.ndarray, near: np.ndarray) -> _Patch:
        names = ("nodes", "N", "dN", "w", "X", "normal", "tangents", "size")
        # A selection along the last axis is not contiguous by itself, and every product would pay for it.
        arrays = {name: np.ascontiguousarray(getattr(faces, name)[..., near]) for name in names}
        some = replace(faces, **arrays)
        N = some.N[:, :, None]
        return cls(
            near,
            np.ascontiguousarray(dofs[:, near]),
            some,
            N * some.N[:, None],
            [N * dN[:, None] for dN in some.dN],
        )


def _across(x: np.ndarray, turn) -> np.ndarray:
    """Coordinate across a blade that is turned about the height, for positions or motions x (dim, …)."""
    return x[0] if len(x) == 2 or turn == 0 else x[0] * np.cos(turn) - x[2] * np.sin(turn)


#: Depths in units of the blade's half-thickness between which the push turns from the material's normal to
#: the tool's.
SHALLOW, DEEP = 0.05, 0.2


def _turned(gap, a):
    """Share of the tool's normal in the push (q, f), 0 to 1, and its derivative by the gap."""
    span = (DEEP - SHALLOW) * a
    s = (-gap - SHALLOW * a) / span
    s = np.where(s.real <= 0, 0, np.where(s.real >= 1, 1, s))
    return s * s * (3 - 2 * s), -6 * s * (1 - s) / span


def _cross(tangents) -> np.ndarray:
    """A normal (dim, q, f) to one (2D) or two (3D) tangents, not of unit length."""
    if len(tangents) == 1:
        return np.stack([tangents[0][1], -tangents[0][0]])
    a, b = tangents
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _cross_slopes(tangents) -> list[np.ndarray]:
    """Derivative of ``_cross`` by each tangent, (dim, dim, q, f) or broadcast to it."""
    if len(tangents) == 1:
        return [np.array([[0.0, 1.0], [-1.0, 0.0]])[:, :, None, None]]
    a, b = tangents
    return [-_skew(b), _skew(a)]


def _skew(a: np.ndarray) -> np.ndarray:
    """The matrix (3, 3, …) of the cross product a × ·."""
    o = np.zeros_like(a[0])
    return np.stack([np.stack([o, -a[2], a[1]]), np.stack([a[2], o, -a[0]]), np.stack([-a[1], a[0], o])])


def _sandwich(D: np.ndarray, NM: np.ndarray) -> np.ndarray:
    """Σ_q D_ik (N_a M_b): (i, k, q, f), (q, a, b, f) to (i, a, k, b, f)."""
    return np.einsum("ikqf,qabf->iakbf", D, NM)
