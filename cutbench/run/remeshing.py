"""Meshes that follow the front: a march goes on from one to the next, with all that its state has.

Small elements are needed where the cut runs. All down the plane they are most of a section's, and of a
run's time. So the section is meshed anew each time the front has come ``STRIDE`` blade thicknesses further;
displacements and histories are read off the old mesh at the new one's points, and the blade rests until
forces balance. Elements grow only where larger ones hold the same displacements. What that changes of the
stored energy shows in the ledger's closure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from cutbench.case.case import Case
from cutbench.forms.space import Space
from cutbench.run.build import ORDER, Built, build, geometry_of
from cutbench.solver.march import Accepted, Progress
from cutbench.solver.predictor.window import front_depth

#: The front goes so far on one mesh, in blade thicknesses; and in elements of the plane, at least. So many
#: are small above it and below, too.
STRIDE, FEWEST = 1.0, 8
#: Where more than this part of the height had small elements, one mesh serves.
WORTH = 0.5
#: What displacements within an element may differ by on a new mesh, in units of its size; where they do more,
#: elements stay small. So many times that is looked at.
MISFIT, LOOKS = 0.02, 8
#: Part of the smallest volume ratio that a new mesh has to keep.
USABLE = 0.25


def lengths(case: Case) -> tuple[float, float]:
    """How far the front goes on one mesh, and elements are small above it and below, mm."""
    n, thickness = case.numerics, case.p.thickness
    return max(STRIDE * thickness, FEWEST * n.h_mm), max(n.around * thickness, FEWEST * n.h_mm)


def follows(case: Case) -> bool:
    """Whether a case's meshes follow its front: built ones of two dimensions, of displacements alone."""
    n = case.numerics
    if case.dim == 3 or n.around == 0:
        return False
    stride, around = lengths(case)
    return (
        stride + 2 * around < WORTH * case.p.height
        and n.mesh is None
        and n.element != "P2P1"
        and n.predictor != "repeat"
        and bool(case.model.laws("cut"))
        and not case.model.laws("support")
    )


class RemeshedMarch:
    """The marches of a case, one a mesh; iterate to get each accepted step. ``built``: the present one."""

    def __init__(self, case: Case):
        self.case, self.follows = case, follows(case)
        #: The front is between so many strides down and the next; and what is small besides (2, n).
        self.place, self.kept = 0, np.zeros((2, 0))
        #: Where a new mesh has been asked for in vain.
        self._asked = -1
        self.built = self._build() if self.follows else build(case)
        #: Told of each new mesh before the march goes on there.
        self.renewed: Callable[[Transfer], None] | None = None

    def __iter__(self) -> Iterator[Accepted]:
        while True:
            march = self.built.march
            yield from march
            if march.left is None:
                return
            self._renew(march.left)

    def state(self) -> dict:
        """What ``restore`` needs to make the present mesh again."""
        return {"place": self.place, "kept": self.kept}

    def restore(self, state: dict) -> None:
        """Go to another mesh before the march begins."""
        self.place, self.kept = int(state["place"]), np.asarray(state["kept"])
        if self.follows:
            self.built = self._build()

    def _geometry(self):
        stride, around = lengths(self.case)
        fine = (self.place * stride - around, (self.place + 1) * stride + around)
        return geometry_of(self.case, fine=fine, kept=self.kept)

    def _build(self, geometry=None, space=None) -> Built:
        built = build(self.case, geometry or self._geometry(), space)
        built.march.leaves = lambda now: self._place_of(now.states) not in (self.place, self._asked)
        return built

    def _place_of(self, states: dict) -> int:
        height = self.built.form("cohesion").faces.X[1].ravel()
        return int(front_depth(height, self.case.p.height, states) / lengths(self.case)[0])

    def _renew(self, now: Progress) -> None:
        old, stayed = self.built, (self.place, self.kept)
        self.place, misfits = self._place_of(now.states), np.zeros((2, 0))
        self.kept = misfits
        for _ in range(LOOKS):
            # A resumed run makes the mesh again from what is kept: nothing is added after it was made.
            self.kept = np.hstack([self.kept, misfits])
            geometry = self._geometry()
            space = Space.build(geometry.mesh, ORDER[self.case.numerics.element])
            misfits = _misfits(old.space, space, now.u)
            if misfits.size == 0:
                break
        new = self._build(geometry, space)
        new.problem.timer = old.problem.timer
        new.march.failures, new.march.between_steps = old.march.failures, old.march.between_steps
        transfer = Transfer(old, new)
        new.march.resume = transfer.progress(now)
        before, after = (b.form("bulk").smallest_volume_ratio(u) for b, u in
                         ((old, now.u), (new, new.march.resume.u)))  # fmt: skip
        if after < USABLE * min(1.0, before):
            # Elements of the new mesh would be inside out: the old one serves for another stride.
            self.place, self.kept = stayed
            self._asked = self._place_of(now.states)
            old.march.resume, old.march.left = now, None
            return
        self.built = new
        if self.renewed is not None:
            self.renewed(transfer)


def _misfits(old: Space, new: Space, u: np.ndarray) -> np.ndarray:
    """Centres (2, n) of those elements of ``new`` that do not hold the displacements ``u`` of ``old``."""
    volume = new.volume(2 * new.order)
    nodal = u.reshape(-1, old.dim)
    held = np.einsum("qa,ead->qed", volume.phi, (old.probes(new.inside) @ nodal)[volume.nodes.T])
    meant = (old.probes(volume.X.reshape(old.dim, -1)) @ nodal).reshape(held.shape)
    corners = new.mesh.p[:, new.mesh.t]
    size = np.ptp(corners, axis=1).max(axis=0)
    large = np.linalg.norm(held - meant, axis=2).max(axis=0) > MISFIT * size
    return corners[..., large].mean(axis=1)


@dataclass(frozen=True)
class Transfer:
    """What a state on the mesh of ``old`` is on that of ``new``: linear, so it takes derivatives too."""

    old: Built
    new: Built

    @cached_property
    def _down(self) -> sp.csr_matrix:
        space = self.new.space
        return sp.kron(self.old.space.probes(space.inside), sp.identity(space.dim), format="csr")

    def displacements(self, u: np.ndarray) -> np.ndarray:
        """(ndof,) of the new space from those of the old, as the old elements have them at the new nodes."""
        u = self._down @ u
        u[self.new.problem.fixed] = 0.0
        return u

    def states(self, states: dict[str, dict]) -> dict[str, dict]:
        """By form, at the new points. Of ``states`` some may be missing."""
        old, p = self.old, self.new.problem.p
        forms = [form for form in self.new.problem.forms if form.name in states]
        return {form.name: form.carried(old.form(form.name), states[form.name], p) for form in forms}

    def progress(self, now: Progress) -> Progress:
        """With the blade at rest until forces balance; what the last step did then goes on."""
        before = None if now.u_before is None else self.displacements(now.u_before)
        past = now.past and now.past | {"u": np.array([self.displacements(u) for u in now.past["u"]])}
        pace = dict(now.pace)
        if pace["damping_factor"] == 1 and not pace["rests"]:
            pace |= {"rests": True, "vain": 0, "settles": True}
        return replace(
            now,
            u=self.displacements(now.u),
            states=self.states(now.states),
            u_before=before,
            pace=pace,
            past=past,
        )
