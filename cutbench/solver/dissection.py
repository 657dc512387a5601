"""A graph of unknowns in parts that meet in a border alone (nested dissection)."""

from __future__ import annotations

from itertools import permutations
from operator import itemgetter

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order

#: Unknowns below which there is nothing to part, and of a part, that one on the border costs as much as.
SMALL, BORDER = 1_000, 5
#: Ends of a graph by the distances from which it is halved.
ENDS = 4


def dissected(met: sp.csr_matrix, which: np.ndarray, parts: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """The unknowns ``which`` of a graph as a border, and as many parts that meet in it alone: a power of two,
    or fewer where no border is small."""
    whole = which[:0], [which]
    if parts < 2 or which.size < SMALL:
        return whole
    graph = met if which.size == met.shape[0] else met[which][:, which]
    ends = [_distances(graph, 0)]
    while len(ends) < ENDS:
        ends.append(_distances(graph, int(np.min(ends, axis=0).argmax())))
    # By whether one end is nearer or another, then by a third.
    orders = (one - other + third / which.size for one, other, third in permutations(ends, 3))
    cost, border, *halves = min((_halved(graph, order) for order in orders), key=itemgetter(0))
    if cost >= which.size:
        return whole
    begun, ended = (dissected(met, which[half], parts // 2) for half in halves)
    return np.concatenate([which[border], begun[0], ended[0]]), [*begun[1], *ended[1]]


def _halved(graph: sp.csr_matrix, order: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """What it costs to factorize, a border, and the halves that meet in it."""
    side = order <= np.median(order)
    border = side & (graph @ ~side)
    halves = side & ~border, ~side
    return max(half.sum() for half in halves) + BORDER * border.sum(), border, *halves


def _distances(graph: sp.csr_matrix, start: int) -> np.ndarray:
    """Of all unknowns, in steps from one; those that it does not reach are as far as it is."""
    (order, before), far = breadth_first_order(graph, start), np.zeros(graph.shape[0], int).tolist()
    for one, last in zip(order[1:].tolist(), before[order[1:]].tolist(), strict=True):
        far[one] = far[last] + 1
    return np.array(far)
