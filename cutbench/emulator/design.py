"""Where to compute: space filling first, then where the answer is least known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from cutbench.base.units import Parameter


@dataclass(frozen=True)
class Side:
    """A side of a box: a parameter between two values, internal units. Above 0 it is divided by ratios."""

    quantity: Parameter
    low: float
    high: float

    @property
    def name(self) -> str:
        """The parameter's."""
        return self.quantity.name

    def at(self, part: np.ndarray) -> np.ndarray:
        """Values at parts of the way from the one end to the other."""
        if self.low > 0:
            return self.low * (self.high / self.low) ** part
        return self.low + part * (self.high - self.low)


def space_filling(box: Sequence[Side], count: int, first: int = 0) -> list[dict[str, float]]:
    """Values that fill a box.

    Parameters
    ----------
    box : sequence of Side
        The sides.
    count : int
        How many places.
    first : int
        Number of the first: a design goes on where an earlier one has ended.

    Returns
    -------
    list of dict
        By parameter, of each place. They are Sobol's numbers, scrambled, always the same.
    """
    if not box:
        return [{} for _ in range(count)]
    made = qmc.Sobol(len(box), seed=0)
    if first:
        made.fast_forward(first)
    parts = made.random(count)
    values = np.stack([side.at(parts[:, k]) for k, side in enumerate(box)], axis=1)
    return [dict(zip([side.name for side in box], map(float, row), strict=True)) for row in values]


def around(values: Mapping[str, float], box: Sequence[Side], part: float) -> list[Side]:
    """A smaller box about ``values``, ``part`` as long along each side, within the other."""
    made = []
    for side in box:
        half = part / 2
        if side.low > 0:
            where = np.log(values[side.name] / side.low) / np.log(side.high / side.low)
        else:
            where = (values[side.name] - side.low) / (side.high - side.low)
        low, high = (float(side.at(np.array(np.clip(where + s * half, 0.0, 1.0)))) for s in (-1, 1))
        made.append(Side(side.quantity, low, high))
    return made
