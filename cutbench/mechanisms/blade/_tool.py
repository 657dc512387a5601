"""The blade's section: an elliptic tip (semi-axes a, b) under a band of half-thickness a.

Gap, normal and second derivative of the gap at points given relative to the ellipse's centre, with
y pointing up: the tip is at (0, −b), the band is above y = 0. Two gaps: the exact signed distance
in mm, and the paper's dimensionless (x−c)ᵀA(x−c) − 1 (its eq. gap_function with the sign turned),
which is not a distance. Both are positive outside.
"""

from __future__ import annotations

import numpy as np

from cutbench.base.compiled import choose, compiled, shared

#: Steps to a foot at the most; digits double, so what follows one of this size is below rounding.
STEPS, ROUNDING = 60, 1e-9


@shared
def _climb(t, ax, by, a, b):
    """A Newton step towards the parameter t of the closest point (a²x/(t+a²), b²y/(t+b²)), for x ≥ 0.

    It is for 1/√F = 1 with F = (ax/(t+a²))² + (by/(t+b²))², which is concave and nearly straight (for a
    circle it is): from the left it climbs to the root and cannot overshoot.
    """
    u, v = ax / (t + a * a), by / (t + b * b)
    u2, v2 = u * u, v * v
    F = u2 + v2
    return F * (np.sqrt(F) - 1) / (u2 / (t + a * a) + v2 / (t + b * b))


@shared
def _left(ax, by, a, b):
    """Where to begin: left of the root, by a margin that keeps the first denominator from vanishing."""
    return np.maximum(np.maximum(ax - a * a, -by - b * b), -(min(a, b) ** 2) * (1 - 1e-9))


@shared
def _off_the_axes(x, y, a, b):
    """Deep inside and on an axis of the ellipse two feet are equally near: a nudge chooses one.

    Without it x = 0 finds the foot at the tip, however far, or none at all.
    """
    deep = np.maximum(a * x.real - a * a, -b * y.real - b * b) < -(min(a, b) ** 2) * (1 - 1e-6)
    x = x + choose(deep, np.maximum(1e-6 * a - x.real, 0.0), 0.0)
    y = y - choose(deep, np.maximum(1e-6 * b + y.real, 0.0), 0.0)
    return x, y


@shared
def _from_foot(x, y, t, a, b):
    """Distance, unit normal and curvature there, of points whose foot is at t, for x ≥ 0."""
    fx, fy = a * a * x / (t + a * a), b * b * y / (t + b * b)
    nx, ny = fx / (a * a), fy / (b * b)
    size = np.sqrt(nx * nx + ny * ny)
    curvature = 1 / (a * a * b * b * size * size * size)
    nx, ny = nx / size, ny / size
    g = (x - fx) * nx + (y - fy) * ny
    return g, nx, ny, curvature / (1 + curvature * g)


def _distance(x, y, a, b):
    """As ``distance``: the real root is found first, and then one Newton step in complex numbers carries the
    derivative exactly."""
    kind = np.result_type(x, y, type(a), type(b), float)
    side = np.where(np.signbit(np.real(x)), -1.0, 1.0)
    g = np.array(side * x - a, dtype=kind)
    n = np.zeros((2, g.size), dtype=kind)
    n[0] = side
    H = np.zeros((2, 2, g.size), dtype=kind)
    tip = np.real(y) < 0
    if not tip.any():
        return g, n, H
    side, half, length = side[tip], float(np.real(a)), float(np.real(b))
    xt, yt = _off_the_axes(x[tip] * side, y[tip], half, length)
    ax, by = half * xt.real, length * yt.real
    t = _left(ax, by, half, length)
    for _ in range(STEPS):
        step = _climb(t, ax, by, half, length)
        t = t + step
        if (np.abs(step) < ROUNDING * (t + min(half, length) ** 2)).all():
            break
    if np.issubdtype(kind, np.complexfloating):
        u, v = a * xt / (t + a * a), b * yt / (t + b * b)
        t = t + (u * u + v * v - 1) / (2 * (u * u / (t + a * a) + v * v / (t + b * b)))
    gt, nx, ny, bend = _from_foot(xt, yt, t, a, b)
    g[tip], n[0, tip], n[1, tip] = gt, side * nx, ny
    H[0, 0, tip], H[1, 1, tip] = bend * ny * ny, bend * nx * nx
    H[0, 1, tip] = H[1, 0, tip] = -bend * side * nx * ny
    return g, n, H


@compiled(_distance)
def _distances(x, y, a, b):
    g, n, H = np.empty(x.size), np.zeros((2, x.size)), np.zeros((2, 2, x.size))
    for i in range(x.size):
        side = -1.0 if np.signbit(x[i]) else 1.0
        g[i], n[0, i] = side * x[i] - a, side
        if not y[i] < 0:
            continue
        xt, yt = _off_the_axes(x[i] * side, y[i], a, b)
        ax, by = a * xt, b * yt
        t = _left(ax, by, a, b)
        for _ in range(STEPS):
            step = _climb(t, ax, by, a, b)
            t = t + step
            if np.abs(step) < ROUNDING * (t + min(a, b) ** 2):
                break
        g[i], nx, ny, bend = _from_foot(xt, yt, t, a, b)
        n[0, i], n[1, i] = side * nx, ny
        H[0, 0, i], H[1, 1, i] = bend * ny * ny, bend * nx * nx
        H[0, 1, i] = H[1, 0, i] = -bend * side * nx * ny
    return g, n, H


def distance(x: np.ndarray, y: np.ndarray, a, b) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signed distance g (N,), its gradient (2, N) and its second derivative (2, 2, N).

    Accepts complex x, y, a, b for a complex step.
    """
    if x.dtype.kind == "c" or y.dtype.kind == "c" or isinstance(a + b, complex):
        return _distance(x, y, a, b)
    return _distances(np.ascontiguousarray(x, float), np.ascontiguousarray(y, float), float(a), float(b))


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
