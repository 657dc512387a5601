"""The blade's gap to points of some faces: which can touch it, how far they are, in what direction."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutbench.base.compiled import compiled
from cutbench.base.fused import fused
from cutbench.forms.base import blend, gather
from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP

#: Added to the gap beyond the blade's ends, in its thicknesses.
FAR = 1e6
#: Points farther beside the blade than so many thicknesses cannot touch it within a step.
REACH = 5 / 14


class Lie(NamedTuple):
    """How a blade lies in space, real or complex: cosine and sine of its tilt and its incline, and how much
    higher its edge is in the middle than where it is lowest, mm."""

    c: complex
    s: complex
    ci: complex
    si: complex
    lift: complex

    @classmethod
    def of(cls, p) -> Lie:
        lift = 0.0
        if p.incline != 0:
            lift = np.tan(p.incline) * (p.length / 2 + min(p.overhang, 0.0, key=np.real))
            lift = lift if np.real(lift) >= 0 else -lift
        return cls(np.cos(p.tilt), np.sin(p.tilt), np.cos(p.incline), np.sin(p.incline), lift)

    def up(self, x):
        """Height (…) in the blade's frame, of positions or motions x (3, …), without its lift."""
        return x[1] * self.ci - (x[0] * self.s + x[2] * self.c) * self.si

    @property
    def straight(self) -> bool:
        return self.s == 0 and self.si == 0


#: Of a section, and of a blade that lies along z.
STRAIGHT = Lie(1.0, 0.0, 1.0, 0.0, 0.0)


class Met(NamedTuple):
    """Points of the faces ``near`` (count,) in the tool's frame, N = nq·count in all: the ``foot`` across the
    blade, how far a point is ``over`` its mid-plane, its height ``up``, and its ``slip`` (dim, N) past it."""

    near: np.ndarray
    foot: np.ndarray
    over: np.ndarray
    up: np.ndarray
    slip: np.ndarray


class Approach(NamedTuple):
    """What ``met`` asks of a step besides the displacements: those at its start, the blade's way, where its
    apex ends, how it lies and where it can touch; which faces carry shear, how far they reached before
    loading, their unknowns, shape functions, places and flanks."""

    u_old: np.ndarray
    way: tuple
    apex: np.ndarray
    lie: Lie
    extent: tuple[float, float, float, float]
    held: np.ndarray
    reached: np.ndarray
    dofs: np.ndarray
    N: np.ndarray
    X: np.ndarray
    flank: np.ndarray


def reach(X: np.ndarray, lie: Lie) -> np.ndarray:
    """How far the columns of X (dim, n, faces) reach in the frame of a blade: left, right, down and up
    (4, faces)."""
    across, height = _across(X, lie), X[1] if len(X) == 2 or lie.si == 0 else lie.up(X)
    return np.stack([across.min(axis=0), across.max(axis=0), height.min(axis=0), height.max(axis=0)])


def _met(u, u_old, way, apex, lie, extent, held, reached, dofs, N, X, flank) -> tuple[np.ndarray, ...]:
    """``Met`` of the faces that, moved by ``u``, can touch the blade, where they ``reached`` before loading,
    or are ``held`` (faces,)."""
    dim, real = len(X), Lie(*(each.real for each in lie))
    left, right, low, high = reached + reach(gather(u.real, dofs, dim), real)
    edge = (apex[1].real + real.lift) * real.ci
    least, most, bottom, top = extent
    meets = (left < most) & (right > least) & (high > edge + bottom) & (low < edge + top)
    near = np.flatnonzero(meets | held)
    N, dofs = N[:, :, near], dofs[:, near]
    slip = blend(N, gather(u - u_old, dofs, dim)) - np.array(way)[:, None, None]
    x = X[:, :, near] + blend(N, gather(u, dofs, dim))
    return near, *_in_frame(x, apex, lie, flank[near]), slip.reshape(dim, -1)


