"""The surface of a section beside the blade as lines of nodes, and where such a line meets itself.

A line runs from the far end of the top to the cut plane and down that, with the body on its left; straight
between neighbouring nodes, those in the middle of edges among them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise

import numpy as np

from cutbench.base.compiled import compiled
from cutbench.forms.space import Faces

#: So many neighbours are looked at as one first.
BLOCK = 16


def surface_lines(faces: Mapping[str, Faces], X: np.ndarray, wide: float = np.inf) -> list[np.ndarray]:
    """Numbers of the nodes of each line: one a meshed side of the cut plane, none without a top and a cut.

    ``faces`` by name; ``X`` (2, nnode) positions; so far from the plane, ``wide`` mm, the top belongs to it.
    """
    lines = []
    for name, side in (("cut", 1.0), ("cut_minus", -1.0)):
        if not {"top", name} <= faces.keys():
            continue
        # By their faces: where the plane meets the top, each side has a node of its own.
        top, cut = faces["top"].nodes, np.unique(faces[name].nodes)
        top = np.unique(top[:, side * X[0, top].mean(axis=0) > 0])
        cut = cut[np.argsort(-X[1, cut])]
        top = np.setdiff1d(top[np.abs(X[0, top]) < wide], cut)
        line = np.concatenate([top[np.argsort(-np.abs(X[0, top]))], cut])
        lines.append(line if side > 0 else line[::-1])
    return lines


def _plain_near(x, y, reach, width):
    starts, ends, block = _blocks(x.shape[1])
    most = np.maximum.reduceat(reach[:-1], starts)
    # One direction for the whole way.
    middle = x if y is x else (x + y) / 2
    along = middle[:, ends] - middle[:, starts]
    along /= np.maximum(np.sqrt(along[0] * along[0] + along[1] * along[1]), 1e-300)
    low, high, on = _whole(x, starts, along, block, most)
    if y is not x:
        low_too, high_too, on_too = _whole(y, starts, along, block, most)
        low, high, on = np.minimum(low, low_too), np.maximum(high, high_too), on & on_too
    meet = _apart(_boxes(low - most, high + most)[:, :, None], _boxes(low, high)[:, None]) <= 0
    number = np.arange(starts.size)
    meet[number, number] &= ~(on | np.roll(on, 1))
    meet[number[1:], number[:-1]] &= ~on[:-1]
    meet[number[:-1], number[1:]] &= ~on[:-1]
    i, j = np.nonzero(meet)
    if i.size == 0:
        return np.zeros((2, 0), int)
    i, j = np.broadcast_arrays(
        BLOCK * i[:, None, None] + np.arange(BLOCK)[:, None], BLOCK * j[:, None, None] + np.arange(BLOCK)
    )
    there = np.maximum(i, j) < block.size
    i, j = i[there], j[there]
    low, high = np.minimum(x, y), np.maximum(x, y)
    segments = _boxes(np.minimum(low[:, :-1], low[:, 1:]), np.maximum(high[:, :-1], high[:, 1:]))
    first = segments if width else _boxes(low, high)
    meet = _apart(first[:, i], segments[:, j]) <= reach[i]
    return np.stack([i[meet], j[meet]])


@compiled()
def _runs(x, first, last, along):
    """How far each segment from ``first`` to before ``last`` goes ``along`` at least."""
    least = np.inf
    for k in range(first, last):
        least = min(least, (x[0, k + 1] - x[0, k]) * along[0] + (x[1, k + 1] - x[1, k]) * along[1])
    return least


@compiled(_plain_near)
def near(x, y, reach, width):
    """Points (but the last) and segments of the line x (2, n), or of what it sweeps on its way to y, that may
    be nearer than the points' ``reach`` (n,), with a ``width`` of 0; segments and segments, of 1. Pairs
    (2, k) of numbers: a segment has that of its first point.

    Boxes around them meet. Where a line goes on in one direction nobody looks.
    """
    n = x.shape[1] - 1  # segments
    count = (n + BLOCK - 1) // BLOCK
    most, on, along = np.zeros(count), np.ones(count, np.bool_), np.zeros(2)
    # Boxes of segments, and of blocks of them.
    least, largest = np.empty((2, n)), np.empty((2, n))
    low, high = np.full((2, count), np.inf), np.full((2, count), -np.inf)
    for k in range(2):
        for i in range(n):
            least[k, i] = min(min(x[k, i], x[k, i + 1]), min(y[k, i], y[k, i + 1]))
            largest[k, i] = max(max(x[k, i], x[k, i + 1]), max(y[k, i], y[k, i + 1]))
            low[k, i // BLOCK] = min(low[k, i // BLOCK], least[k, i])
            high[k, i // BLOCK] = max(high[k, i // BLOCK], largest[k, i])
    for i in range(n):
        most[i // BLOCK] = max(most[i // BLOCK], reach[i])
    for b in range(count):
        first, last, far = b * BLOCK, min((b + 1) * BLOCK, n), min((b + 2) * BLOCK, n)
        for k in range(2):  # one direction for the whole way
            along[k] = (x[k, far] + y[k, far] - x[k, first] - y[k, first]) / 2
        along /= max(np.sqrt(along[0] ** 2 + along[1] ** 2), 1e-300)
        room = max(most[b], most[(b + 1) % count])
        for z in (x, y):
            on[b] &= _runs(z, first, last, along) > room and _runs(z, last, far, along) > room
    found, size = np.empty((2, 64), np.int64), 0
    for b in range(count):
        for c in range(count):
            if b == c and (on[b] or on[(b - 1) % count]):
                continue
            if abs(b - c) == 1 and on[min(b, c)]:
                continue
            if not (
                low[0, b] - most[b] <= high[0, c]
                and low[0, c] <= high[0, b] + most[b]
                and low[1, b] - most[b] <= high[1, c]
                and low[1, c] <= high[1, b] + most[b]
            ):
                continue
            for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
                if width:
                    left, right, below, above = least[0, i], largest[0, i], least[1, i], largest[1, i]
                else:
                    left, right = min(x[0, i], y[0, i]) - reach[i], max(x[0, i], y[0, i]) + reach[i]
                    below, above = min(x[1, i], y[1, i]) - reach[i], max(x[1, i], y[1, i]) + reach[i]
                if low[0, c] > right or high[0, c] < left or low[1, c] > above or high[1, c] < below:
                    continue
                for j in range(c * BLOCK, min((c + 1) * BLOCK, n)):
                    if (
                        least[0, j] <= right
                        and largest[0, j] >= left
                        and least[1, j] <= above
                        and largest[1, j] >= below
                    ):
                        if size == found.shape[1]:
                            found = np.concatenate((found, np.empty((2, size), np.int64)), axis=1)
                        found[0, size], found[1, size] = i, j
                        size += 1
    return found[:, :size]


@lru_cache(maxsize=8)
def _blocks(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a line of n points: the first of each block, the first of the one after the next, and the block of
    each segment."""
    starts = np.arange(0, n - 1, BLOCK)
    return starts, np.minimum(starts + 2 * BLOCK, n - 1), np.arange(n - 1) // BLOCK


