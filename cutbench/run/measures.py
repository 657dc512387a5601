"""What a force–displacement curve says about the cut: numbers that do not depend on the steps taken.

A curve is read as the polygon through its points, and every measure is taken from that polygon
itself, so that points added along its lines, or taken elsewhere on a smooth curve, change nothing
but the polygon's own error. A run says where its front is; a laboratory has the force alone, and literature
often no more than some numbers of it: what is read off those is in ``READ_OFF``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cutbench.case.values import CLAMP

#: Unit and meaning of each measure, in the order in which tables show them.
MEASURES: dict[str, tuple[str, str]] = {
    "drop_rel": ("1", "relative fall of the mean force within a blade thickness of travel at the transition"),
    "surge": ("1", "largest advance of the cut over one blade thickness of travel, per travel"),
    "front_speed": ("1", "largest speed of the front at the transition, over that of the blade"),
    "onset_mm": ("mm", "blade travel at which the cut has begun"),
    "peak_mm": ("mm", "blade travel at the first prominent force maximum"),
    "peak_N": ("N", "first prominent force maximum"),
    "max_N": ("N", "largest force"),
    "steady_N": ("N", "mean force where the cut advances with the blade, behind the transition"),
    "slope_N_per_mm": ("N/mm", "least-squares slope of the force over the same travel"),
    "energy_mJ": ("mJ", "work done by the blade"),
}

#: The same of what a run notes that its curve does not say.
NOTED: dict[str, tuple[str, str]] = {
    "crossed_mm": ("mm", "blade travel at which the surface first passes through itself"),
    "crossed_mm2": ("mm2", "largest area of the meshed section that is in one place twice"),
    "drag_steps": ("1", "points of the curve reached against raised damping, a force of the method's own"),
    "drag_boost": ("1", "largest damping at such a point, in units of its value; 0 where there is none"),
    "snap_rel": ("1", "work of the damping in jumps, relative to that of the blade"),
    "jumps_rel": ("1", "part of the blade's work behind the transition that unresolved jumps take"),
    "along_N": ("N", "largest force along the edge, of a blade that slices"),
    "freed_rel": ("1", "energy viscosity takes per area cut where the front is fastest, over the toughness"),
}

#: Where unresolved jumps take more than this part of the work, the run says so.
MAX_JUMPS = 0.03

#: A transition is abrupt where the force falls by this part of it.
ABRUPT_DROP = 0.1

ABRUPT, SMOOTH, UNCUT = "abrupt", "smooth", "uncut"
#: Where what the model leaves open decides between the first two.
UNDECIDED = "undecided"
#: A block that leaves ligaments along more of the blade than this does not say how the force falls.
BRIDGED = 0.1

#: The transition lasts from one window before the onset to this many windows after it. What falls later is
#: another event: where adhesion is stronger than the modulus the surface that sticks to the blade slips some
#: four windows after the onset, and when it does hangs on the steps.
TRANSITION = 2.0
#: So many windows after the onset a fall that begins in the transition has come to its end: what follows
#: changes neither drop nor label.
KNOWN = TRANSITION + 1
#: Cutting counts as steady from so many windows after the onset: until then the force recovers from its fall.
SETTLED = 4.0
#: The cut has begun when it is longer than at the start by this part of a window.
ONSET = 1 / 7
#: A drop is that of the force's mean over this part of a window: shorter ups and downs, the serrations of
#: heterogeneous material or of coarse elements among them, are no transition.
BLUR = 0.5
#: The front's speed is taken over this part of a window, short against the transition and long against steps.
FRONT = 1 / 14
#: Forces below this part of the largest one are no base for a relative drop, nor a peak.
_FLOOR = 0.05
#: Fall of the force after a peak, relative; and the last part of the travel, which counts as steady where it
#: is settled.
PROMINENCE, TAIL = 0.05, 0.4
#: Advance of the cut per travel of the blade between which cutting is steady; it is 1 where nothing changes.
PACE = (0.75, 1.33)


def measures(
    curve: Mapping[str, np.ndarray],
    *,
    window_mm: float,
    onset_length_mm: float | None = None,
    height_mm: float = math.inf,
    whole: bool = True,
) -> dict[str, float]:
    """The measures of ``MEASURES`` for a curve with ``displacement_mm``, ``force_N``, ``cut_length_mm``.

    ``window_mm`` is the travel over which drop and surge are taken (the blade's thickness);
    the cut has begun when it is longer by ``onset_length_mm``, or ``ONSET`` of the window, than at the start;
    a peak counts when the force falls by ``PROMINENCE`` of it before it rises above it. Steady is the last
    part of the travel, ``TAIL`` or what lies ``SETTLED`` windows behind the onset, up to ``CLAMP`` windows
    above the base of a specimen ``height_mm`` high, if it is as long as a window and the cut advances there
    with the blade.
    What a curve does not have (a peak, an onset) is nan; without an onset there is no transition, so
    ``drop_rel`` and ``front_speed`` are nan too. One that is not ``whole`` ends with its transition: nothing
    of it is steady, and ``max_N``, ``surge`` and ``energy_mJ`` are those up to there.

    Raises ValueError for arrays of unequal length, values that are not finite, a blade that runs
    backwards, or a window that is not positive.
    """
    d, F, c = _columns(curve)
    if not window_mm > 0:
        raise ValueError(f"window_mm must be positive, not {window_mm}")
    if d.size < 2 or d[-1] <= d[0]:
        return dict.fromkeys(MEASURES, math.nan)
    onset = first_crossing(d, c - c[0], onset_length_mm or ONSET * window_mm)
    # Whatever comes later, relative to the forces up to there.
    known = min(d[-1], onset + KNOWN * window_mm)
    least = _FLOOR * max(F[d <= known].max(), np.interp(known, d, F), 0.0)
    peak_mm, peak_N = _first_peak(d, F, least)
    end = min(d[-1], height_mm - CLAMP * window_mm)
    end = end if end > d[0] else d[-1]
    start = max(end - TAIL * (end - d[0]), onset + SETTLED * window_mm)
    steady, slope = math.nan, math.nan
    if whole and end - start >= window_mm and _keeps_pace(d, c, start, end):
        steady, slope = steady_force(d, F, start, end)
    return {
        "drop_rel": relative_fall(d, F, window_mm, onset, least) if math.isfinite(onset) else math.nan,
        "surge": fastest(d, c, window_mm)[1],
        "front_speed": at_the_front(d, c, window_mm, onset)[1],
        "onset_mm": onset,
        "peak_mm": peak_mm,
        "peak_N": peak_N,
        "max_N": float(F.max()),
        "steady_N": steady,
        "slope_N_per_mm": slope,
        "energy_mJ": float(np.trapezoid(F, d)),
    }


def forward(travel_mm: np.ndarray) -> int:
    """How many of the points (n,) are passed before the blade first rests or turns."""
    back = np.flatnonzero(np.diff(travel_mm) <= 0)
    return int(back[0]) + 1 if back.size else travel_mm.size


def label(
    drop_rel: float,
    surge: float = math.nan,
    *,
    drop: float = ABRUPT_DROP,
    surge_min: float | None = None,
    bridged: float = 0.0,
) -> str:
    """``"abrupt"`` when the force falls by ``drop`` (and the cut surges by ``surge_min``, where one is
    given), else ``"smooth"``; ``"uncut"`` when the cut never began (``drop_rel`` is nan).

    A block's force that does not fall is ``"undecided"`` where ligaments are left along a part ``bridged`` of
    the blade: they hold it up, and thinner layers might not leave them.
    """
    if math.isnan(drop_rel):
        return UNCUT
    if drop_rel >= drop and (surge_min is None or surge >= surge_min):
        return ABRUPT
    return UNDECIDED if bridged > BRIDGED else SMOOTH


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


def first_crossing(x: np.ndarray, y: np.ndarray, level: float) -> float:
    """Where the polygon (x, y) first rises to ``level``; nan if it stays below."""
    above = np.flatnonzero(y >= level)
    if above.size == 0:
        return math.nan
    i = int(above[0])
    if i == 0 or y[i] == y[i - 1]:
        return float(x[i])
    return float(x[i - 1] + (level - y[i - 1]) / (y[i] - y[i - 1]) * (x[i] - x[i - 1]))


def _first_peak(d: np.ndarray, F: np.ndarray, least: float) -> tuple[float, float]:
    """Place and height of the first maximum above ``least`` from which the force falls by ``PROMINENCE``."""
    best = 0
    for i in range(F.size):
        if F[i] > F[best]:
            best = i
        elif F[best] > least and F[i] < (1 - PROMINENCE) * F[best]:
            return float(d[best]), float(F[best])
    return math.nan, math.nan


def blurred(
    d: np.ndarray, F: np.ndarray, width: float, start: float, stop: float
) -> tuple[np.ndarray, np.ndarray]:
    """The polygon's mean over ``width`` around places 1/40 of it apart, wherever the polygon's points are.

    Towards the ends of the travel the stretch that the mean is taken over shrinks.
    """
    places = np.linspace(start, stop, 2 + int(np.ceil(40 * (stop - start) / width - 1e-9)))
    half = np.minimum(width / 2, np.minimum(places - d[0], d[-1] - places))
    total = np.concatenate([[0.0], np.cumsum(np.diff(d) * (F[1:] + F[:-1]) / 2)])

    def integral(x):
        i = np.clip(np.searchsorted(d, x, side="right") - 1, 0, d.size - 2)
        gap = d[i + 1] - d[i]
        along = x - d[i]
        rise = np.divide(F[i + 1] - F[i], gap, out=np.zeros_like(gap), where=gap > 0)
        return total[i] + along * (F[i] + rise * along / 2)

    wide = half > 1e-9 * width
    spread = np.where(wide, 2 * half, 1.0)
    mean = (integral(places + half) - integral(places - half)) / spread
    return places, np.where(wide, mean, np.interp(places, d, F))


def _keeps_pace(d: np.ndarray, c: np.ndarray, start: float, end: float) -> bool:
    """Whether the cut is as much longer as the blade is deeper, within ``PACE``."""
    pace = (np.interp(end, d, c) - np.interp(start, d, c)) / (end - start)
    return bool(PACE[0] <= pace <= PACE[1])


def steady_force(d: np.ndarray, F: np.ndarray, start: float, end: float) -> tuple[float, float]:
    """Mean and least-squares slope of the polygon from ``start`` to ``end``, by exact integrals.

    On each straight piece F·(d − mean) is quadratic, for which Simpson's rule is exact.
    """
    keep = (d > start) & (d < end)
    x = np.concatenate([[start], d[keep], [end]])
    y = np.concatenate([[np.interp(start, d, F)], F[keep], [np.interp(end, d, F)]])
    length = x[-1] - x[0]
    mean = float(np.trapezoid(y, x) / length)
    s = x - (x[0] + x[-1]) / 2
    mid = (s[1:] + s[:-1]) / 2 * (y[1:] + y[:-1]) / 2
    moment = float(np.sum(np.diff(x) / 6 * (s[:-1] * y[:-1] + 4 * mid + s[1:] * y[1:])))
    return mean, moment / (length**3 / 12)


def relative_fall(d: np.ndarray, F: np.ndarray, window: float, onset: float, least: float) -> float:
    """max over the transition's x of (F̄(x) − min F̄ over [x, x + window]) / F̄(x), F̄ the blurred force above
    ``least``. All of it comes from the curve up to ``KNOWN`` windows after the onset."""
    stop = min(d[-1], onset + (KNOWN - BLUR / 2) * window)
    places, mean = blurred(d, F, BLUR * window, max(d[0], onset - window), stop)
    ahead = int(window / (places[1] - places[0]) * (1 + 1e-9))
    low = sliding_window_view(np.pad(mean, (0, ahead), mode="edge"), ahead + 1).min(axis=1)
    counts = (places <= onset + TRANSITION * window) & (mean > least)
    return float(((mean - low)[counts] / mean[counts]).max(initial=0.0))


def at_the_front(d: np.ndarray, c: np.ndarray, window: float, onset: float) -> tuple[float, float]:
    """Where the front is fastest at the transition, over ``FRONT`` of the ``window``, and its speed there in
    that of the blade; nan without an onset."""
    if math.isnan(onset):
        return math.nan, math.nan
    end = min(d[-1], onset + (TRANSITION + FRONT) * window)
    until = d <= end
    return fastest(np.append(d[until], end), np.append(c[until], np.interp(end, d, c)), FRONT * window)


def fastest(d: np.ndarray, c: np.ndarray, window: float) -> tuple[float, float]:
    """max over x of (c(x + window) − c(x)) / window, windows within the travel: that x, and the maximum."""
    window = min(window, d[-1] - d[0])
    # Windows that begin or end at a point. At a jump that point's own value is one side of it.
    begin, end = d <= d[-1] - window, d >= d[0] + window
    x = np.concatenate([d[begin], d[end] - window])
    after = np.concatenate([np.interp(d[begin] + window, d, c), c[end]])
    before = np.concatenate([c[begin], np.interp(d[end] - window, d, c)])
    best = int(np.argmax(after - before))
    return float(x[best]), float(max(after[best] - before[best], 0.0) / window)


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

    @cached_property
    def tail(self) -> tuple[float, float]:
        """Mean and slope of the force behind the transition, of the last part of the travel."""
        d, w = self.d, self.thickness
        start = max(d[-1] - TAIL * (d[-1] - d[0]), self.onset + SETTLED * w)
        return (math.nan, math.nan) if not d[-1] - start >= w else steady_force(d, self.F, start, d[-1])


_WORK = "mJ", "work of the blade", lambda c: float(np.trapezoid(c.F, c.d))
#: By name: unit, what it is, and how it is read off a curve.
READ_OFF: dict[str, tuple[str, str, Callable[[ForceCurve], float]]] = {
    "onset": ("mm", "travel at the end of indentation", lambda c: c.onset),
    # Up to a thickness behind the end of indentation.
    "peak": ("N", "largest force of the transition",
             lambda c: float(c.F[c.d <= c.begun + c.thickness].max())),
    "drop": ("1", "relative fall of the force within a thickness of travel at the transition",
             lambda c: c.fall),
    "plateau": ("N", "mean force behind the transition", lambda c: c.tail[0]),
    "plateau_from": (
        "mm", "travel at which the force first is that of the plateau",
        lambda c: first_crossing(*blurred(c.d, c.F, c.thickness / 2, c.d[0], c.d[-1]), c.tail[0]),
    ),
    "slope": ("N/mm", "slope of the force behind the transition", lambda c: c.tail[1]),
    "work": _WORK,
    "firmness": ("N", "largest force", lambda c: float(c.F.max())),
    "work_of_shear": _WORK,
}  # fmt: skip
