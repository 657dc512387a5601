"""Measures that a person reads off a curve of force over travel, where nothing else of the cut is known.

``cutbench.run.measures`` asks a run where its front is. A laboratory has the force alone, and literature
often no more than some numbers of it: these.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cutbench.run.measures import SETTLED, TAIL, blurred, first_crossing, relative_fall, steady_force

#: Over this part of the blade's thickness the slope of a curve is taken to find the end of indentation.
ALONG = 0.25
#: Indentation ends where the force rises by less than this part of what it rose by at its steepest.
FLATTER = 0.5


def onset_mm(d: np.ndarray, F: np.ndarray, thickness_mm: float) -> float:
    """The travel at which indentation ends: where the force first rises half as fast as at its steepest until
    then; nan where it never does."""
    spacing = ALONG * thickness_mm / 10
    x = np.arange(d[0], d[-1] + spacing, spacing)
    force = np.interp(x, d, F)
    slope = (force[10:] - force[:-10]) / (ALONG * thickness_mm)
    if slope.size < 2:
        return math.nan
    # Forward from a thickness on: how a blade touches is no end of indentation.
    least = FLATTER * np.maximum.accumulate(slope)
    first = int(np.searchsorted(x[5:-5], d[0] + thickness_mm))
    return first_crossing(x[5:-5][first:], (least - slope)[first:], 0.0)


def _fall(d: np.ndarray, F: np.ndarray, w: float) -> float:
    """Largest relative fall of the mean force within a thickness of travel at the transition."""
    onset = onset_mm(d, F, w)
    return relative_fall(d, F, w, d[-1] if math.isnan(onset) else onset, 0.0)


def _peak(d: np.ndarray, F: np.ndarray, w: float) -> float:
    """The largest force up to a thickness behind the end of indentation."""
    onset = onset_mm(d, F, w)
    return float(F[d <= (d[-1] if math.isnan(onset) else onset + w)].max())


def _tail(d: np.ndarray, F: np.ndarray, w: float) -> tuple[float, float]:
    """Mean and slope of the force behind the transition, of the last part of the travel; nan where it ends
    before."""
    onset = onset_mm(d, F, w)
    start = max(d[-1] - TAIL * (d[-1] - d[0]), onset + SETTLED * w)
    return (math.nan, math.nan) if not d[-1] - start >= w else steady_force(d, F, start, d[-1])


def _work(d: np.ndarray, F: np.ndarray, w: float) -> float:
    return float(np.trapezoid(F, d))


def _plateau_from(d: np.ndarray, F: np.ndarray, w: float) -> float:
    """The travel at which the force first is what it is at its plateau."""
    return first_crossing(*blurred(d, F, w / 2, d[0], d[-1]), _tail(d, F, w)[0])


#: By name: unit, what it is, and how it is read off travel (n,) in mm, force (n,) in N and the thickness.
READ_OFF: dict[str, tuple[str, str, Callable[[np.ndarray, np.ndarray, float], float]]] = {
    "onset": ("mm", "travel at the end of indentation", onset_mm),
    "peak": ("N", "largest force of the transition", _peak),
    "drop": ("1", "relative fall of the force within a thickness of travel at the transition", _fall),
    "plateau": ("N", "mean force behind the transition", lambda d, F, w: _tail(d, F, w)[0]),
    "plateau_from": ("mm", "travel at which the force first is that of the plateau", _plateau_from),
    "slope": ("N/mm", "slope of the force behind the transition", lambda d, F, w: _tail(d, F, w)[1]),
    "work": ("mJ", "work of the blade", _work),
    "firmness": ("N", "largest force", lambda d, F, w: float(F.max())),
    "work_of_shear": ("mJ", "work of the blade", _work),
}
