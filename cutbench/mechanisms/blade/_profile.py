"""Profiles of straight lines and arcs that go over into one another: signed distances in closed form.

A flank is a chain of pieces from the apex upwards, each of one curvature κ, 0 for a line, above 0 where the
tool bulges. It is described, and asked, as the right one; the left one is mirrored. The direction goes on
from piece to piece, so the distance has a continuous gradient; its second derivative jumps where κ does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cutbench.mechanisms.base import Params
from cutbench.mechanisms.blade._rigid import Rigid

#: Points of a piece in an outline.
DRAWN = 40


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


def _feet(chain: Flank, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The piece (n,) that is nearest to each point, real numbers."""
    x0, y0, angle, bend, length = (np.real(part)[:, None] for part in chain)
    c, sn = np.cos(angle), np.sin(angle)
    u, w = c * (x - x0) + sn * (y - y0), c * (y - y0) - sn * (x - x0)
    bent = bend != 0
    k, half = np.where(bent, bend, 1.0), bend * np.where(bent, length, 0.0) / 2
    turned = np.arctan2(k * u, 1 - k * w)
    s = np.where(bent, (half + np.angle(np.exp(1j * (turned - half)))) / k, u)
    s = np.clip(s, 0, length)
    along, aside = _forward(bend, s)
    return np.argmin((u - along) ** 2 + (w - aside) ** 2, axis=0)


def signed(chain: Flank, x: np.ndarray, y: np.ndarray):
    """Distance, gradient and second derivative for points beside a right flank, complex ones too."""
    k = _feet(chain, np.real(x), np.real(y))
    x0, y0, angle, bend, _ = (part[k] for part in chain)
    c, sn = np.cos(angle), np.sin(angle)
    u, w = c * (x - x0) + sn * (y - y0), c * (y - y0) - sn * (x - x0)
    # From the centre, in radii; one formula for arcs and lines, without their difference of large numbers.
    size = (bend * u) ** 2 + (1 - bend * w) ** 2
    size = np.sqrt(np.where(np.real(size) > 1e-24, size, 1e-24))
    g = (bend * (u * u + w * w) - 2 * w) / (size + 1)
    across, up = bend * u / size, (bend * w - 1) / size
    n = np.stack([c * across - sn * up, sn * across + c * up])
    q = np.stack([-n[1], n[0]])
    return g, n, bend / size * q[:, None] * q[None]


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
