"""``motion`` of a case: times and travels of a blade that holds, returns or changes its speed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cutbench.errors import BadInput
from cutbench.quantities import parse_quantity

Motion = tuple[tuple[float, float], ...]


def read_motion(raw: object) -> Motion:
    """From pairs of a time and a travel with their units, or of numbers in s and mm. Raises BadInput."""
    pairs = isinstance(raw, Sequence) and not isinstance(raw, str)
    if not pairs or not all(isinstance(p, Sequence) and not isinstance(p, str) and len(p) == 2 for p in raw):
        raise BadInput(
            key="motion", value=str(raw)[:60],
            expected="pairs of time and travel, such as [['0 s', '0 mm'], ['9 s', '2 mm'], ['99 s', '2 mm']]",
        )  # fmt: skip
    return tuple((_number(time, "s"), _number(travel, "mm")) for time, travel in raw)


def _number(raw: object, unit: str) -> float:
    return float(raw) if type(raw) in (int, float) else parse_quantity(raw, unit, key="motion")


def simplified(motion: Motion, part: float = 0.005) -> Motion:
    """The corners of a measured ``motion``: what is left out lies on straight lines within ``part`` of the
    largest travel (Ramer, Douglas and Peucker)."""
    times, travels = (np.array(column, dtype=float) for column in zip(*motion, strict=True))
    limit, kept, open_ = part * travels.max(), {0, times.size - 1}, [(0, times.size - 1)]
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        off = np.abs(travels[a : b + 1] - np.interp(times[a : b + 1], times[[a, b]], travels[[a, b]]))
        k = a + int(off.argmax())
        if off[k - a] > limit:
            kept.add(k)
            open_ += [(a, k), (k, b)]
    return tuple((float(times[i]), float(travels[i])) for i in sorted(kept))


def checked_motion(motion: Motion, depth: float) -> Motion:
    """``motion`` if a blade can follow it to no more than ``depth``. Raises BadInput."""
    for i, (time, travel) in enumerate(motion):
        if not (math.isfinite(time) and math.isfinite(travel)):
            raise BadInput(key="motion", value=f"({time}, {travel})", expected="times in s and travels in mm")
        if i == 0 and (time, travel) != (0.0, 0.0):
            raise BadInput(
                key="motion", value=f"({time:g} s, {travel:g} mm)", expected="(0 s, 0 mm) at first"
            )
        if i and time <= motion[i - 1][0]:
            raise BadInput(key="motion", value=f"{time:g} s", expected=f"a time after {motion[i - 1][0]:g} s")
        if not 0 <= travel <= depth * (1 + 1e-9):
            raise BadInput(key="motion", value=f"{travel:g} mm", expected=f"0 to the depth, {depth:g} mm")
    if len(motion) == 1:
        raise BadInput(key="motion", value="one point", expected="two points or more")
    return tuple(motion)
