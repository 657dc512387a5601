"""Fields at a converged step, on nodes and on the faces that the blade touches; and frames, spread evenly
over all of a run's time, however far it goes."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.forms.base import blend, gather
from cutbench.forms.mixed import MixedVolumetric
from cutbench.mechanisms.bulk._isotropic import det
from cutbench.run.build import Built
from cutbench.run.ledger import Ledger
from cutbench.run.observer import Observer
from cutbench.run.remeshing import RemeshedMarch
from cutbench.run.result import SLOPE, Snapshot
from cutbench.run.sensitivity import Following
from cutbench.solver.march import Accepted


def snapshot(built: Built, step: Accepted) -> Snapshot:
    """Displacements and nodal averages of the stresses; contact, damage and opening on the faces."""
    space, p = built.space, built.problem.p
    dim, count = space.dim, space.X.shape[1]
    u = np.zeros((count, 3))
    u[:, :dim] = step.u[: space.ndof].reshape(-1, dim)
    points = np.zeros((count, 3))
    points[:, :dim] = space.X.T
    P, F = _stress(built, step, p)
    sigma = np.einsum("iJn,kJn->ikn", P, F) / det(F)
    data = {
        "displacement": u,
        "piola": _to_nodes(built, P.reshape(9, -1)),
        "cauchy": _to_nodes(built, sigma.reshape(9, -1)),
    }
    deviator = sigma - np.einsum("iin->n", sigma)[None, None] / 3 * np.eye(3)[:, :, None]
    data["von_mises"] = _to_nodes(built, np.sqrt(1.5 * (deviator**2).sum(axis=(0, 1)))[None])[:, 0]
    return Snapshot(
        step.travel,
        points,
        np.ascontiguousarray(space.cells[1].T),
        space.cells[0],
        data,
        {
            name: _face(built, form, step, name, part)
            for form in built.blades
            for name, part in form.faces.parts.items()
        },
    )


class Fields(Observer):
    """Keeps ``snapshots`` of a run, at or past each of the travels ``wanted_mm``, and ``frames``.

    ``newest`` is the snapshot of the last step, where that was one of those travels.
    """

    def __init__(
        self,
        meshes: RemeshedMarch,
        ledger: Ledger,
        wanted_mm: Sequence[float],
        frames: int,
        following: Following | None,
    ):
        self._meshes, self._ledger, self._following = meshes, ledger, following
        self._wanted, self._frames = sorted(wanted_mm), Frames(frames)
        self._last: tuple[Built, Accepted] | None = None
        self.snapshots: list[Snapshot] = []
        self.frames: list[Snapshot] = []
        self.newest: Snapshot | None = None

    def add(self, step: Accepted) -> None:
        if step.between:
            return
        self._last, self.newest = (self._meshes.built, step), None
        marked = bool(self._wanted) and step.travel >= self._wanted[0] * (1 - 1e-9)
        framed = self._frames.wants(self._ledger.last["time_s"])
        if not (marked or framed):
            return
        picture = self._picture()
        if self._following is not None:
            self._add_slopes(picture, self._following)
        if framed:
            self._frames.add(picture)
        if marked:
            self.newest = picture
            self.snapshots.append(picture)
            self._wanted = [travel for travel in self._wanted if travel > step.travel * (1 + 1e-9)]

    def end(self, *, early: bool) -> None:
        """Keep the fields at the end: as a frame, and as a snapshot of a run that ended too ``early``."""
        if self._last is not None and early and self._wanted:
            kept = self.snapshots[-1].displacement_mm if self.snapshots else -math.inf
            if kept < self._last[1].travel:
                self.snapshots.append(self._picture())
        last = None if self._last is None else self._picture
        self.frames = self._frames.ended(self._ledger.last["time_s"], last)

    def state(self) -> dict:
        kept = {"snapshots": self.snapshots, "frames": self._frames.kept}
        return {name: [vars(picture) for picture in pictures] for name, pictures in kept.items()}

    def restore(self, state: dict) -> None:
        self.snapshots = [Snapshot(**picture) for picture in state["snapshots"]]
        if self._frames.count:
            self._frames.kept = [Snapshot(**picture) for picture in state["frames"]]
        self._wanted = [travel for travel in self._wanted if travel > self._ledger.farthest * (1 + 1e-9)]

    def _picture(self) -> Snapshot:
        assert self._last is not None, "there is no picture before the first step"
        picture = snapshot(*self._last)
        picture.time_s = self._ledger.last["time_s"]
        return picture

    def _add_slopes(self, picture: Snapshot, following: Following) -> None:
        """Put du/dθ (n, 3) into ``picture``."""
        space = self._meshes.built.space
        for name, rates in zip(following.names, following.sensitivities.displacements(), strict=False):
            slope = np.zeros((space.X.shape[1], 3))
            slope[:, : space.dim] = rates[: space.ndof].reshape(-1, space.dim)
            picture.point_data[SLOPE + name] = slope


def _stress(built: Built, step: Accepted, p):
    form = built.problem.bulk
    F = form.deformation(step.u)
    P = form.stress(step.u, p, step.states["bulk"])
    for mixed in built.problem.forms:
        if isinstance(mixed, MixedVolumetric):
            P = P + mixed.stress(step.u)
    return P, F


def _to_nodes(built: Built, values: np.ndarray) -> np.ndarray:
    """Volume-weighted element means, averaged over the elements of each node: (n, components)."""
    space, volume = built.space, built.problem.bulk.volume
    nq, ne = volume.w.shape
    weight = volume.w.sum(axis=0)
    integral = (values.reshape(-1, nq, ne) * volume.w).sum(axis=1)
    nodes = space.element_nodes
    count = space.X.shape[1]
    total = np.bincount(nodes.ravel(), np.broadcast_to(weight, nodes.shape).ravel(), count)
    out = [
        np.bincount(nodes.ravel(), np.broadcast_to(row, nodes.shape).ravel(), count) / total
        for row in integral
    ]
    return np.stack(out, axis=1)


def _face(built: Built, form, step: Accepted, name: str, part: slice) -> dict[str, np.ndarray]:
    """What ``form`` has on the faces ``part``, the set called ``name``."""
    f, dim, state = form.faces, form.dim, step.states[form.name]
    count = f.w[:, part].size

    def flat(a):
        out = np.zeros((count, 3))
        out[:, : a.shape[0]] = a[..., part].reshape(a.shape[0], -1).T
        return out

    x = f.X + blend(f.N, gather(step.u, form.dofs, dim))
    out = {
        "X": flat(f.X),
        "x": flat(x),
        "contact_pressure_MPa": state["pressure"][:, part].ravel(),
        "tangential_traction_MPa": flat(state["shear"]),
        "contact_state": state["active"][:, part].ravel(),
        "touched": state["touched"][:, part].ravel(),
    }
    if name == "cut" and "cohesion" in step.states:
        cohesion = built.form("cohesion")
        out["opening_mm"] = cohesion.jump(step.u)[0]
        out["damage"] = step.states["cohesion"]["damage"]
    else:
        out["opening_mm"] = np.zeros(count)
        out["damage"] = np.zeros(count)
    return out


#: More than a film of half a minute has.
MAX_FRAMES = 500
#: So many snapshots for a frame are kept while the end is not known: the one that is shown is then no farther
#: from its place than about a quarter of the way to the next.
_SPARE = 4


def checked_frames(count: int | str | None) -> int:
    """How many frames are kept, of a number or its text; 0 for None. Raises BadInput."""
    if count is None:
        return 0
    number = 0
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        number = int(count)
    if count not in (number, str(number)) or not 1 <= number <= MAX_FRAMES:
        raise BadInput("frames", count, f"a whole number from 1 to {MAX_FRAMES}")
    return number


class Frames:
    """``count`` frames of a run that ends nobody knows where.

    Of all steps some are kept: where there are too many, the one goes whose neighbours are closest to each
    other. So memory is bounded, and what is left is spread over the time so far.
    """

    def __init__(self, count: int):
        self.count = count
        self.kept: list[Snapshot] = []

    def wants(self, time_s: float) -> bool:
        """Whether a snapshot at ``time_s`` is worth its making: those too close to the last are not."""
        if not self.count:
            return False
        return not self.kept or time_s - self.kept[-1].time_s > time_s / (2 * _SPARE * self.count)

    def add(self, picture: Snapshot) -> None:
        """Keep ``picture``, later than all before."""
        self.kept.append(picture)
        if len(self.kept) > _SPARE * self.count:
            times = np.array([0.0, *(each.time_s for each in self.kept)])
            # Of all but the last, which may be the end.
            self.kept.pop(int(np.argmin(times[2:] - times[:-2])))

    def ended(self, time_s: float, last: Callable[[], Snapshot] | None) -> list[Snapshot]:
        """The frames of a run that has ended at ``time_s``, where ``last`` makes a snapshot: nearest to each
        ``count``-th part of its time. All, where it had fewer steps."""
        if self.count and last is not None and (not self.kept or self.kept[-1].time_s < time_s):
            self.add(last())
        total = len(self.kept)
        if total <= self.count:
            return list(self.kept)
        times, chosen, picked = np.array([each.time_s for each in self.kept]), -1, []
        for k in range(1, self.count + 1):
            nearest = int(np.argmin(np.abs(times - times[-1] * k / self.count)))
            # Each once, and enough left for those that follow.
            chosen = min(max(nearest, chosen + 1), total - 1 - (self.count - k))
            picked.append(self.kept[chosen])
        return picked
