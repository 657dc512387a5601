"""Directions in which a blade pushes: along the tool's normal or the material's.

The tool's is that of the obstacle: frictionless contact then has a potential. The material's,
n = F⁻ᵀN/|F⁻ᵀN|, is the paper's. On smooth surfaces under a hard blade both are one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def unit(n: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal and its derivative for a gap whose gradient may not have length 1."""
    size = np.sqrt((n * n).sum(axis=0))
    e = n / size
    He = np.einsum("ik...,k...->i...", H, e)
    return e, (H - e[:, None] * He[None]) / size


def inward(slopes: Sequence[np.ndarray], sign: np.ndarray):
    """Inward material normal (dim, q, f) to the tangents ``slopes`` of the moved faces, and its derivative by
    each of them (dim, dim, q, f)."""
    c = cross(slopes) * sign
    size = np.sqrt((c * c).sum(axis=0))
    n = c / size
    scale = sign / size
    turn = []
    for dc in _cross_slopes(slopes):
        along = (n[:, None] * dc).sum(axis=0)
        turn.append(scale * (n[:, None] * along[None] - dc))
    return -n, turn


def cross(tangents: Sequence[np.ndarray]) -> np.ndarray:
    """A normal (dim, q, f) to one (2D) or two (3D) tangents, not of unit length."""
    if len(tangents) == 1:
        return np.stack([tangents[0][1], -tangents[0][0]])
    a, b = tangents
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _cross_slopes(tangents: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Derivative of ``cross`` by each tangent, (dim, dim, q, f) or broadcast to it."""
    if len(tangents) == 1:
        return [np.array([[0.0, 1.0], [-1.0, 0.0]])[:, :, None, None]]
    a, b = tangents
    return [-_skew(b), _skew(a)]


def _skew(a: np.ndarray) -> np.ndarray:
    """The matrix (3, 3, …) of the cross product a × ·."""
    o = np.zeros_like(a[0])
    return np.stack([np.stack([o, -a[2], a[1]]), np.stack([a[2], o, -a[0]]), np.stack([-a[1], a[0], o])])
