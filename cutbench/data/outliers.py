"""Readings that no machine makes: a travel or a time that jumps, as where a decimal point was lost.

A jump is a step many times as large as those before it, which go one way: what rests, as before the step of a
relaxation, has no pace to be measured against. It is refused where it ends a power of ten from where the
readings were going, at a pace so many times theirs, or where the next are back; another step that stays may
be the test's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.ndimage import median_filter

from cutbench.base.errors import BadInput

#: A step of so many times those before it, and those around it, is looked at.
OUTLIER_STEPS = 15.0
#: Readings that say how fast it goes, and that may lie off before the rest is back.
BEFORE, OFF = 5, 3
#: Of readings that go one way, the steps sum up to this part of their sizes' sum.
MONOTONE_FRACTION = 0.7
#: Steps by which a reading may miss where it should be.
RETURN_STEPS = 3.0
#: By which a decimal point is lost, or a sign between thousands is taken for one.
POWERS_OF_TEN = np.array([10.0, 100.0, 1e3, 1e4, 1e-1, 1e-2, 1e-3])


def check_steps(read: Mapping[str, np.ndarray], files: Sequence[str], lines: np.ndarray) -> None:
    """Raise BadInput for the first recorded travel or time of ``read`` (n,) that lies far from where those
    before it go, with its place in ``files`` and ``lines`` (n,)."""
    for role in ("displacement", "stretch", "strain", "time"):
        if role not in read or read[role].size < 2 * BEFORE:
            continue
        for at, times, goes in _jumps(read[role], read.get("time") if role != "time" else None):
            # A time that runs back is another fault, and a last one may be late.
            if role != "time" or (read[role][at] > goes and at < read[role].size - 1):
                expected = (
                    f"about {goes:.6g}, where the readings before it go: this is {times:.2g} of their steps."
                    " Was a decimal point lost, or is a sign between thousands taken for one?"
                )
                value = f"{read[role][at]:.6g}"
                raise BadInput(file=files[at], line=int(lines[at]), key=role, value=value, expected=expected)


def _jumps(x: np.ndarray, time: np.ndarray | None) -> Iterator[tuple[int, float, float]]:
    """Readings that jump, by how many steps, and where they should be, seen from those before or behind."""
    steps = np.abs(np.diff(x))
    if time is not None and np.all(np.diff(time) > 0):
        # Where readings are farther apart in time, they are in travel too.
        steps = np.minimum(steps, steps * np.median(np.diff(time)) / np.diff(time))
    usual = median_filter(steps, 2 * BEFORE + 1, mode="mirror")
    wide = (steps > OUTLIER_STEPS * usual) & (usual > 0)
    for way in (1, -1):
        z, size = x[::way], steps[::way]
        for j in map(int, np.flatnonzero(wide[::way])):
            before = np.diff(z[max(j - BEFORE, 0) : j + 1])
            step = float(before.mean()) if before.size > 1 else 0.0
            if (
                abs(before.sum()) < MONOTONE_FRACTION * np.abs(before).sum()
                or size[j] <= OUTLIER_STEPS * abs(step)
                or step == 0
            ):
                continue
            goes, near, later = z[j] + step, RETURN_STEPS * abs(step), z[j + 2 : j + 2 + OFF]
            back = np.abs(later - z[j]) < near * np.arange(2, 2 + later.size)
            pace = (
                abs(z[j + 2] - z[j + 1]) / abs(step) / POWERS_OF_TEN
                if later.size
                else np.ones(POWERS_OF_TEN.size)
            )
            shifted = (
                (np.abs(z[j + 1] / POWERS_OF_TEN - goes) < near)
                & (pace < RETURN_STEPS)
                & (pace > 1 / RETURN_STEPS)
            )
            shifted &= (abs(goes) > RETURN_STEPS * near) & (way > 0)
            if shifted.any() or back.any():
                yield j + 1 if way > 0 else x.size - 2 - j, size[j] / abs(step), goes
