"""Blade form: contact, friction and adhesion on the faces that the blade can meet (paper, eqs.
normal_traction_augmented to the return mapping). Tractions act per reference area, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from operator import is_

import numpy as np

from cutbench.base.fused import fused
from cutbench.forms.base import AT_REST, Form, Local, Step, blend, component_major, gather
from cutbench.forms.blade_gap import Approach, Met, ToolGap
from cutbench.forms.blade_gap import met as points_met
from cutbench.forms.contact_assembly import Contact, Found, Sliding, pressed, sandwich
from cutbench.forms.normals import cross, inward, unit
from cutbench.forms.sliding import Strengths
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import Tool


@dataclass(frozen=True)
class ContactNumerics:
    """Numerical choices of the contact. ``stiffness`` ε_N in MPa per unit of the gap (mm, or 1 for the
    ellipse), ``tangential`` in MPa/mm; ``normal``: tool or material; ``gap``: distance or ellipse.

    Unless ``per_cell`` neither depends on the mesh: material gives way by p/ε_N, where ``carried`` by what
    is not foreseen of p, and results have a limit under refinement."""

    stiffness: float
    tangential: float
    normal: str = "tool"
    gap: str = "distance"
    #: A step begins with the pressure foreseen from the last two as its multiplier.
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
        self._strengths, self._pressure = Strengths(self.frictions), fused(self.tool.pressure)
        self._place: _Place | None = None
        self._last: _Begun | None = None
        if self._material:
            along = np.einsum("dqf,df->qf", cross(list(faces.tangents[:, :, None])), faces.normal)
            self._sign = np.sign(along)

    def with_numerics(self, numerics: ContactNumerics) -> BladeForm:
        """The same faces and laws with other stiffnesses, which may be complex."""
        other = copy(self)
        other._numerics, other._place, other._strengths = numerics, None, Strengths(self.frictions)
        other._last = None
        other._stiffness, other._tangential = self._stiffnesses(numerics)
        return other

    def with_laws(self, laws, numerics: ContactNumerics) -> BladeForm:
        """Others on the same faces."""
        return BladeForm(laws, self.faces, numerics, keep_touched=self._kept, height=self._height)

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
        names = ("multiplier", "pressure", "earlier", "foreseen", "touched", "slid", "active")
        scalars = dict.fromkeys(names, np.zeros((nq, nf)))
        shears = ("shear", "earlier_shear", "foreseen_shear")
        vectors = {name: np.zeros((self.dim, nq, nf)) for name in ("normal_traction", *shears)}
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

    def touch(self, state: dict, step: Step = AT_REST) -> dict:
        """Θ for the next step (paper: from the last known pressure, kept on the cut faces; here until the
        blade is away) and its multiplier.
        """
        now = (state["pressure"] > 0).astype(float)
        return {**self.begun(state, step), "touched": np.maximum(now, self._keeps * state["touched"])}

    def begun(self, state: dict, step: Step = AT_REST) -> dict:
        """With the pressure and the shear ``foreseen`` for ``step`` from the last two. That pressure is the
        strength of friction. Where pressures are carried it is the multiplier, and shear begins with what is
        foreseen of it: then material gives way, and slips where it sticks, by what that errs by. ``state`` or
        its derivatives.
        """
        pressure, shear = state["pressure"], state["shear"]
        foreseen = step.foreseen(pressure, state["earlier"])
        begun = {**state, "foreseen": foreseen, "foreseen_shear": shear}
        if not step.rests:
            begun |= {"earlier": pressure, "earlier_shear": shear}
        if self._numerics.carried:
            begun["multiplier"] = self.augment({"pressure": foreseen})["multiplier"]
            begun["foreseen_shear"] = step.foreseen(shear, state["earlier_shear"])
        return begun

    def augment(self, state: dict) -> dict:
        """Uzawa update: the multiplier takes over the pressure (paper, eq. update:ALN), a face's mean of it.

        One for each quadrature point would be more than a face has unknowns: some answer to no displacement,
        and runs that carried them ended in folds.
        """
        w, pressure = self.faces.w, state["pressure"]
        mean = (w * pressure).sum(axis=0) / w.sum(axis=0)
        return {**state, "multiplier": np.broadcast_to(mean, pressure.shape)}

    # -- evaluation -----------------------------------------------------------------------------
    def _at(self, near: np.ndarray) -> _Place:
        """The faces ``near`` alone; from one evaluation to the next they are mostly the same."""
        if self._place is None or self._place.near.tobytes() != near.tobytes():
            nq = len(self.faces.w)
            stiffness, stick = (np.tile(k[near], nq) for k in (self._stiffness, self._tangential))
            self._place = _Place(self.faces.some(near), self.dofs[:, near], near, stiffness, stick)
        return self._place

    def _begun(self, kind: np.dtype, p, state: dict, step: Step) -> _Begun:
        """From one evaluation of a step to the next the same."""
        if self._last is None or not self._last.holds(kind, p, state, step):
            # Any of these may carry a complex step.
            given = (step.u_old, step.centre, step.dt, self._stiffness, *state.values(), *vars(p).values())
            whole = np.result_type(float, kind, *given)
            touched, shear = (
                np.ascontiguousarray(state[name], whole) for name in ("touched", "foreseen_shear")
            )
            approach = self._gap.approach(p, touched, step, self.dofs, whole.kind != "c")
            self._last = _Begun((kind, p, state, step), whole, touched, shear, approach)
        return self._last

    def evaluate(self, u, p, state, step):
        dim, (nd, nf), begun = self.dim, self.dofs.shape, self._begun(u.dtype, p, state, step)
        kind, real = begun.kind, begun.kind.kind != "c"
        met = Met(*points_met(u if real else np.asarray(u, kind), *begun.approach))
        vector = np.zeros((nd, nf), kind)
        if met.near.size == 0:
            return Local(vector, None, lambda: self._ended(state, kind))
        place = self._at(met.near)
        g, gradient, H = self._gap.of(*met[:4], p)
        n, dn = (gradient, H) if self._gap.unit_gradient else unit(gradient, H)
        multiplier = state["multiplier"].take(met.near, axis=1).ravel()
        t_N, dp = self._pressure(g, multiplier, place.stiffness, p)
        push, turn = self._inward(u, place) if self._material else (n, ())
        parts, by_rate = np.zeros((0, 0)), np.zeros(0)
        if self.frictions:
            parts, _ = self._strengths.at(place, n, met.slip, p, state, step, False)
        f = place.faces
        slip, stick = met.slip, place.stick
        if not real:
            g, gradient, n, dn, push, t_N, dp, slip, stick, parts, by_rate = (
                np.ascontiguousarray(each, complex)
                for each in (g, gradient, n, dn, push, t_N, dp, slip, stick, parts, by_rate)
            )
        axes, turns = tuple(range(dim)), not self._material
        contact = Contact(axes, met.near, f.N, f.w, g, gradient, n, dn, push, turns, t_N, dp)
        known = begun.shear, begun.touched, np.real(self._numerics.release)
        slides = Sliding(slip, stick, parts, by_rate, kind.type(step.dt), *known)
        pressed(contact, slides, Found.of(vector))

        def slopes() -> np.ndarray:
            matrix, rated = np.zeros((nd, nd, nf)), by_rate
            if self.frictions:
                _, rated = self._strengths.at(place, n, met.slip, p, state, step, True)
            pressed(contact, slides._replace(by_rate=rated), Found.of(np.zeros((nd, nf)), matrix))
            for dt, dN in zip(turn, f.dN, strict=False):
                K = sandwich(dt * (t_N.reshape(f.w.shape) * f.w), f.N[:, :, None] * dN[:, None])
                matrix[:, :, met.near] -= K.reshape(nd, nd, -1)
            return matrix

        return Local(vector, slopes, lambda: self._ended(state, kind, (contact, slides)))

    def _ended(self, state: dict, kind: np.dtype, known: tuple[Contact, Sliding] | None = None) -> dict:
        """The new state, of which all but what is ``known`` is away from the blade."""
        new = {name: np.array(state[name], kind) for name in ("slid", "touched")}
        shape = self.faces.w.shape
        new |= {name: np.zeros(shape, kind) for name in ("pressure", "active")}
        new |= {name: np.zeros((self.dim, *shape), kind) for name in ("normal_traction", "shear")}
        new["shares"] = np.zeros((len(self.frictions), *shape), kind)
        if known is not None:
            pressed(*known, Found.of(**new))
        new = {**state, **new}
        return new if kind.kind != "c" else {k: v.astype(complex, copy=False) for k, v in new.items()}

    def _inward(self, u, place: _Place) -> tuple[np.ndarray, Sequence[np.ndarray]]:
        """The material's normal (dim, N), and its derivative by each tangent of the moved faces."""
        f, U = place.faces, gather(u, place.dofs, self.dim)
        slopes = [f.tangents[s][:, None] + blend(f.dN[s], U) for s in range(self.dim - 1)]
        push, turn = inward(slopes, self._sign[:, place.near])
        return push.reshape(self.dim, -1), turn

    def gap_of_nodes(self, X, u, state, p, step) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap (n,), its gradient (dim, n) and numbers (n,) of the nodes of faces that touch in ``state``.

        ``X`` (dim, nnode): where all nodes are before loading.
        """
        near = np.flatnonzero(state["active"].max(axis=0) > 0)
        all_nodes = self.faces.nodes[:, near]
        nodes, first = np.unique(all_nodes.ravel(), return_index=True)
        x = X[:, all_nodes] + gather(u, component_major(all_nodes, self.dim), self.dim)
        g, gradient, _ = self._gap.at(x, near, p, step.centre)
        return g[first], gradient[:, first], nodes

    # -- results --------------------------------------------------------------------------------
    def force(self, state: dict) -> np.ndarray:
        """Force (dim,) of the material on the blade, per mm of length in 2D."""
        return -((state["normal_traction"] + state["shear"]) * self.faces.w).sum(axis=(1, 2))

    def work(self, u, p, old, new, step):
        # What carried nothing at either end takes up nothing.
        carries = (old["pressure"] != 0) | (new["pressure"] != 0)
        if self.frictions:
            carries = carries | ((old["shear"] != 0) | (new["shear"] != 0)).any(axis=0)
        near, dim = np.flatnonzero(carries.any(axis=0)), self.dim
        N, X, w, dofs = (a.take(near, axis=-1) for a in (self.faces.N, self.faces.X, self.faces.w, self.dofs))
        old, new = ({name: value.take(near, axis=-1) for name, value in s.items()} for s in (old, new))
        slip = blend(N, gather(u - step.u_old, dofs, dim))
        slip = slip - (step.centre - step.centre_old)[:dim, None, None]

        def mean(key):
            return (old[key] + new[key]) / 2

        if self._gap.unit_gradient and not self._material:
            # t_N ∇g·ds is t_N dg. The mean of two tractions does not turn with what slides round the tip
            # within a step, and contact would seem to take energy.
            before, after = (
                self._gap.at(X + blend(N, gather(at, dofs, dim)), near, p, centre)[0].reshape(w.shape)
                for at, centre in ((step.u_old, step.centre_old), (u, step.centre))
            )
            out = {self.tool.name: -float((mean("pressure") * (after - before) * w).sum())}
        else:
            out = {self.tool.name: -float((mean("normal_traction") * slip * w).sum())}
        for i, law in enumerate(self.frictions):
            part = (old["shares"][i] * old["shear"] + new["shares"][i] * new["shear"]) / 2
            out[law.name] = -float((part * slip * w).sum())
        return out


@dataclass(frozen=True)
class _Begun:
    """A step as its evaluations begin: what it was ``made_of``, the ``kind`` of its numbers, Θ and shear."""

    made_of: tuple
    kind: np.dtype
    touched: np.ndarray
    shear: np.ndarray
    approach: Approach

    def holds(self, *made_of) -> bool:
        """States, steps and parameters are never changed in place."""
        return all(map(is_, self.made_of, made_of))


@dataclass(frozen=True)
class _Place:
    """Some of the faces; the stiffnesses (N,) at their points, in MPa/mm."""

    faces: Faces
    dofs: np.ndarray  # (nd, count)
    near: np.ndarray  # (count,) their numbers
    stiffness: np.ndarray
    stick: np.ndarray

    @cached_property
    def X(self) -> np.ndarray:
        """Where their points (dim, N) are before loading."""
        return self.faces.X.reshape(len(self.faces.X), -1)
