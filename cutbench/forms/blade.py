"""Blade form: contact, friction and adhesion on one set of faces (paper, eqs. normal_traction_augmented
to the return mapping). Tractions act per reference area, as in the paper.

The traction may act along the tool's normal (that of the obstacle: frictionless contact then has a
potential) or along the material's, n = F⁻ᵀN/|F⁻ᵀN| (the paper's: on the cut faces it is a wedge).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cutbench.forms.base import Form, Local, blend, component_major, nodal
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP, Points
from cutbench.mechanisms.blade._tool import GAPS


@dataclass(frozen=True)
class ContactNumerics:
    """Numerical choices of the contact. ``stiffness``, ``tangential``: ε/size in MPa/mm times face size
    in mm, so in MPa; ``normal``: tool or material; ``gap``: distance or ellipse."""

    stiffness: float
    tangential: float
    normal: str = "tool"
    gap: str = "distance"


class BladeForm(Form):
    """All blade laws on the faces ``faces``; ``keep_touched`` holds Θ once a point has touched."""

    #: Points farther beside the blade than this cannot touch it within a step, mm.
    reach = 0.25

    def __init__(self, laws, faces: Faces, numerics: ContactNumerics, *, keep_touched: bool, height: float):
        self.contact = next(law for law in laws if law.role == "contact")
        self.frictions = tuple(law for law in laws if law.role != "contact")
        self.faces, self.dim, self.keep_touched = faces, faces.X.shape[0], keep_touched
        self.name = f"blade_{faces.name}"
        self.dofs = component_major(faces.nodes, self.dim)
        self._gap = GAPS[numerics.gap]
        self._material = numerics.normal == "material"
        self._stiffness = numerics.stiffness / faces.size
        self._tangential = numerics.tangential / faces.size
        self._height = height
        if self._material:
            reference = np.broadcast_to(
                faces.tangents[:, :, None], (self.dim - 1, self.dim, 1, faces.size.size)
            )
            along = np.einsum("dqf,df->qf", _cross(reference), faces.normal)
            self._sign = np.sign(along)

    # -- state ----------------------------------------------------------------------------------
    def start(self, p):
        nq, nf = self.faces.w.shape
        zero = np.zeros((nq, nf))
        laws = len(self.frictions)
        return {
            "multiplier": zero, "pressure": zero, "touched": zero, "slid": zero, "active": zero,
            "normal_traction": np.zeros((self.dim, nq, nf)),
            "shear": np.zeros((self.dim, nq, nf)),
            "shares": np.zeros((laws, nq, nf)),
        }

    def touch(self, state: dict) -> dict:
        """Θ for the next step (paper: from the last known pressure, kept on the cut faces)."""
        now = (state["pressure"] > 0).astype(float)
        return {**state, "touched": np.maximum(now, state["touched"]) if self.keep_touched else now}

    def augment(self, state: dict) -> dict:
        """Uzawa update: the multiplier takes over the pressure (paper, eq. update:ALN)."""
        return {**state, "multiplier": state["pressure"]}

    # -- kinematics -----------------------------------------------------------------------------
    def _near(self, u, p, state, step) -> np.ndarray:
        """Faces that can touch the blade or carry shear."""
        f, dim = self.faces, self.dim
        U = nodal(u, f.nodes, dim).real
        x = f.X[0].min(axis=0) + U[0].min(axis=0)
        y = f.X[1].max(axis=0) + U[1].max(axis=0)
        tip = np.real(step.centre[1] - p.tip)
        half = np.real(p.thickness) / 2
        near = (np.abs(x) < half + self.reach) & (y > tip - self.reach)
        return np.flatnonzero(near | (state["touched"].max(axis=0) > 0))

    # -- evaluation -----------------------------------------------------------------------------
    def evaluate(self, u, p, state, step, tangent=True):
        f, dim = self.faces, self.dim
        nd, nf = self.dofs.shape
        near = self._near(u, p, state, step)
        kind = np.result_type(u, step.centre, p.thickness, p.tip, *state.values())
        vector = np.zeros((nd, nf), dtype=np.result_type(kind, *[getattr(p, q.name) for law in self.frictions
                                                               for q in law.parameters]))
        matrix = np.zeros((nd, nd, nf)) if tangent else None
        new = {**state, "pressure": np.zeros_like(state["pressure"]), "active": np.zeros_like(state["active"]),
               "normal_traction": np.zeros_like(state["normal_traction"]),
               "shear": np.zeros_like(state["shear"]), "shares": np.zeros_like(state["shares"])}
        if near.size == 0:
            return Local(vector, matrix, new)
        if np.iscomplexobj(vector):
            new = {k: v.astype(complex) for k, v in new.items()}
        N, w, nodes = f.N[:, :, near], f.w[:, near], f.nodes[:, near]
        U, U_old = nodal(u, nodes, dim), nodal(step.u_old, nodes, dim)
        shift = blend(N, U)
        x = f.X[:, :, near] + shift
        nq, count = w.shape
        g, n, H = self._gap_at(x, p, step)
        stiffness = np.broadcast_to(self._stiffness[near], (nq, count))
        t_N, dp = self.contact.pressure(g, state["multiplier"][:, near], stiffness, p)
        gradient, direction, dn = n, *self._unit(n, H)
        turn = None
        if self._material:
            slopes = [f.tangents[s][:, None, near] + blend(f.dN[s][:, :, near], U) for s in range(dim - 1)]
            push, turn = self._material_direction(slopes, self._sign[:, near])
        else:
            push = direction
        normal_traction = t_N * push
        total = normal_traction
        shear = None
        if self.frictions:
            slip = shift - blend(N, U_old) - (step.centre - step.centre_old)[:dim, None, None]
            shear = self._shear(near, t_N, direction, slip, dn, dp, gradient, p, state, step, tangent)
            total = total + shear["traction"]
            new["shear"][:, :, near] = shear["traction"]
            new["shares"][:, :, near] = shear["shares"]
            new["slid"] = new["slid"].copy()
            new["slid"][:, near] += shear["advance"]
        new["pressure"][:, near] = t_N
        new["active"][:, near] = np.real(t_N) > 0
        new["normal_traction"][:, :, near] = normal_traction
        tw = total * w
        vector[:, near] = -np.einsum("qaf,dqf->daf", N, tw, optimize=False).reshape(nd, count)
        if tangent:
            D = dp * push[:, None] * gradient[None]
            if not self._material:
                D = D + t_N * dn
            if shear is not None:
                D = D + shear["D"]
            K = -_sandwich(N, D * w, N)
            if turn is not None:
                for s in range(dim - 1):
                    K -= _sandwich(N, turn[s] * (t_N * w), f.dN[s][:, :, near])
            matrix[:, :, near] = K.reshape(nd, nd, count)
        return Local(vector, matrix, new)

    def _gap_at(self, x, p, step):
        """Gap (nq, nf), gradient (dim, nq, nf) and second derivative (dim, dim, nq, nf)."""
        dim, shape = self.dim, x.shape[1:]
        rx = (x[0] - step.centre[0]).ravel()
        ry = (x[1] - step.centre[1]).ravel()
        g, n, H = self._gap(rx, ry, p.thickness / 2, p.tip)
        gradient = np.zeros((dim, *shape), dtype=n.dtype)
        second = np.zeros((dim, dim, *shape), dtype=n.dtype)
        gradient[:2] = n.reshape(2, *shape)
        second[:2, :2] = H.reshape(2, 2, *shape)
        return g.reshape(shape), gradient, second

    @staticmethod
    def _unit(n, H):
        """Unit normal and its derivative, for a gap whose gradient may not have length 1."""
        size = np.sqrt((n * n).sum(axis=0))
        e = n / size
        He = np.einsum("ikqf,kqf->iqf", H, e)
        return e, (H - e[:, None] * He[None]) / size

    def _material_direction(self, slopes, sign):
        """Inward material normal and its derivative by each tangent (dim, dim, nq, nf)."""
        c = _cross(np.stack(slopes)) * sign
        size = np.sqrt((c * c).sum(axis=0))
        n = c / size
        dim = self.dim
        eye = np.eye(dim)[:, :, None, None]
        project = (eye - n[:, None] * n[None]) / size * sign
        turn = []
        for s in range(dim - 1):
            dc = np.zeros((dim, dim, *size.shape), dtype=c.dtype)
            for k in range(dim):
                probe = [np.zeros_like(t) for t in slopes]
                for r, t in enumerate(slopes):
                    probe[r] = t if r != s else np.zeros_like(t)
                probe[s][k] = 1.0
                dc[:, k] = _cross(np.stack(probe))
            turn.append(-np.einsum("ijqf,jkqf->ikqf", project, dc))
        return -n, turn

    def _shear(self, near, t_N, n, slip, dn, dp, gradient, p, state, step, tangent):
        """Return mapping of the tangential traction; strengths of all laws add up."""
        dim = self.dim
        stick = self._tangential[near]
        v = state["shear"][:, :, near] - stick * slip
        nv = (n * v).sum(axis=0)
        trial = v - n * nv
        m2 = (trial * trial).sum(axis=0)
        m = np.sqrt(np.where(m2.real > 0, m2, 1.0))
        tangential = slip - n * (n * slip).sum(axis=0)
        s2 = (tangential * tangential).sum(axis=0)
        distance = np.sqrt(np.where(s2.real > 0, s2, 0.0))
        at = Points(
            X=self.faces.X[:, :, near], touched=state["touched"][:, near], slid=state["slid"][:, near],
            slip_rate=distance / step.dt, speed=p.speed, dt=step.dt,
        )
        parts = np.stack([law.strength(t_N, p, state, at) + 0 * t_N for law in self.frictions])
        strength = parts.sum(axis=0)
        slips = m.real > strength.real
        ratio = np.where(slips, strength / m, 1.0)
        ratio = np.where(m2.real > 0, ratio, 0.0)
        traction = ratio * trial
        total = np.where(strength.real > 0, strength, 1.0)
        out = {"traction": traction, "shares": parts / total, "advance": distance}
        if not tangent:
            return out
        by_pressure = sum(
            law.strength(t_N + 1j * STEP, p, state, at).imag / STEP + 0 * t_N for law in self.frictions
        )
        # The strength's dependence on the slip rate is kept out of the tangent: it is weak and its
        # inclusion makes the sticking branch unsymmetric.
        eye = np.eye(dim)[:, :, None, None]
        flat = eye - n[:, None] * n[None]
        dv = np.einsum("kqf,kjqf->jqf", v, dn)
        dtrial = -stick * flat - dn * nv - n[:, None] * dv[None]
        e = trial / m
        along = np.einsum("iqf,ijqf->jqf", e, dtrial)
        D = ratio * (dtrial - np.where(slips, 1.0, 0.0) * e[:, None] * along[None])
        D = D + np.where(slips, by_pressure * dp, 0.0) * e[:, None] * gradient[None]
        out["D"] = D
        return out

    # -- results --------------------------------------------------------------------------------
    def force(self, state: dict) -> np.ndarray:
        """Force (dim,) of the material on the blade, per mm of length in 2D."""
        return -((state["normal_traction"] + state["shear"]) * self.faces.w).sum(axis=(1, 2))

    def work(self, u, p, old, new, step):
        f, dim = self.faces, self.dim
        slip = blend(f.N, nodal(u - step.u_old, f.nodes, dim))
        slip = slip - (step.centre - step.centre_old)[:dim, None, None]

        def mean(key):
            return (old[key] + new[key]) / 2

        out = {self.contact.name: -float((mean("normal_traction") * slip * f.w).sum())}
        for i, law in enumerate(self.frictions):
            part = (old["shares"][i] * old["shear"] + new["shares"][i] * new["shear"]) / 2
            out[law.name] = -float((part * slip * f.w).sum())
        return out


def _cross(tangents: np.ndarray) -> np.ndarray:
    """A normal to one (2D) or two (3D) tangents (dim−1, dim, q, f), not of unit length."""
    if tangents.shape[0] == 1:
        return np.stack([tangents[0, 1], -tangents[0, 0]])
    a, b = tangents
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _sandwich(N: np.ndarray, D: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Σ_q N_a D_ik M_b: (q, a, f), (i, k, q, f), (q, b, f) to (i, a, k, b, f)."""
    return np.einsum("qaf,ikqf,qbf->iakbf", N, D, M, optimize=False)