@compiled(_met)
def met(u, u_old, way, apex, lie, extent, held, reached, dofs, N, X, flank):
    dim, (_, nq, nf), nn = len(way), X.shape, N.shape[1]  # a tuple's length is known when it is compiled
    c, s, ci, si, lift = lie
    least, most, bottom, top = extent
    edge = (apex[1].real + lift.real) * ci.real
    inclined = dim == 3 and si.real != 0
    near = np.empty(nf, np.int64)
    count = 0
    for f in range(nf):
        left = low = np.inf
        right = high = -np.inf
        for a in range(nn):
            x, y = u[dofs[a, f]].real, u[dofs[nn + a, f]].real
            if dim == 3:
                z = u[dofs[2 * nn + a, f]].real
                if inclined:
                    y = y * ci.real - (x * s.real + z * c.real) * si.real
                x = x * c.real - z * s.real
            left, right = min(left, x), max(right, x)
            low, high = min(low, y), max(high, y)
        beside = reached[0, f] + left < most and reached[1, f] + right > least
        level = reached[3, f] + high > edge + bottom and reached[2, f] + low < edge + top
        if held[f] or (beside and level):
            near[count] = f
            count += 1
    size = nq * count
    foot, over, up = np.empty(size, u.dtype), np.zeros(size, u.dtype), np.empty(size, u.dtype)
    slip = np.empty((dim, size), u.dtype)
    for q in range(nq):
        for j in range(count):
            f, k = near[j], q * count + j
            x = 0.0
            for i in range(dim):
                at, moved = X[i, q, f], -way[i]
                for a in range(nn):
                    dof = dofs[i * nn + a, f]
                    at += N[q, a, f] * u[dof]
                    moved += N[q, a, f] * (u[dof] - u_old[dof])
                slip[i, k] = moved
                if i == 0:
                    x += at * c if dim == 3 else at
                    along = at * s
                elif i == 1:
                    up[k] = at - apex[1]
                else:
                    x -= at * s
                    up[k] = (up[k] - lift) * ci - (along + at * c) * si
            x -= apex[0]
            if x.real * flank[f] < 0:  # there the gap goes on linearly
                over[k], x = x, 0.0
            if np.copysign(1.0, x.real) * flank[f] < 0:  # of zeros
                x = -np.conj(x)
            foot[k] = x
    return near[:count].copy(), foot, over, up, slip


