"""Numbers of a curve that claims speak of, beside the measures that every run has."""

from __future__ import annotations

import math

import numpy as np

from cutbench.run.result import Result


def end_of_indentation(result: Result) -> float:
    """Travel, mm, at the first maximum from which the force falls by 5 %, else at the largest force."""
    peak = result.measures.get("peak_mm", math.nan)
    if math.isfinite(peak):
        return peak
    if result.force_N.size < 3:
        return math.nan
    return float(result.displacement_mm[int(np.argmax(result.force_N))])


def mean_force(result: Result, start_mm: float, stop_mm: float) -> float:
    """Mean of the force, N, over a part of the travel; nan if the run did not get there."""
    d, F = result.displacement_mm, result.force_N
    if d.size < 3 or d[-1] < stop_mm - 1e-6:
        return math.nan
    inside = (d > start_mm) & (d < stop_mm)
    x = np.concatenate([[start_mm], d[inside], [stop_mm]])
    y = np.concatenate([[np.interp(start_mm, d, F)], F[inside], [np.interp(stop_mm, d, F)]])
    return float(np.trapezoid(y, x) / (stop_mm - start_mm))


def straightness(result: Result) -> float:
    """R² of a straight line through the whole of the curve, its points evenly over the travel."""
    d, F = result.displacement_mm, result.force_N
    if d.size < 3:
        return math.nan
    x = np.linspace(d[0], d[-1], 400)
    y = np.interp(x, d, F)
    residual = y - np.polyval(np.polyfit(x, y, 1), x)
    return float(1 - residual.var() / y.var())


def share(result: Result, one: str, other: str, start_mm: float) -> float:
    """Work of mechanism ``one`` over that of ``other`` from ``start_mm`` on."""
    d, curve = result.displacement_mm, result.curve
    names = [f"work_{name}_mJ" for name in (one, other)]
    if any(name not in curve for name in names) or d[-1] <= start_mm:
        return math.nan
    top, bottom = (curve[name][-1] - np.interp(start_mm, d, curve[name]) for name in names)
    return float(top / bottom) if bottom else math.nan


def observed(result: Result, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Travel and value (n,) where ``column`` was observed."""
    values = result.curve.get(column, np.full(result.displacement_mm.shape, np.nan))
    seen = np.isfinite(values)
    return result.displacement_mm[seen], values[seen]


def observed_at(result: Result, column: str, travel_mm: float) -> float:
    """``column`` at the first observation at or past ``travel_mm``; nan if the run did not get there."""
    d, values = observed(result, column)
    i = int(np.searchsorted(d, travel_mm - 1e-6))
    return float(values[i]) if i < d.size else math.nan


def largest_until(result: Result, column: str, travel_mm: float) -> float:
    """Largest value of ``column`` up to ``travel_mm``."""
    d, values = observed(result, column)
    return float(max(values[d <= travel_mm + 1e-9], default=math.nan))


def median_from(result: Result, column: str, travel_mm: float) -> float:
    """Median of ``column`` from ``travel_mm`` on."""
    d, values = observed(result, column)
    chosen = values[d >= travel_mm]
    return float(np.median(chosen)) if chosen.size else math.nan


def measure(result: Result, name: str) -> float:
    """One of the measures that a run has, nan where it has none."""
    return float(result.measures.get(name, math.nan))


def force_at(result: Result, travel_mm: float) -> float:
    """Force, N, at ``travel_mm``; nan if the run did not get there."""
    d = result.displacement_mm
    there = d.size > 1 and d[-1] >= travel_mm - 1e-6
    return float(np.interp(travel_mm, d, result.force_N)) if there else math.nan


def ratio(a: float, b: float) -> float:
    """a/b, nan where b is 0."""
    return a / b if b else math.nan
