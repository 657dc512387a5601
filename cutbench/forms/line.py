"""The surface of a section beside the blade as lines of nodes, and where such a line meets itself.

A line runs from the far end of the top to the cut plane and down that, with the body on its left; straight
between neighbouring nodes, those in the middle of edges among them.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from cutbench.forms.space import Faces

#: So many neighbours are looked at as one first.
BLOCK = 16
#: Pairs (2, n) of numbers of segments, which begin at the points of the same numbers.
Pairs = np.ndarray


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


def meeting(boxes: np.ndarray, others: np.ndarray) -> Pairs:
    """Numbers (2, k) of those ``boxes`` (4, n) and ``others`` that meet: their low ends, and the negative of
    their high ends. Neighbours in a set are neighbours in space."""
    whole, wholes = (
        np.minimum.reduceat(each, np.arange(0, each.shape[1], BLOCK), axis=1) for each in (boxes, others)
    )
    i, j = (
        BLOCK * numbers[:, None, None]
        for numbers in np.nonzero(_apart(whole[:, :, None], wholes[:, None]) <= 0)
    )
    i, j = np.broadcast_arrays(i + np.arange(BLOCK)[:, None], j + np.arange(BLOCK))
    there = (i < boxes.shape[1]) & (j < others.shape[1])
    i, j = i[there], j[there]
    meet = _apart(boxes[:, i], others[:, j]) <= 0
    return np.stack([i[meet], j[meet]])


def _apart(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """How far boxes lie apart along an axis, below 0 where they meet."""
    out = boxes[0] + others[2]
    for k in (1, 2, 3):
        np.maximum(out, boxes[k] + others[k - 2], out=out)
    return out


def crossings(x: np.ndarray) -> Pairs:
    """Which segments of the line through the points x (2, n) cross that are not neighbours."""
    a, b = x[:, :-1], x[:, 1:]
    boxes = np.concatenate([np.minimum(a, b), np.minimum(-a, -b)])
    i, j = (pairs := meeting(boxes, boxes))[:, pairs[0] + 1 < pairs[1]]

    def parted(i, j):
        """Whether the ends of j are on two sides of i."""
        d = b[:, i] - a[:, i]
        p, q = (end[:, j] - a[:, i] for end in (a, b))
        return (d[0] * p[1] - d[1] * p[0]) * (d[0] * q[1] - d[1] * q[0]) < 0

    cross = parted(i, j) & parted(j, i)
    return np.stack([i[cross], j[cross]])


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