class ToolGap:
    """Gap of ``kind`` (distance or ellipse) to the blade ``tool``."""

    def __init__(self, kind: str, tool, faces: Faces, height: float):
        self._tool, self._kind = tool, kind
        self._law = fused(_continued)
        self._faces, self._dim = faces, faces.X.shape[0]
        #: Whether the gradient has length 1.
        self.unit_gradient = kind == "distance"
        # A face belongs to one flank for good: material pressed across the mid-plane is pushed back to
        # its own side, not out on the other.
        middle = faces.X[0].mean(axis=0)
        on_plane = np.abs(middle) < 1e-9 * height
        self._flank = np.sign(np.where(on_plane, -faces.normal[0], middle))
        self._shape = (*(q.name for q in tool.parameters), *tool.reads)
        self._turned: tuple[Any, np.ndarray] = (None, np.zeros((4, 0)))
        self._extent: tuple[Any, tuple[float, float, float, float]] = (None, (0.0, 0.0, 0.0, 0.0))

    def extent(self, p) -> tuple[float, float, float, float]:
        """From where to where the tool can touch points within a step: across, and up from its edge, mm."""
        shape = [getattr(p, name) for name in self._shape]
        if self._tool.measured or self._extent[0] != shape:
            least, most, top = self._tool.extent(p)
            room = REACH * float(np.real(p.thickness))
            self._extent = shape, (float(least) - room, float(most) + room, -room, float(top) + room)
        return self._extent[1]

    def approach(self, p, touched, step, dofs, real: bool) -> Approach:
        """What ``met`` asks of a step besides the displacements; ``real`` unless anything is complex."""
        dim, faces, kind = self._dim, self._faces, float if real else complex
        moved = (step.centre - step.centre_old)[:dim]
        place = Lie.of(p) if dim == 3 else STRAIGHT
        lie = Lie(*(complex(each) if kind is complex else float(np.real(each)) for each in place))
        u_old, centre = (np.asarray(each, kind) for each in (step.u_old, step.centre))
        held = touched.real.max(axis=0) > 0
        given = u_old, tuple(map(kind, moved)), centre, lie, self.extent(p)
        return Approach(*given, held, self._reached(lie), dofs, faces.N, faces.X, self._flank)

    def _reached(self, lie: Lie) -> np.ndarray:
        """``reach`` of the faces before loading."""
        turned = Lie(*(each.real for each in lie))
        if self._turned[0] != turned:
            self._turned = turned, reach(self._faces.X, turned)
        return self._turned[1]

    def at(self, x: np.ndarray, near: np.ndarray, p, centre):
        """As ``of`` where points of the faces ``near`` now are, x (dim, nq, nf)."""
        lie = Lie.of(p) if self._dim == 3 else STRAIGHT
        return self.of(near, *_in_frame(x, centre, lie, self._flank[near]), p)

    def of(self, near, foot, over, up, p):
        """Gap (N,), gradient (dim, N) and second derivative (dim, dim, N) at points in the tool's frame."""
        dim = self._dim
        g, n, H, further = self._law(self._tool, self._kind, foot, over, up, p)
        bent = np.flatnonzero(further)
        if bent.size and not np.iscomplexobj(over):  # third derivative of the gap, by a complex step
            ahead = fused(_bend_by_height)(self._tool, self._kind, foot[bent], up[bent], p)
            H[1, 1, bent] += over[bent] * ahead
        if not self.unit_gradient:
            # In mm: on the band the paper's number is 2/a times the distance, to first order.
            g, n, H = (p.thickness / 4 * part for part in (g, n, H))
        return (g, n, H) if dim == 2 else self._in_space(near, g, n, H, p)

    def _in_space(self, near, g, n, H, p):
        """The same for a blade that is turned about the height, inclined, and may end inside the block."""
        lie, size = Lie.of(p), g.size
        gradient, second = np.zeros((3, size), dtype=n.dtype), np.zeros((3, 3, size), dtype=n.dtype)
        gradient[:2], second[:2, :2] = n, H
        if not lie.straight:
            c, s, ci, si, _ = lie
            back = np.array([[c, 0 * s, -s], [-s * si, ci, -c * si], [s * ci, si, c * ci]])
            gradient = np.einsum("ji,jk->ik", back, gradient)
            second = np.einsum("ji,jkn,kl->iln", back, second, back)
        if np.real(p.overhang) < 0:
            # Points beyond its ends, as they lay before loading, stay free.
            X = self._faces.X[:, :, near].reshape(3, -1)
            along = X[2] * np.real(lie.c) + X[0] * np.real(lie.s)
            g = np.where(
                np.abs(along) > np.real(p.length) / 2 + np.real(p.overhang), g + FAR * np.real(p.thickness), g
            )
        return g, gradient, second


def _law(tool, kind: str):
    return tool.number if kind == "ellipse" else tool.distance


def _continued(tool, kind: str, foot, over, up, p):
    """Gap, gradient and second derivative, linear beyond the mid-plane, and what the gradient gains there."""
    g, n, H = _law(tool, kind)(foot, up, p)
    further, across = over * H[0, 1], np.where(np.real(over) == 0, H[0, 0], 0)
    second = np.stack([np.stack([across, H[0, 1]]), np.stack([H[1, 0], H[1, 1]])])
    return g + over * n[0], np.stack([n[0], n[1] + further]), second, further


def _bend_by_height(tool, kind: str, x, y, p) -> np.ndarray:
    """Derivative (N,) of the gap's mixed second derivative by the height."""
    return np.imag(_law(tool, kind)(x, y + 1j * STEP, p)[2][0, 1]) / STEP


def _in_frame(x, apex, lie, flank) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``foot``, ``over`` and ``up`` of ``Met`` for points x (dim, nq, nf)."""
    across = _across(x, lie) - apex[0]
    beyond = across.real * flank < 0  # there the gap goes on linearly
    over, foot = np.where(beyond, across, 0), np.where(beyond, 0, across)
    foot.real = np.copysign(foot.real, flank)  # -0.0 is on the left flank
    up = x[1] - apex[1]
    if len(x) == 3 and lie.si != 0:
        up = lie.up((x[0], up - lie.lift, x[2]))
    return foot.ravel(), over.ravel(), up.ravel()


def _across(x: np.ndarray, lie: Lie) -> np.ndarray:
    """Coordinate across a blade that is turned about the height, for positions or motions x (dim, …)."""
    return x[0] if len(x) == 2 or lie.s == 0 else x[0] * lie.c - x[2] * lie.s
