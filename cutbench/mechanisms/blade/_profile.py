"""Profiles of straight lines and arcs that go over into one another: signed distances in closed form.

A flank is a chain of pieces from the apex upwards, each of one curvature κ, 0 for a line, above 0 where the
tool bulges. It is described, and asked, as the right one; the left one is mirrored. The direction goes on
from piece to piece, so the distance has a continuous gradient; its second derivative jumps where κ does.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cutbench.base.compiled import choose, compiled, shared
from cutbench.mechanisms.base import Params
from cutbench.mechanisms.blade._rigid import Rigid

#: Points of a piece in an outline.
DRAWN = 40
#: In place of an infinite length, in units of the others.
ENDLESS = 1e6


class Flank(NamedTuple):
    """By piece (k,): where it begins, mm, the angle of its direction, its curvature in 1/mm, its length."""

    x: np.ndarray
    y: np.ndarray
    angle: np.ndarray
    bend: np.ndarray
    length: np.ndarray

    def along(self, k, s):
        """Points (2, n) of the pieces ``k`` at lengths ``s``."""
        u, w = _forward(self.bend[k], s)
        c, sn = np.cos(self.angle[k]), np.sin(self.angle[k])
        return np.stack([self.x[k] + c * u - sn * w, self.y[k] + sn * u + c * w])

    def outline(self) -> np.ndarray:
        """Points (n, 2) from the apex to where the band begins, or to the end."""
        pieces = [k for k, length in enumerate(np.real(self.length)) if np.isfinite(length)]
        part = np.linspace(0, 1, DRAWN)
        lines = [np.real(self.along(np.full(DRAWN, k), part * self.length[k])).T for k in pieces]
        return np.vstack([lines[0], *(line[1:] for line in lines[1:])])


@lru_cache(maxsize=64)
def flank(*pieces: tuple) -> Flank:
    """From curvature and length of each piece; the first one begins at the apex, level."""
    bend, length = (np.array(column) for column in zip(*pieces, strict=True))
    x, y, angle = [0.0], [0.0], [0.0]
    for k, s in zip(bend[:-1], length[:-1], strict=True):
        u, w = _forward(k, s)
        c, sn = np.cos(angle[-1]), np.sin(angle[-1])
        x.append(x[-1] + c * u - sn * w)
        y.append(y[-1] + sn * u + c * w)
        angle.append(angle[-1] + k * s)
    return Flank(np.array(x), np.array(y), np.array(angle), bend, length)


def _forward(bend, s):
    """Where an arc is after a length ``s``, along its first direction and to the left of it."""
    turn = bend * s
    bent = np.real(turn) ** 2 > 1e-16
    k = np.where(bent, bend, 1.0)
    return np.where(bent, np.sin(k * s) / k, s), np.where(bent, (1 - np.cos(k * s)) / k, turn * s / 2)


@shared
def _apart(u, w, past, bend, first, last):
    """Squared distance from a piece that turns by 180 degrees at the most, of points u along and w to the
    left of where it begins, ``past`` along its last direction beyond its end; ``first``, ``last``: from its
    ends."""
    size = np.sqrt((bend * u) ** 2 + (1 - bend * w) ** 2)
    g = (bend * (u * u + w * w) - 2 * w) / (size + 1)
    return choose((u >= 0) & (past <= 0), g * g, np.minimum(first, last))


@shared
def _beside(u, w, c, sn, bend, size):
    """Distance, gradient and second derivative by the direction across it, for points beside a piece of
    direction (c, sn). ``size``: from its centre, in radii; so one formula holds for arcs and lines, without
    their difference of large numbers."""
    g = (bend * (u * u + w * w) - 2 * w) / (size + 1)
    across, up = bend * u / size, (bend * w - 1) / size
    return g, c * across - sn * up, sn * across + c * up, bend / size


def _ends(chain: Flank) -> np.ndarray:
    """Of each piece (8, k): where it begins, cosine and sine of its direction there; the same of its end."""
    real = Flank(*map(np.real, chain))
    length = np.minimum(real.length, ENDLESS * real.length[np.isfinite(real.length)].sum())
    last = real.angle + real.bend * length
    end = real.along(np.arange(length.size), length)
    first = real.x, real.y, np.cos(real.angle), np.sin(real.angle)
    return np.stack([*first, *end, np.cos(last), np.sin(last)])


def _signed(chain: Flank, ends: np.ndarray, x: np.ndarray, y: np.ndarray):
    real_x, real_y = np.real(x), np.real(y)
    x0, y0, c, sn, x1, y1, c1, sn1 = ends[:, :, None]
    fx, fy, lx, ly = real_x - x0, real_y - y0, real_x - x1, real_y - y1
    bend, from_ends = np.real(chain.bend)[:, None], (fx * fx + fy * fy, lx * lx + ly * ly)
    apart = _apart(c * fx + sn * fy, c * fy - sn * fx, c1 * lx + sn1 * ly, bend, *from_ends)
    x0, y0, angle, bend, _ = (part[np.argmin(apart, axis=0)] for part in chain)
    c, sn = np.cos(angle), np.sin(angle)
    u, w = c * (x - x0) + sn * (y - y0), c * (y - y0) - sn * (x - x0)
    size = (bend * u) ** 2 + (1 - bend * w) ** 2
    g, nx, ny, rate = _beside(u, w, c, sn, bend, np.sqrt(np.where(np.real(size) > 1e-24, size, 1e-24)))
    n, q = np.stack([nx, ny]), np.stack([-ny, nx])
    return g, n, rate * q[:, None] * q[None]


@compiled(_signed)
def _signed_loops(chain, ends, x, y):
    bend, count = chain[3], x.size
    g, n, H = np.empty(count), np.empty((2, count)), np.empty((2, 2, count))
    for i in range(count):
        least, best, u, w = np.inf, 0, 0.0, 0.0
        for k in range(bend.size):
            fx, fy, lx, ly = x[i] - ends[0, k], y[i] - ends[1, k], x[i] - ends[4, k], y[i] - ends[5, k]
            along, aside = ends[2, k] * fx + ends[3, k] * fy, ends[2, k] * fy - ends[3, k] * fx
            past = ends[6, k] * lx + ends[7, k] * ly
            apart = _apart(along, aside, past, bend[k], fx * fx + fy * fy, lx * lx + ly * ly)
            if apart < least or k == 0:
                least, best, u, w = apart, k, along, aside
        b = bend[best]
        size = np.sqrt(max((b * u) ** 2 + (1 - b * w) ** 2, 1e-24))
        g[i], nx, ny, rate = _beside(u, w, ends[2, best], ends[3, best], b, size)
        n[0, i], n[1, i] = nx, ny
        H[0, 0, i], H[1, 1, i] = rate * ny * ny, rate * nx * nx
        H[0, 1, i] = H[1, 0, i] = -rate * nx * ny
    return g, n, H


def signed(chain: Flank, x: np.ndarray, y: np.ndarray):
    """Distance, gradient and second derivative for points beside a right flank, complex ones too."""
    loops = _signed if np.result_type(x, y, *chain).kind == "c" else _signed_loops
    return loops(chain, _ends(chain), x, y)


class Profiled(Rigid):
    """A rigid tool whose flanks are chains of lines and arcs."""

    def flanks(self, p: Params) -> tuple[Flank, Flank]:
        """The right flank and the left one, mirrored; the same object where they are alike."""
        raise NotImplementedError(self.name)

    def alike(self, p):
        right, left = self.flanks(p)
        return right is left

    def distance(self, x, y, p):
        right, left = self.flanks(p)
        on_left = np.signbit(np.real(x))
        side = np.where(on_left, -1.0, 1.0)
        if right is left:
            g, n, H = signed(right, side * x, y)
        else:
            kind = np.result_type(x, y, *right, *left)
            g, n, H = np.empty(x.size, kind), np.empty((2, x.size), kind), np.empty((2, 2, x.size), kind)
            for chain, here in ((right, ~on_left), (left, on_left)):
                g[here], n[:, here], H[:, :, here] = signed(chain, (side * x)[here], y[here])
        n[0], H[0, 1], H[1, 0] = side * n[0], side * H[0, 1], side * H[1, 0]
        return g, n, H

    def outline(self, p):
        right, left = (each.outline() for each in self.flanks(p))
        return np.vstack([left[:0:-1] * [-1.0, 1.0], right])

    def edge_radius(self, p):
        return p.edge_radius

    def edge_for(self, p, radius):
        return radius

    def height(self, p):
        return max(each.outline()[-1, 1] for each in self.flanks(p))
