"""Blade form: contact, friction and adhesion on the faces that the blade can meet (paper, eqs.
normal_traction_augmented to the return mapping). Tractions act per reference area, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from cutbench.forms.base import Form, Local, blend, component_major, gather
from cutbench.forms.gap import ToolGap
from cutbench.forms.normals import cross, inward, unit
from cutbench.forms.sliding import shear
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import Tool


@dataclass(frozen=True)
class ContactNumerics:
    """Numerical choices of the contact. ``stiffness`` ε_N in MPa per unit of the gap (mm, or 1 for the
    ellipse), ``tangential`` in MPa/mm; ``normal``: tool or material; ``gap``: distance or ellipse.

    Unless ``per_cell`` neither depends on the mesh: material gives way by p/ε_N, where ``carried`` by what a
    step adds to p, and results have a limit under refinement."""

    stiffness: float
    tangential: float
    normal: str = "tool"
    gap: str = "distance"
    #: A step begins with the last one's pressure as its multiplier.
    carried: bool = False
    #: Gap in mm at which a face that had touched is free of the blade; 0: it never is, as in the paper.
    release: float = 0.0
    #: Both stiffnesses are times 1 mm over the diameter of the element behind the face, as in the paper.
    per_cell: bool = False


class BladeForm(Form):
    """All blade laws on the faces ``faces``; ``keep_touched`` names the sets of them where Θ holds once a
    point has touched."""

    name = "blade"

    def __init__(
        self, laws, faces: Faces, numerics: ContactNumerics, *, keep_touched: Sequence[str], height: float
    ):
        self.tool = next(law for law in laws if isinstance(law, Tool))
        self.frictions = tuple(law for law in laws if law is not self.tool)
        self.faces, self.dim = faces, faces.X.shape[0]
        self._laws, self._numerics, self._height = tuple(laws), numerics, height
        self._kept = tuple(keep_touched)
        self._keeps = np.zeros(faces.size.size)
        for name, part in faces.parts.items():
            self._keeps[part] = name in keep_touched
        self.dofs = component_major(faces.nodes, self.dim)
        self._gap = ToolGap(numerics.gap, self.tool, faces, height)
        self._material = numerics.normal == "material"
        self._stiffness, self._tangential = self._stiffnesses(numerics)
        # Only the tool's normal without shear has a potential: friction is unsymmetric where the blade
        # is curved, and the material's normal turns with the face.
        self.symmetric = not self._material and not self.frictions
        self._patch: _Patch | None = None
        if self._material:
            along = np.einsum("dqf,df->qf", cross(list(faces.tangents[:, :, None])), faces.normal)
            self._sign = np.sign(along)

    def with_numerics(self, numerics: ContactNumerics) -> BladeForm:
        """The same faces and laws with other stiffnesses, which may be complex."""
        other = copy(self)
        other._numerics = numerics
        other._stiffness, other._tangential = self._stiffnesses(numerics)
        return other

    def _stiffnesses(self, numerics: ContactNumerics) -> tuple[np.ndarray, np.ndarray]:
        """Normal and tangential, each (nf,)."""
        scale = 1 / self.faces.cell if numerics.per_cell else np.ones(self.faces.cell.size)
        return numerics.stiffness * scale, numerics.tangential * scale

    def part(self, columns):
        faces = self.faces.some(columns)
        return BladeForm(self._laws, faces, self._numerics, keep_touched=self._kept, height=self._height)

    # -- state ----------------------------------------------------------------------------------
    def start(self, p):
        nq, nf = self.faces.w.shape
        scalars = dict.fromkeys(("multiplier", "pressure", "touched", "slid", "active"), np.zeros((nq, nf)))
        vectors = {name: np.zeros((self.dim, nq, nf)) for name in ("normal_traction", "shear")}
        return {**scalars, **vectors, "shares": np.zeros((len(self.frictions), nq, nf))}

    def carried(self, other, state, p):
        shape, new = self.faces.w.shape, {}
        for name, value in state.items():
            # Not −1: without friction there are no shares.
            points = value.reshape(*value.shape[:-2], other.faces.w.size)
            found = self.faces.from_others(other.faces, points)
            new[name] = found.reshape(*value.shape[:-2], *shape)
        for name in new.keys() & {"touched", "active"}:
            new[name] = np.round(new[name])
        return new

    def touch(self, state: dict) -> dict:
        """Θ for the next step (paper: from the last known pressure, kept on the cut faces; here until the
        blade is away) and its multiplier.
        """
        now = (state["pressure"] > 0).astype(float)
        return {**self.begun(state), "touched": np.maximum(now, self._keeps * state["touched"])}

    def begun(self, state: dict) -> dict:
        """With the multiplier of the next step: where the last one's pressure is carried, material gives way
        by what the pressure changes in a step. ``state`` or its derivatives.
        """
        return self.augment(state) if self._numerics.carried else state

    def augment(self, state: dict) -> dict:
        """Uzawa update: the multiplier takes over the pressure (paper, eq. update:ALN), a face's mean of it.

        One for each quadrature point would be more than a face has unknowns: some answer to no displacement,
        and runs that carried them ended in folds.
        """
        w, pressure = self.faces.w, state["pressure"]
        mean = (w * pressure).sum(axis=0) / w.sum(axis=0)
        return {**state, "multiplier": np.broadcast_to(mean, pressure.shape)}

    # -- evaluation -----------------------------------------------------------------------------
    def _patch_of(self, near: np.ndarray) -> _Patch:
        """The faces ``near`` alone; from one evaluation to the next they are mostly the same."""
        if self._patch is None or not np.array_equal(self._patch.near, near):
            self._patch = _Patch.of(self.faces, self.dofs, near)
        return self._patch

    def evaluate(self, u, p, state, step, tangent=True):
        dim = self.dim
        nd, nf = self.dofs.shape
        near = self._gap.near(gather(u.real, self.dofs, dim), state["touched"], p, step)
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
        g, gradient, H = self._gap.at(f.X + shift, near, p, step)
        direction, dn = (gradient, H) if self._gap.unit_gradient else unit(gradient, H)
        stiffness = np.broadcast_to(self._stiffness[near], (nq, count))
        t_N, dp = self.tool.pressure(g, state["multiplier"][:, near], stiffness, p)
        push = direction
        turn: Sequence[np.ndarray] = ()
        if self._material:
            slopes = [f.tangents[s][:, None] + blend(f.dN[s], U) for s in range(dim - 1)]
            push, turn = inward(slopes, self._sign[:, near], tangent)
        normal_traction = t_N * push
        total = normal_traction
        slid = None
        if self.frictions:
            moved = gather(u - step.u_old, patch.dofs, dim)
            slip = blend(f.N, moved) - (step.centre - step.centre_old)[:dim, None, None]
            slid = shear(
                self.frictions,
                self._tangential[near],
                f.X,
                near,
                t_N,
                direction,
                slip,
                dn,
                p,
                state,
                step,
                tangent,
            )
            total = total + slid["traction"]
            new["shear"][:, :, near] = slid["traction"]
            new["shares"][:, :, near] = slid["shares"]
            new["slid"] = new["slid"].copy()
            new["slid"][:, near] += slid["advance"]
        if self._numerics.release > 0:
            new["touched"] = np.array(state["touched"])
            new["touched"][:, near] *= np.real(g) < np.real(self._numerics.release)
        new["pressure"][:, near] = t_N
        new["active"][:, near] = np.real(t_N) > 0
        new["normal_traction"][:, :, near] = normal_traction
        vector[:, near] = -np.einsum("qaf,dqf->daf", f.N, total * f.w).reshape(nd, count)
        if matrix is not None:
            D = dp * push[:, None] * gradient[None]
            if not self._material:
                D += t_N * dn
            if slid is not None:
                D += slid["D"]
            K = _sandwich(D * f.w, patch.NN)
            for dt, NdN in zip(turn, patch.NdN, strict=False):
                K += _sandwich(dt * (t_N * f.w), NdN)
            matrix[:, :, near] = -K.reshape(nd, nd, count)
        return Local(vector, matrix, new)

    def _gaps(self, u, centre, p, step) -> np.ndarray:
        """Gap (nq, nf) at all points, for displacements ``u`` and the blade at ``centre``."""
        x = self.faces.X + blend(self.faces.N, gather(u, self.dofs, self.dim))
        return self._gap.at(x, np.arange(self.faces.size.size), p, replace(step, centre=centre))[0]

    def gap_of_nodes(self, X, u, state, p, step) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap (n,), its gradient (dim, n) and numbers (n,) of the nodes of faces that touch in ``state``.

        ``X`` (dim, nnode): where all nodes are before loading.
        """
        near = np.flatnonzero(state["active"].max(axis=0) > 0)
        all_nodes = self.faces.nodes[:, near]
        x = (X + u[: X.size].reshape(-1, self.dim).T)[:, all_nodes]
        g, gradient, _ = self._gap.at(x, near, p, step)
        nodes, first = np.unique(all_nodes.ravel(), return_index=True)
        return g.ravel()[first], gradient.reshape(self.dim, -1)[:, first], nodes

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

        if self._gap.unit_gradient and not self._material:
            # t_N ∇g·ds is t_N dg. The mean of two tractions does not turn with what slides round the tip
            # within a step, and contact would seem to take energy.
            before, after = (
                self._gaps(*at, p, step) for at in ((step.u_old, step.centre_old), (u, step.centre))
            )
            taken = -mean("pressure") * (after - before)
        else:
            taken = -(mean("normal_traction") * slip).sum(axis=0)
        out = {self.tool.name: float((taken * f.w).sum())}
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
        some = faces.some(near)
        N, reached = some.N[:, :, None], np.ascontiguousarray(dofs[:, near])
        return cls(near, reached, some, N * some.N[:, None], [N * dN[:, None] for dN in some.dN])


def _sandwich(D: np.ndarray, NM: np.ndarray) -> np.ndarray:
    """Σ_q D_ik (N_a M_b): (i, k, q, f), (q, a, b, f) to (i, a, k, b, f)."""
    return np.einsum("ikqf,qabf->iakbf", D, NM)
