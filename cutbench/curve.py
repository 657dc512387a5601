"""What a force–displacement curve says about the cut: numbers that do not depend on the steps taken.

A curve is read as the polygon through its points. Every measure is the exact value for that
polygon — maxima over the blade's travel are searched where a piecewise linear function can have
them — so that points added along its lines, or taken elsewhere on a smooth curve, change nothing
but the polygon's own error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

#: Unit and meaning of each measure, in the order in which tables show them.
MEASURES: dict[str, tuple[str, str]] = {
    "drop_rel": ("1", "largest relative force drop within one blade thickness of travel, at the transition"),
    "surge": ("1", "largest advance of the cut over one blade thickness of travel, per travel"),
    "onset_mm": ("mm", "blade travel at which the cut has begun"),
    "peak_mm": ("mm", "blade travel at the first prominent force maximum"),
    "peak_N": ("N", "first prominent force maximum"),
    "max_N": ("N", "largest force"),
    "steady_N": ("N", "mean force over the last fifth of the travel"),
    "slope_N_per_mm": ("N/mm", "least-squares slope of the force over the last fifth of the travel"),
    "energy_mJ": ("mJ", "work done by the blade"),
}

ABRUPT, SMOOTH, UNCUT = "abrupt", "smooth", "uncut"

#: The transition lasts from one window before the onset to this many windows after it: what falls
#: later is not the transition but unsteadiness of the cutting that follows.
TRANSITION = 4.0

#: Forces below this part of the largest one are no base for a relative drop, nor a peak.
_FLOOR = 0.05


def measures(
    curve: Mapping[str, np.ndarray],
    *,
    window_mm: float,
    onset_length_mm: float = 0.1,
    prominence: float = 0.05,
    tail: float = 0.2,
) -> dict[str, float]:
    """The measures of ``MEASURES`` for a curve with ``displacement_mm``, ``force_N``, ``cut_length_mm``.

    ``window_mm`` is the travel over which drop and surge are taken (the blade's thickness);
    the cut has begun when it is longer by ``onset_length_mm`` than at the start; a peak counts when
    the force falls by ``prominence`` of it before it rises above it; ``tail`` is the last part of
    the travel that counts as steady. What a curve does not have (a peak, an onset) is nan; without
    an onset there is no transition, so ``drop_rel`` is nan too.

    Raises ValueError for arrays of unequal length, values that are not finite, a blade that runs
    backwards, or a window that is not positive.
    """
    d, F, c = _columns(curve)
    if not window_mm > 0:
        raise ValueError(f"window_mm must be positive, not {window_mm}")
    if d.size < 2 or d[-1] <= d[0]:
        return dict.fromkeys(MEASURES, math.nan)
    onset = _first_crossing(d, c - c[0], onset_length_mm)
    peak_mm, peak_N = _first_peak(d, F, prominence)
    steady, slope = _steady(d, F, d[-1] - tail * (d[-1] - d[0]))
    return {
        "drop_rel": (
            _drop(d, F, window_mm, onset - window_mm, onset + TRANSITION * window_mm)
            if math.isfinite(onset)
            else math.nan
        ),
        "surge": _surge(d, c, window_mm),
        "onset_mm": onset,
        "peak_mm": peak_mm,
        "peak_N": peak_N,
        "max_N": float(F.max()),
        "steady_N": steady,
        "slope_N_per_mm": slope,
        "energy_mJ": float(np.trapezoid(F, d)),
    }


def label(
    drop_rel: float, surge: float = math.nan, *, drop: float = 0.1, surge_min: float | None = None
) -> str:
    """``"abrupt"`` when the force falls by ``drop`` (and the cut surges by ``surge_min``, where one is
    given), else ``"smooth"``; ``"uncut"`` when the cut never began (``drop_rel`` is nan)."""
    if math.isnan(drop_rel):
        return UNCUT
    surges = surge_min is None or surge >= surge_min
    return ABRUPT if drop_rel >= drop and surges else SMOOTH


def _columns(curve: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    d, F, c = (
        np.asarray(curve[name], dtype=float) for name in ("displacement_mm", "force_N", "cut_length_mm")
    )
    if d.ndim != 1 or not d.shape == F.shape == c.shape:
        raise ValueError(f"columns of a curve have one length, not {d.shape}, {F.shape}, {c.shape}")
    if not all(np.isfinite(v).all() for v in (d, F, c)):
        raise ValueError("a curve holds values that are not finite")
    if np.any(np.diff(d) < 0):
        raise ValueError("the blade of a curve only moves forward: displacement_mm must not decrease")
    return d, F, c


def _first_crossing(x: np.ndarray, y: np.ndarray, level: float) -> float:
    """Where the polygon (x, y) first rises to ``level``; nan if it stays below."""
    above = np.flatnonzero(y >= level)
    if above.size == 0:
        return math.nan
    i = int(above[0])
    if i == 0 or y[i] == y[i - 1]:
        return float(x[i])
    return float(x[i - 1] + (level - y[i - 1]) / (y[i] - y[i - 1]) * (x[i] - x[i - 1]))


def _first_peak(d: np.ndarray, F: np.ndarray, prominence: float) -> tuple[float, float]:
    """Place and height of the first maximum from which the force falls by ``prominence`` of it."""
    floor = _FLOOR * F.max()
    best = 0
    for i in range(F.size):
        if F[i] > F[best]:
            best = i
        elif F[best] > max(floor, 0.0) and F[i] < (1 - prominence) * F[best]:
            return float(d[best]), float(F[best])
    return math.nan, math.nan


def _steady(d: np.ndarray, F: np.ndarray, start: float) -> tuple[float, float]:
    """Mean and least-squares slope of the polygon from ``start`` on, by exact integrals.

    On each straight piece F·(d − mean) is quadratic, for which Simpson's rule is exact.
    """
    keep = d > start
    x = np.concatenate([[start], d[keep]])
    y = np.concatenate([[np.interp(start, d, F)], F[keep]])
    length = x[-1] - x[0]
    mean = float(np.trapezoid(y, x) / length)
    s = x - (x[0] + x[-1]) / 2
    mid = (s[1:] + s[:-1]) / 2 * (y[1:] + y[:-1]) / 2
    moment = float(np.sum(np.diff(x) / 6 * (s[:-1] * y[:-1] + 4 * mid + s[1:] * y[1:])))
    return mean, moment / (length**3 / 12)


def _drop(d: np.ndarray, F: np.ndarray, window: float, start: float, stop: float) -> float:
    """max over start ≤ x ≤ stop of (F(x) − min F over [x, x + window]) / F(x).

    Each candidate for the minimum is a point of the polygon or the window's end, and the ratio of
    two linear functions is monotone: the maximum lies where x or x + window meets a point, or at
    ``start`` or ``stop``. Two points at one travel (a jump) are taken in their order.
    """
    floor = _FLOOR * F.max()
    start, stop = max(start, d[0]), min(stop, d[-1])
    moved = d - window
    moved = np.append(moved[(moved > start) & (moved < stop)], [start, stop])
    points = np.flatnonzero((d >= start) & (d <= stop))
    x = np.concatenate([d[points], moved])
    at = np.concatenate([F[points], np.interp(moved, d, F)])
    first = np.concatenate([points, np.searchsorted(d, moved, side="left")])
    last = np.searchsorted(d, x + window, side="right")
    # Beyond the last point np.interp holds its value: a window cut off by the end of the travel.
    end = np.interp(x + window, d, F)
    worst = 0.0
    for here, i, j, there in zip(at, first, last, end, strict=True):
        if here <= 0 or here < floor:
            continue
        low = min(there, F[i:j].min()) if j > i else there
        worst = max(worst, (here - low) / here)
    return float(worst)


def _surge(d: np.ndarray, c: np.ndarray, window: float) -> float:
    """max over x of (c(x + window) − c(x)) / window, over windows that lie within the travel."""
    window = min(window, d[-1] - d[0])
    x = np.concatenate([d, d - window])
    x = x[(x >= d[0]) & (x <= d[-1] - window)]
    ahead = np.interp(x + window, d, c) - np.interp(x, d, c)
    # Around a jump np.interp sees one side only: compare the points themselves as well.
    i = np.searchsorted(d, d + window, side="right") - 1
    return float(max(ahead.max(initial=0.0), (c[i] - c).max()) / window)
