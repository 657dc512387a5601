"""Meshes that follow the front: a march goes on from one to the next, with all that its state has.

Small elements are needed where the cut runs. All down the plane they are most of a section's, and of a
run's time. So the section, of a block also that which is drawn out, is meshed anew each time the front has
come a blade thickness further, in a block where it is lowest;
displacements and histories are read off the old mesh at the new one's points, and the blade rests until
forces balance. Elements grow only where larger ones hold the same displacements. What each mechanism has
taken up is in the ledger what it was; what that leaves open stands there as ``transfer``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from cutbench.case.case import Case
from cutbench.forms.space import Space
from cutbench.mechanisms import Bulk
from cutbench.run.build import ORDER, Built, build, geometry_of, space_of
from cutbench.solver.march import Accepted, Progress
from cutbench.solver.problem import QUIET


def lengths(case: Case) -> tuple[float, float]:
    """How far the front goes on one mesh, and elements are small above it and below, mm."""
    n, sizes, tuning = case.numerics, case.sizes, case.numerics.tuning.remesh
    least = tuning.fewest * sizes.h_mm * sizes.detail_mm / case.p.thickness
    return max(tuning.stride * sizes.detail_mm, least), max(n.around * sizes.detail_mm, least)


def follows(case: Case) -> bool:
    """Whether a case's meshes follow its front: built sections, drawn out or not, of displacements alone, and
    in a block of a solid without memory."""
    n = case.numerics
    remembers = any(type(law).start is not Bulk.start for law in case.model.laws("bulk"))
    if n.around == 0 or (case.dim == 3 and (n.layers == 0 or remembers)):
        return False
    stride, around = lengths(case)
    return (
        stride + 2 * around < n.tuning.remesh.worth * case.p.height
        and n.mesh is None
        and n.element != "P2P1"
        and bool(case.model.laws("cut"))
        and not case.model.laws("support")
    )


@dataclass(frozen=True)
class Place:
    """Which mesh: its front is between ``strides`` down and the next; ``kept`` (2, n) is small besides.

    ``asked``: of where a new one was asked for in vain. ``tip``: travel of a blade that had a pre-cut ahead
    when the mesh was made, mm; elements are small from there on, too.
    """

    strides: int = 0
    kept: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)))
    asked: int = -1
    tip: float = np.inf


class RemeshedMarch:
    """The marches of a case, one a mesh. ``built`` and ``place``: the present one."""

    def __init__(self, case: Case, place: Place | None = None):
        self.case, self.follows = case, follows(case)
        self.place = place or self._place(case.p.precut)
        self.built = build(case, self._geometry() if self.follows else None)

    def __iter__(self) -> Iterator[Accepted]:
        return self.steps()

    def steps(
        self, begin: Progress | None = None, renewed: Callable[[Transfer], None] | None = None
    ) -> Iterator[Accepted]:
        """Each accepted step, from ``begin`` on; ``renewed`` is told of each new mesh. Raises Stalled."""
        now, done = begin, False
        while not done:
            if now is not None and self._leaves(now):
                now, transfer = self.renew(now)
                if transfer is not None and renewed is not None:
                    renewed(transfer)
            done = True
            for step in self.built.march.steps(now):
                yield step
                if self._leaves(step.progress):
                    now, done = step.progress, False
                    break

    def _geometry(self):
        stride, around = lengths(self.case)
        first, last = self.place.strides * stride, (self.place.strides + 1) * stride
        # Along the blade the front may still be at the top where it is deep elsewhere.
        above = 0.0 if self.case.dim == 3 else min(first, self.place.tip) - around
        below = self.case.numerics.tuning.remesh.opens * self.case.p.thickness
        fine = (above, max(last + around, below))
        return geometry_of(self.case, fine=fine, kept=self.place.kept)

    def _leaves(self, now: Progress) -> bool:
        if not self.follows:
            return False
        return self._place(self._front(now)).strides not in (self.place.strides, self.place.asked)

    def _place(self, front: float, travel: float = 0.0) -> Place:
        strides = int(front / lengths(self.case)[0])
        return Place(strides, tip=travel if self.case.p.precut > 0 else np.inf)

    def _front(self, now: Progress) -> float:
        height, top = self.built.form("cohesion").faces.X[1].ravel(), self.case.p.height
        return top - float(height[now.states["cohesion"]["damage"] > 0.5].min(initial=top))

    def renew(self, now: Progress) -> tuple[Progress, Transfer | None]:
        """Go to the mesh of the present front: where the march goes on there, and what took it there.

        Where elements of the new mesh would be inside out, or its surface would cross itself, the old one
        serves for another stride.
        """
        old, stayed, tuning = self.built, self.place, self.case.numerics.tuning.remesh
        travel = old.march.motion.travel(now.pseudo_time_mm)
        self.place = self._place(self._front(now), travel)
        # What presses on itself has to fit on the new mesh as it does on the old.
        met = old.problem.self_contact
        misfits = np.zeros((2, 0)) if met is None else met.places(now.u)
        for _ in range(8):
            # A resumed run makes the mesh again from what is kept: nothing is added after it was made.
            self.place = replace(self.place, kept=np.hstack([self.place.kept, misfits]))
            geometry = self._geometry()
            space = space_of(geometry, ORDER[self.case.numerics.element])
            # A block's mesh only grows finer downwards: it holds what the last one held.
            if self.case.dim == 3:
                break
            most = tuning.misfit * self.case.sizes.detail_mm / self.case.p.thickness
            misfits = _misfits(old.space, space, now.u, most)
            if misfits.size == 0:
                break
        new = build(self.case, geometry, space)
        new.problem.timer = old.problem.timer
        transfer = Transfer(old, new)
        then = transfer.progress(now)
        before = old.problem.bulk.smallest_volume_ratio(now.u)
        if not new.problem.sound(then.u, tuning.usable * min(1.0, before)):
            self.place = replace(stayed, asked=self.place.strides)
            return now, None
        self.built = new
        return then, transfer


def _misfits(old: Space, new: Space, u: np.ndarray, most: float) -> np.ndarray:
    """Centres (2, n) of those elements of ``new`` that do not hold the displacements ``u`` of ``old``
    to within ``most`` of their size."""
    volume = new.volume(2 * new.order)
    nodal = u.reshape(-1, old.dim)
    held = np.einsum("qa,ead->qed", volume.phi, (old.probes(new.inside) @ nodal)[volume.nodes.T])
    meant = (old.probes(volume.X.reshape(old.dim, -1)) @ nodal).reshape(held.shape)
    corners = new.mesh.p[:, new.mesh.t]
    size = np.ptp(corners, axis=1).max(axis=0)
    large = np.linalg.norm(held - meant, axis=2).max(axis=0) > most * size
    return corners[..., large].mean(axis=1)


def _stored(built: Built, u: np.ndarray, states: dict[str, dict]) -> Counter[str]:
    """What a state holds of the work taken up, by mechanism, of the meshed part."""
    problem = built.problem
    with QUIET():  # a new mesh may hold the state with elements inside out, and is not taken then
        total: Counter[str] = Counter()
        for form in problem.forms:
            total.update(form.stored(u, problem.p, states[form.name]))
        return total


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
        u, states = self.displacements(now.u), self.states(now.states)
        change = _stored(self.new, u, states)
        change.subtract(_stored(self.old, now.u, now.states))
        change.update(now.added)
        return replace(
            now,
            u=u,
            states=states,
            added=dict(change),
            u_before=None if now.u_before is None else self.displacements(now.u_before),
            control=now.control.settled(),
            past=now.past and now.past | {"u": [self.displacements(u) for u in now.past["u"]]},
        )
