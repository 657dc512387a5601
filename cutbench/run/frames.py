"""Frames of a run: snapshots spread evenly over all of its time, however far it goes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.run.result import Snapshot

#: More than a film of half a minute has.
MAX_FRAMES = 500
#: So many snapshots for a frame are kept while the end is not known: the one that is shown is then no farther
#: from its place than about a quarter of the way to the next.
_SPARE = 4


def checked_frames(count: int | str | None) -> int:
    """How many frames are kept, of a number or its text; 0 for None. Raises BadInput."""
    if count is None:
        return 0
    try:
        found = int(count)
    except (TypeError, ValueError, OverflowError):
        found = 0
    if count not in (found, str(found)) or not 1 <= found <= MAX_FRAMES:
        raise BadInput("frames", count, f"a whole number from 1 to {MAX_FRAMES}")
    return found


class Frames:
    """``count`` frames of a run that ends nobody knows where.

    Of all steps some are kept: where there are too many, the one goes whose neighbours are closest to each
    other. So memory is bounded, and what is left is spread over the time so far.
    """

    def __init__(self, count: int):
        self.count = count
        self.kept: list[Snapshot] = []

    def wants(self, time_s: float) -> bool:
        """Whether a snapshot at ``time_s`` is worth its making: those too close to the last are not."""
        if not self.count:
            return False
        return not self.kept or time_s - self.kept[-1].time_s > time_s / (2 * _SPARE * self.count)

    def add(self, picture: Snapshot) -> None:
        """Keep ``picture``, later than all before."""
        self.kept.append(picture)
        if len(self.kept) > _SPARE * self.count:
            times = np.array([0.0, *(each.time_s for each in self.kept)])
            # Of all but the last, which may be the end.
            self.kept.pop(int(np.argmin(times[2:] - times[:-2])))

    def ended(self, time_s: float, last: Callable[[], Snapshot] | None) -> list[Snapshot]:
        """The frames of a run that has ended at ``time_s``, where ``last`` makes a snapshot: nearest to each
        ``count``-th part of its time. All, where it had fewer steps."""
        if self.count and last is not None and (not self.kept or self.kept[-1].time_s < time_s):
            self.add(last())
        found = len(self.kept)
        if found <= self.count:
            return list(self.kept)
        times, chosen = np.array([each.time_s for each in self.kept]), -1
        picked = []
        for k in range(1, self.count + 1):
            nearest = int(np.argmin(np.abs(times - times[-1] * k / self.count)))
            # Each once, and enough left for those that follow.
            chosen = min(max(nearest, chosen + 1), found - 1 - (self.count - k))
            picked.append(self.kept[chosen])
        return picked
