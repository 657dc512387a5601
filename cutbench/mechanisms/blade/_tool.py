"""The blade's section: an elliptic tip (semi-axes a, b) under a band of half-thickness a.

Gap, normal and second derivative of the gap at points given relative to the ellipse's centre, with
y pointing up: the tip is at (0, −b), the band is above y = 0. Two gaps: the exact signed distance
in mm, and the paper's dimensionless (x−c)ᵀA(x−c) − 1 (its eq. gap_function with the sign turned),
which is not a distance. Both are positive outside.
"""

from __future__ import annotations

import numpy as np


def _foot(x: np.ndarray, y: np.ndarray, a: float, b: float) -> np.ndarray:
    """Parameter t of the closest point (a²x/(t+a²), b²y/(t+b²)) on the ellipse, for x ≥ 0.

    Newton's method for 1/√F = 1 with F = (ax/(t+a²))² + (by/(t+b²))², which is concave and nearly straight
    (for a circle it is): from the left it climbs to the root and cannot overshoot.
    """
    ax, by = a * x, b * y
    t = np.maximum(ax - a * a, -by - b * b)
    # Left of the root the function is >= 0; the margin keeps the first denominator from vanishing.
    smallest = min(a, b) ** 2
    t = np.maximum(t, -smallest * (1 - 1e-9))
    for _ in range(60):
        u, v = ax / (t + a * a), by / (t + b * b)
        u2, v2 = u * u, v * v
        F = u2 + v2
        step = F * (np.sqrt(F) - 1) / (u2 / (t + a * a) + v2 / (t + b * b))
        t = t + step
        # Digits double: what a further step would change is below rounding.
        if (np.abs(step) < 1e-9 * (t + smallest)).all():
            break
    return t


def _off_the_axes(x, y, a: float, b: float):
    """Deep inside and on an axis of the ellipse two feet are equally near: a nudge chooses one.

    Without it x = 0 finds the foot at the tip, however far, or none at all.
    """
    deep = np.maximum(a * np.real(x) - a * a, -b * np.real(y) - b * b) < -(min(a, b) ** 2) * (1 - 1e-6)
    x = x + np.where(deep, np.maximum(1e-6 * a - np.real(x), 0), 0)
    y = y - np.where(deep, np.maximum(1e-6 * b + np.real(y), 0), 0)
    return x, y


def distance(x: np.ndarray, y: np.ndarray, a, b) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signed distance g (N,), its gradient (2, N) and its second derivative (2, 2, N).

    Accepts complex x, y, a, b for a complex step: the real root is found first and then one Newton
    step in complex numbers carries the derivative exactly.
    """
    kind = np.result_type(x, y, type(a), type(b), float)
    side = np.where(np.signbit(np.real(x)), -1.0, 1.0)
    g = np.array(side * x - a, dtype=kind)
    n = np.zeros((2, g.size), dtype=kind)
    n[0] = side
    H = np.zeros((2, 2, g.size), dtype=kind)
    tip = np.real(y) < 0
    if not tip.any():
        return g, n, H
    xt, yt = x[tip], y[tip]
    side = side[tip]
    xt, yt = _off_the_axes(xt * side, yt, float(np.real(a)), float(np.real(b)))
    t = _foot(np.real(xt), np.real(yt), float(np.real(a)), float(np.real(b)))
    if np.issubdtype(kind, np.complexfloating):
        u, v = a * xt / (t + a * a), b * yt / (t + b * b)
        t = t + (u * u + v * v - 1) / (2 * (u * u / (t + a * a) + v * v / (t + b * b)))
    fx, fy = a * a * xt / (t + a * a), b * b * yt / (t + b * b)
    nx, ny = fx / (a * a), fy / (b * b)
    size = np.sqrt(nx * nx + ny * ny)
    curvature = 1 / (a * a * b * b * size**3)
    nx, ny = nx / size, ny / size
    gt = (xt - fx) * nx + (yt - fy) * ny
    bend = curvature / (1 + curvature * gt)
    g[tip], n[0, tip], n[1, tip] = gt, side * nx, ny
    H[0, 0, tip], H[1, 1, tip] = bend * ny * ny, bend * nx * nx
    H[0, 1, tip] = H[1, 0, tip] = -bend * side * nx * ny
    return g, n, H


def ellipse(x: np.ndarray, y: np.ndarray, a, b) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The paper's dimensionless gap, its gradient (1/mm) and its second derivative (1/mm²)."""
    kind = np.result_type(x, y, type(a), type(b), float)
    n = np.zeros((2, x.size), dtype=kind)
    H = np.zeros((2, 2, x.size), dtype=kind)
    below = np.where(np.real(y) < 0, y, 0)
    g = (x / a) ** 2 + (below / b) ** 2 - 1
    n[0], n[1] = 2 * x / a**2, 2 * below / b**2
    H[0, 0], H[1, 1] = 2 / a**2, np.where(np.real(y) < 0, 2 / b**2, 0)
    return g, n, H
