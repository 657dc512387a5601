"""Where the runs of a study lie: the order of a grid; a Sobol sequence."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from cutbench.maps.axes import Axis


def coarse_to_fine(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Flat indices of a grid so that each is as far as can be from all before it, the middle first.

    Distances are relative to the axes' lengths; ties go to the lower index, so the order is fixed.
    """
    index = np.stack(np.unravel_index(np.arange(math.prod(shape)), shape), axis=1).astype(float)
    place = index / np.maximum(np.array(shape) - 1, 1)
    order = [int(np.argmin(((place - 0.5) ** 2).sum(axis=1).round(9)))]
    gap = np.full(len(place), np.inf)
    for _ in range(len(place) - 1):
        gap = np.minimum(gap, ((place - place[order[-1]]) ** 2).sum(axis=1).round(9))
        gap[order[-1]] = -1.0  # taken
        order.append(int(np.argmax(gap)))
    return tuple(order)


def sobol(axes: Sequence[Axis], points: int, seed: int) -> tuple[tuple[float, ...], ...]:
    """``points`` places of a scrambled Sobol sequence (Sobol 1967; Owen 1998): more points keep those before.

    An axis of levels has each of them about equally often.
    """
    rows = qmc.Sobol(len(axes), seed=seed).random_base2(math.ceil(math.log2(points)))[:points]
    return tuple(
        tuple(
            axis.value(float(place)) if axis.continuous else axis.values[int(place * len(axis.values))]
            for axis, place in zip(axes, row, strict=True)
        )
        for row in rows
    )
