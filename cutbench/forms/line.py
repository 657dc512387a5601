"""The surface of a section beside the blade as lines of nodes, and where such a line meets itself.

A line runs from the far end of the top to the cut plane and down that, with the body on its left; straight
between neighbouring nodes, those in the middle of edges among them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise

import numpy as np

from cutbench.forms.space import Faces

#: Pairs (2, n) of numbers of segments or points of a line. A segment has the number of its first point.
Pairs = np.ndarray
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


def near(x: np.ndarray, y: np.ndarray, reach: np.ndarray | float = 0.0, points: bool = True) -> Pairs:
    """Points (but the last) and segments of the line x (2, n), or of what it sweeps on its way to y, that may
    be nearer than the points' ``reach`` (n,). Or segments and segments.

    Boxes around them meet. Where a line goes on in one direction nobody looks.
    """
    starts, ends, block = _blocks(x.shape[1])
    reach = np.broadcast_to(reach, x.shape[1])
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
    first = _boxes(low - reach, high + reach) if points else segments
    meet = _apart(first[:, i], segments[:, j]) <= 0
    return np.stack([i[meet], j[meet]])


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


def crossings(x: np.ndarray) -> Pairs:
    """Which segments of the line through the points x (2, n) cross that are not neighbours."""
    a, b = x[:, :-1], x[:, 1:]
    i, j = (pairs := near(x, x, points=False))[:, pairs[0] + 1 < pairs[1]]

    def parted(i, j):
        """Whether the ends of j are on two sides of i."""
        d = b[:, i] - a[:, i]
        p, q = (end[:, j] - a[:, i] for end in (a, b))
        return (d[0] * p[1] - d[1] * p[0]) * (d[0] * q[1] - d[1] * q[0]) < 0

    if i.size == 0:
        return pairs[:, :0]
    cross = parted(i, j) & parted(j, i)
    return np.stack([i[cross], j[cross]])


def room(x: np.ndarray, y: np.ndarray) -> float:
    """Part of its straight way to y that the line x (2, n) goes before it touches itself; infinite where it
    does not."""
    i, j = (pairs := near(x, y))[:, (pairs[0] != pairs[1]) & (pairs[0] != pairs[1] + 1)]
    if i.size == 0:
        return np.inf
    move = y - x
    p, e = x[:, i] - x[:, j], x[:, j + 1] - x[:, j]
    dp, de = move[:, i] - move[:, j], move[:, j + 1] - move[:, j]

    def cross(a, b):
        return a[0] * b[1] - a[1] * b[0]

    # In line with the segment at the roots of A t² + B t + C.
    A, B, C = cross(dp, de), cross(dp, e) + cross(p, de), cross(p, e)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(B + np.where(B < 0, -1.0, 1.0) * np.sqrt(B * B - 4 * A * C)) / 2
        roots = np.stack([q / A, C / q])
        at, long = p[:, None] + roots * dp[:, None], e[:, None] + roots * de[:, None]
        along = (at * long).sum(axis=0) / (long * long).sum(axis=0)
        hit = (roots > 0) & (roots <= 1) & (along >= -1e-9) & (along <= 1 + 1e-9)
    return float(roots[hit].min(initial=np.inf))


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
