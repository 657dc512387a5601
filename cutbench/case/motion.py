"""How the blade moves over time: at one speed, or along a polyline with holds, returns and other speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cutbench.base.errors import require
from cutbench.base.toml import among
from cutbench.base.units import parse_quantity

#: From (0, 0): times in s and travels in mm.
Polyline = tuple[tuple[float, float], ...]
#: How far a blade goes: to its depth, or until the transition from indentation to cutting is known.
DEPTH, TRANSITION = "depth", "transition"
UNTIL = (DEPTH, TRANSITION)


@dataclass(frozen=True)
class Motion:
    """A motion says how far the blade has travelled at any time.

    Steps are counted in time × ``speed``, a way in mm. Without ``points`` the blade goes to ``depth`` at
    ``speed``, and the way is the travel.

    Attributes
    ----------
    depth : float, mm
        How far the blade goes.
    speed : float, mm/s
        How fast.
    points : tuple of (float, float)
        Times in s and travels in mm, from (0, 0), of a blade that holds, returns or changes its speed.
    slice_push : float
        How far the blade goes along its edge while it travels by 1 mm.
    """

    depth: float
    speed: float
    points: Polyline = ()
    slice_push: float = 0.0

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        times, travels = np.array(self.points).T
        return times, travels

    @property
    def end(self) -> float:
        """The way, in mm, at which the motion is over."""
        return self.points[-1][0] * self.speed if self.points else self.depth

    def travel(self, pseudo_time_mm: float) -> float:
        """Return the travel of the blade."""
        return (
            float(np.interp(pseudo_time_mm / self.speed, *self._columns)) if self.points else pseudo_time_mm
        )

    def room(self, pseudo_time_mm: float) -> float:
        """Return the way that is left to the next corner, or to the end, which no step goes across."""
        for time, _ in self.points:
            if time * self.speed > pseudo_time_mm + 1e-9 * self.end:
                return time * self.speed - pseudo_time_mm
        return self.end - pseudo_time_mm

    def turns(self, pseudo_time_mm: float) -> bool:
        """Return whether there is a corner here, so that nothing goes on as it did."""
        return any(abs(time * self.speed - pseudo_time_mm) < 1e-9 * self.end for time, _ in self.points)


def read_motion(raw: Any) -> Polyline:
    """From pairs of a time and a travel with their units, or of numbers in s and mm. Raises BadInput."""
    pairs = isinstance(raw, (list, tuple)) and all(isinstance(p, (list, tuple)) and len(p) == 2 for p in raw)
    expected = "pairs of time and travel, such as [['0 s', '0 mm'], ['9 s', '2 mm'], ['99 s', '2 mm']]"
    require(pairs, "motion", raw, expected)
    return tuple((_number(time, "s"), _number(travel, "mm")) for time, travel in raw)


def _number(raw: object, unit: str) -> float:
    if isinstance(raw, (int, float)) and not isinstance(raw, bool):
        return float(raw)
    return parse_quantity(raw, unit, key="motion")


def corners(s: np.ndarray, y: np.ndarray, limit: float) -> list[int]:
    """Where between its ends the line through (s, y), (n,) each, bends: what is left out lies within
    ``limit`` of straight lines (Ramer, Douglas and Peucker)."""
    bends, open_ = [], [(0, s.size - 1)]
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        off = np.abs(y[a : b + 1] - np.interp(s[a : b + 1], s[[a, b]], y[[a, b]]))
        k = a + int(off.argmax())
        if off[k - a] > limit:
            bends.append(k)
            open_ += [(a, k), (k, b)]
    return sorted(bends)


def simplified(motion: Polyline, part: float = 0.005) -> Polyline:
    """The corners of a measured ``motion``, to within ``part`` of the largest travel."""
    times, travels = (np.array(column, dtype=float) for column in zip(*motion, strict=True))
    inner = corners(times, travels, part * travels.max())
    return tuple((float(times[i]), float(travels[i])) for i in sorted({0, *inner, times.size - 1}))


def checked_motion(motion: Polyline, depth: float, until: str = DEPTH) -> Polyline:
    """``motion`` if a blade can follow it to no more than ``depth``, all the way. Raises BadInput."""
    among("until", until, UNTIL)
    expected = f"'{DEPTH}' with a motion, which has an end of its own"
    require(not motion or until == DEPTH, "until", until, expected)
    require(len(motion) != 1, "motion", "one point", "two points or more")
    for i, (time, travel) in enumerate(motion):
        place, before = f"({time:g} s, {travel:g} mm)", motion[i - 1][0] if i else -math.inf
        numbers = math.isfinite(time) and math.isfinite(travel)
        require(numbers, "motion", place, "times in s and travels in mm")
        require(i or time == travel == 0, "motion", place, "(0 s, 0 mm) at first")
        require(time > before, "motion", f"{time:g} s", f"a time after {before:g} s")
        inside = 0 <= travel <= depth * (1 + 1e-9)
        require(inside, "motion", f"{travel:g} mm", f"0 to the depth, {depth:g} mm")
    return tuple(motion)
