"""The blade's section: an elliptic tip (semi-axes a, b) under a band of half-thickness a.

Gap, normal and second derivative of the gap at points given relative to the ellipse's centre, with
y pointing up: the tip is at (0, −b), the band is above y = 0. Two gaps: the exact signed distance
in mm, and the paper's dimensionless (x−c)ᵀA(x−c) − 1 (its eq. gap_function with the sign turned),
which is not a distance. Both are positive outside.
"""

from __future__ import annotations

import numpy as np

from cutbench.base.symbols import iterated

#: Steps to a foot at the most; digits double, so what follows one of this size is below rounding.
STEPS, ROUNDING = 60, 1e-9


def _foot(x, y, a, b):
    """Parameter t of the closest point (a²x/(t+a²), b²y/(t+b²)) on the ellipse, for x ≥ 0, real numbers.

    Newton's method for 1/√F = 1 with F = (ax/(t+a²))² + (by/(t+b²))², which is concave and nearly straight
    (for a circle it is): from the left it climbs to the root and cannot overshoot.
    """
    ax, by, smallest = a * x, b * y, np.minimum(a, b) ** 2

    def climb(t):
        u, v = ax / (t + a * a), by / (t + b * b)
        u2, v2 = u * u, v * v
        F = u2 + v2
        step = F * (np.sqrt(F) - 1) / (u2 / (t + a * a) + v2 / (t + b * b))
        return t + step, np.abs(step) < ROUNDING * (t + step + smallest)

    # Left of the root the function is >= 0; the margin keeps the first denominator from vanishing.
    start = np.maximum(np.maximum(ax - a * a, -by - b * b), -smallest * (1 - 1e-9))
    return iterated(climb, start, STEPS)


def _off_the_axes(x, y, a, b):
    """Deep inside and on an axis of the ellipse two feet are equally near: a nudge chooses one.

    Without it x = 0 finds the foot at the tip, however far, or none at all.
    """
    deep = np.maximum(a * np.real(x) - a * a, -b * np.real(y) - b * b) < -(np.minimum(a, b) ** 2) * (1 - 1e-6)
    x = x + np.where(deep, np.maximum(1e-6 * a - np.real(x), 0), 0)
    y = y - np.where(deep, np.maximum(1e-6 * b + np.real(y), 0), 0)
    return x, y


def distance(x: np.ndarray, y: np.ndarray, a, b) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signed distance g (N,), its gradient (2, N) and its second derivative (2, 2, N).

    Accepts complex x, y, a, b for a complex step: the real root is found first and then one Newton
    step in complex numbers carries the derivative exactly.
    """
    side = np.where(np.signbit(np.real(x)), -1.0, 1.0)
    tip, half, length = np.real(y) < 0, np.real(a), np.real(b)
    # Beside the band the tip is asked for the distance of its apex, which does not count.
    xt, yt = _off_the_axes(np.where(tip, side * x, 0.0), np.where(tip, y, -length), half, length)
    t = _foot(np.real(xt), np.real(yt), half, length)
    u, v = a * xt / (t + a * a), b * yt / (t + b * b)
    t = t + (u * u + v * v - 1) / (2 * (u * u / (t + a * a) + v * v / (t + b * b)))
    fx, fy = a * a * xt / (t + a * a), b * b * yt / (t + b * b)
    nx, ny = fx / (a * a), fy / (b * b)
    size = np.sqrt(nx * nx + ny * ny)
    nx, ny, curvature = nx / size, ny / size, 1 / (a * a * b * b * size * size * size)
    g = (xt - fx) * nx + (yt - fy) * ny
    bend = np.where(tip, curvature / (1 + curvature * g), 0.0)
    n = np.stack([side * np.where(tip, nx, 1.0), np.where(tip, ny, 0.0)])
    across = np.stack([-n[1], n[0]])
    return np.where(tip, g, side * x - a), n, bend * across[:, None] * across[None]


def ellipse(x: np.ndarray, y: np.ndarray, a, b) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The paper's dimensionless gap, its gradient (1/mm) and its second derivative (1/mm²)."""
    tip = np.real(y) < 0
    below = np.where(tip, y, 0)
    g = (x / a) ** 2 + (below / b) ** 2 - 1
    none = 0 * g
    bend = [[none + 2 / a**2, none], [none, np.where(tip, none + 2 / b**2, 0)]]
    return g, np.stack([2 * x / a**2, 2 * below / b**2]), np.stack([np.stack(row) for row in bend])
