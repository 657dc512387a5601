"""Measures that a person reads off a curve of force over travel, where nothing else of the cut is known.

``cutbench.run.measures`` asks a run where its front is. A laboratory has the force alone, and literature
often no more than some numbers of it: these.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutbench.run.measures import SETTLED, TAIL, blurred, first_crossing, relative_fall, steady_force

#: Over this part of the blade's thickness the slope of a curve is taken to find the end of indentation.
ALONG = 0.25
#: Indentation ends where the force rises by less than this part of what it rose by at its steepest.
FLATTER = 0.5


@dataclass(frozen=True, eq=False)
class ForceCurve:
    """Force ``F`` (n,) in N over travel ``d`` (n,) in mm, of a blade of ``thickness`` in mm, and what is read
    off it. What a curve does not have is nan."""

    d: np.ndarray
    F: np.ndarray
    thickness: float

    @cached_property
    def onset(self) -> float:
        """The travel at which indentation ends: where the force first rises half as fast as at its steepest
        until then."""
        d, w = self.d, self.thickness
        spacing = ALONG * w / 10
        x = np.arange(d[0], d[-1] + spacing, spacing)
        force = np.interp(x, d, self.F)
        slope = (force[10:] - force[:-10]) / (ALONG * w)
        if slope.size < 2:
            return math.nan
        # Forward from a thickness on: how a blade touches is no end of indentation.
        least = FLATTER * np.maximum.accumulate(slope)
        first = int(np.searchsorted(x[5:-5], d[0] + w))
        return first_crossing(x[5:-5][first:], (least - slope)[first:], 0.0)

    @cached_property
    def begun(self) -> float:
        """The onset, or the end of the travel without one."""
        return float(self.d[-1]) if math.isnan(self.onset) else self.onset

    @property
    def fall(self) -> float:
        """Largest relative fall of the mean force within a thickness of travel at the transition."""
        return relative_fall(self.d, self.F, self.thickness, self.begun, 0.0)

    @property
    def peak(self) -> float:
        """The largest force up to a thickness behind the end of indentation."""
        return float(self.F[self.d <= self.begun + self.thickness].max())

    @cached_property
    def tail(self) -> tuple[float, float]:
        """Mean and slope of the force behind the transition, of the last part of the travel."""
        d, w = self.d, self.thickness
        start = max(d[-1] - TAIL * (d[-1] - d[0]), self.onset + SETTLED * w)
        return (math.nan, math.nan) if not d[-1] - start >= w else steady_force(d, self.F, start, d[-1])

    @property
    def plateau_from(self) -> float:
        """The travel at which the force first is what it is at its plateau."""
        d = self.d
        return first_crossing(*blurred(d, self.F, self.thickness / 2, d[0], d[-1]), self.tail[0])

    @property
    def work(self) -> float:
        """Of the blade, mJ."""
        return float(np.trapezoid(self.F, self.d))


#: By name: unit, what it is, and how it is read off a curve.
READ_OFF: dict[str, tuple[str, str, Callable[[ForceCurve], float]]] = {
    "onset": ("mm", "travel at the end of indentation", lambda c: c.onset),
    "peak": ("N", "largest force of the transition", lambda c: c.peak),
    "drop": ("1", "relative fall of the force within a thickness of travel at the transition",
             lambda c: c.fall),
    "plateau": ("N", "mean force behind the transition", lambda c: c.tail[0]),
    "plateau_from": ("mm", "travel at which the force first is that of the plateau",
                     lambda c: c.plateau_from),
    "slope": ("N/mm", "slope of the force behind the transition", lambda c: c.tail[1]),
    "work": ("mJ", "work of the blade", lambda c: c.work),
    "firmness": ("N", "largest force", lambda c: float(c.F.max())),
    "work_of_shear": ("mJ", "work of the blade", lambda c: c.work),
}  # fmt: skip