def _whole(x, starts, along, block, least):
    """Boxes around the blocks of a line, and whether all segments of each and the next go on ``along``, by
    ``least``."""
    after = x[:, np.minimum(starts + BLOCK, x.shape[1] - 1)]
    low = np.minimum(np.minimum.reduceat(x, starts, axis=1), after)
    high = np.maximum(np.maximum.reduceat(x, starts, axis=1), after)
    step = x[:, 1:] - x[:, :-1]
    least = np.maximum(least, np.roll(least, -1))
    own = step[0] * along[0][block] + step[1] * along[1][block]
    on = np.minimum.reduceat(own, starts) > least
    before = step[0] * along[0][block - 1] + step[1] * along[1][block - 1]
    on[:-1] &= np.minimum.reduceat(before, starts)[1:] > least[:-1]
    return low, high, on


def _boxes(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(4, n): low ends, and the negative of high ends."""
    return np.concatenate([low, -high])


def _apart(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """How far boxes lie apart along an axis, below 0 where they meet."""
    out = boxes[0] + others[2]
    for k in (1, 2, 3):
        np.maximum(out, boxes[k] + others[k - 2], out=out)
    return out


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def _plain_crossings(x):
    a, b = x[:, :-1], x[:, 1:]
    i, j = (pairs := _plain_near(x, x, np.zeros(x.shape[1]), 1))[:, pairs[0] + 1 < pairs[1]]

    def parted(i, j):
        """Whether the ends of j are on two sides of i."""
        d = b[:, i] - a[:, i]
        return _cross(d, a[:, j] - a[:, i]) * _cross(d, b[:, j] - a[:, i]) < 0

    cross = parted(i, j) & parted(j, i)
    return np.stack([i[cross], j[cross]])


def crossings(x: np.ndarray) -> np.ndarray:
    """Which segments (2, k) of the line through the points x (2, n) cross that are not neighbours."""
    return _crossings(np.ascontiguousarray(x))


@compiled(_plain_crossings)
def _crossings(x):
    pairs = near(x, x, np.zeros(x.shape[1]), np.int64(1))
    cross = np.zeros(pairs.shape[1], np.bool_)
    for k in range(cross.size):
        i, j = pairs[0, k], pairs[1, k]
        if i + 1 < j:
            c, d = x[:, i + 1] - x[:, i], x[:, j + 1] - x[:, j]
            p, q, o = x[:, j] - x[:, i], x[:, j + 1] - x[:, i], x[:, i + 1] - x[:, j]
            one = (c[0] * p[1] - c[1] * p[0]) * (c[0] * q[1] - c[1] * q[0])
            two = (d[1] * p[0] - d[0] * p[1]) * (d[0] * o[1] - d[1] * o[0])
            cross[k] = one < 0 and two < 0
    return pairs[:, cross]


def _plain_room(x, y):
    i, j = (pairs := _plain_near(x, y, np.zeros(x.shape[1]), 0))[
        :, (pairs[0] != pairs[1]) & (pairs[0] != pairs[1] + 1)
    ]
    move = y - x
    p, e = x[:, i] - x[:, j], x[:, j + 1] - x[:, j]
    dp, de = move[:, i] - move[:, j], move[:, j + 1] - move[:, j]
    # In line with the segment at the roots of A t² + B t + C.
    A, B, C = _cross(dp, de), _cross(dp, e) + _cross(p, de), _cross(p, e)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(B + np.where(B < 0, -1.0, 1.0) * np.sqrt(B * B - 4 * A * C)) / 2
        roots = np.stack([q / A, C / q])
        at, long = p[:, None] + roots * dp[:, None], e[:, None] + roots * de[:, None]
        along = (at * long).sum(axis=0) / (long * long).sum(axis=0)
        hit = (roots > 0) & (roots <= 1) & (along >= -1e-9) & (along <= 1 + 1e-9)
    return float(roots[hit].min(initial=np.inf))


@compiled(_plain_room)
def room(x, y):
    """Part of its straight way to y that the line x (2, n) goes before it touches itself; infinite where it
    does not."""
    pairs, least = near(x, y, np.zeros(x.shape[1]), np.int64(0)), np.inf
    for k in range(pairs.shape[1]):
        i, j = pairs[0, k], pairs[1, k]
        if i == j or i == j + 1:
            continue
        p0, p1, e0, e1 = x[0, i] - x[0, j], x[1, i] - x[1, j], x[0, j + 1] - x[0, j], x[1, j + 1] - x[1, j]
        dp0, dp1 = y[0, i] - y[0, j] - p0, y[1, i] - y[1, j] - p1
        de0, de1 = y[0, j + 1] - y[0, j] - e0, y[1, j + 1] - y[1, j] - e1
        # In line with the segment at the roots of A t² + B t + C.
        A, B, C = dp0 * de1 - dp1 * de0, dp0 * e1 - dp1 * e0 + p0 * de1 - p1 * de0, p0 * e1 - p1 * e0
        q = -(B + (-1.0 if B < 0 else 1.0) * np.sqrt(B * B - 4 * A * C)) / 2
        for t in (q / A, C / q):
            if 0 < t <= 1:
                l0, l1 = e0 + t * de0, e1 + t * de1
                along = ((p0 + t * dp0) * l0 + (p1 + t * dp1) * l1) / (l0 * l0 + l1 * l1)
                if -1e-9 <= along <= 1 + 1e-9:
                    least = min(least, t)
    return least


def _plain_meeting(x, reach):
    i, e = _plain_near(x, x, reach, 0)
    apart = (i != e) & (i != e + 1)
    i, e = i[apart], e[apart]
    r, long = x[:, i] - x[:, e], x[:, e + 1] - x[:, e]
    along = (r * long).sum(axis=0) / np.maximum((long * long).sum(axis=0), 1e-300)
    foot = r - np.clip(along, 0, 1) * long
    close = (foot * foot).sum(axis=0) < reach[i] ** 2
    return i[close] * x.shape[1] + e[close]


@compiled(_plain_meeting)
def meeting(x, reach):
    """Which points of the line x (2, n) are nearer than their ``reach`` (n,) to a segment that they are no
    end of: codes (k,), number of the point times n + that of the segment."""
    pairs, n = near(x, x, reach, np.int64(0)), x.shape[1]
    codes, size = np.empty(pairs.shape[1], np.int64), 0
    for k in range(codes.size):
        i, e = pairs[0, k], pairs[1, k]
        if i == e or i == e + 1:
            continue
        r0, r1, l0, l1 = x[0, i] - x[0, e], x[1, i] - x[1, e], x[0, e + 1] - x[0, e], x[1, e + 1] - x[1, e]
        along = min(max((r0 * l0 + r1 * l1) / max(l0 * l0 + l1 * l1, 1e-300), 0.0), 1.0)
        if (r0 - along * l0) ** 2 + (r1 - along * l1) ** 2 < reach[i] ** 2:
            codes[size] = i * n + e
            size += 1
    return codes[:size]


def overlap(x: np.ndarray) -> float:
    """Area that the closed line through the points x (2, n) encloses more than once, or with the body on its
    right."""
    a, b = x, np.roll(x, -1, axis=1)
    i, j = crossings(np.hstack([x, x[:, :1]]))
    # Between two heights at which a segment ends or two cross, nothing does: trapezoids, side by side.
    d, e = b[:, i] - a[:, i], b[:, j] - a[:, j]
    part = ((a[0, j] - a[0, i]) * e[1] - (a[1, j] - a[1, i]) * e[0]) / (d[0] * e[1] - d[1] * e[0])
    heights = np.unique(np.concatenate([x[1], a[1, i] + part * d[1]]))
    total = 0.0
    for low, high in pairwise(heights):
        middle = (low + high) / 2
        at = np.flatnonzero((a[1] > middle) != (b[1] > middle))
        along = (middle - a[1, at]) / (b[1, at] - a[1, at])
        where = a[0, at] + along * (b[0, at] - a[0, at])
        order = np.argsort(where)
        # Upwards the body is on the left: from the right, one turn more.
        around = np.cumsum(np.where(b[1, at] > a[1, at], -1, 1)[order])[:-1]
        gaps = np.diff(where[order])
        total += (high - low) * float(gaps[(around < 0) | (around > 1)].sum())
    return total
