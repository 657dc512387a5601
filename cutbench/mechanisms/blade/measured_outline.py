"""A measured outline: points of the profile in mm, drawn as a smooth chain of arcs, under a band.

Each point is moved to the parabola through it and its two neighbours on both sides, by least squares, and has
its direction; between two points run two arcs that meet with one direction. A measured point may so be off by
about half of what it was read with. Points of one flank alone, from the apex on, are mirrored.
"""

from functools import lru_cache
from typing import ClassVar

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.blade._profile import Flank, Profiled, flank
from cutbench.mechanisms.blade._rigid import PLACED

#: A hyperbola: what laws are tried on where there is no case.
EXAMPLE = np.column_stack([x := np.linspace(0, 0.35, 71), 3 * (np.sqrt(x**2 + 0.01) - 0.1)])


class MeasuredOutline(Profiled):
    """Contact with a blade of measured outline."""

    name = "measured_outline"
    title = "contact (outline)"
    family = "tool"
    measured = True
    edge = ("thickness", "the radius of its lowest point")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter.positive(
            "thickness", "mm", "2a", "width of the outline; another one scales it", default=0.7, sought=False
        ),
        *PLACED,
    )

    def flanks(self, p):
        points = np.ascontiguousarray(getattr(p, "outline", EXAMPLE), dtype=float)
        right, left = _drawn(points.tobytes())
        T = p.thickness

        def sized(each: Flank) -> Flank:
            return Flank(each.x * T, each.y * T, each.angle, each.bend / T, each.length * T)

        scaled = sized(right)
        return scaled, scaled if right is left else sized(left)

    def edge_radius(self, p):
        return 1 / self.flanks(p)[0].bend[0]

    def misfits(self, p):
        if self.flanks(p)[0].bend[0] <= 0:
            yield "outline", "its lowest point", "an outline that bulges there"

    def edge_for(self, p, radius):
        return p.thickness * radius / self.edge_radius(p)


@lru_cache(maxsize=16)
def _drawn(content: bytes) -> tuple[Flank, Flank]:
    """The flanks of an outline, in units of its width."""
    points = np.frombuffer(content).reshape(-1, 2)
    if points[0, 0] > points[-1, 0]:
        points = points[::-1]  # from left to right
    lowest = int(points[:, 1].argmin())
    if lowest == len(points) - 1:
        points, lowest = points[::-1] * [-1.0, 1.0], 0
    points = points - points[lowest]
    if one_flank := lowest == 0:
        points = np.vstack([points[:0:-1] * [-1.0, 1.0], points])
    points = points / np.ptp(points[:, 0])
    at, way = _smooth(points)
    lowest = len(points) // 2 if one_flank else int(at[:, 1].argmin())
    if not one_flank:  # between two points there is one that is lower still
        s, fit = _parabola(points, lowest)
        level = np.clip(-fit[1, 1] / (2 * fit[2, 1]), *(s[[-1, 1]] / 2)) if fit[2, 1] > 0 else 0.0
        at[lowest] = fit[0] + level * (fit[1] + level * fit[2])
    at = at - at[lowest]
    right = _arcs(at[lowest:], way[lowest:])
    return right, right if one_flank else _arcs(at[lowest::-1] * [-1.0, 1.0], way[lowest::-1] * [1.0, -1.0])


def _smooth(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) on parabolas through five of them, and unit directions there."""
    fits = [_parabola(points, i)[1] for i in range(len(points))]
    return np.array([fit[0] for fit in fits]), np.array([fit[1] / np.hypot(*fit[1]) for fit in fits])


def _parabola(points: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
    """The one through point ``i`` and its neighbours, five in all: lengths of all from there (n,) along the
    line, beginning with its own, and the coefficients (3, 2) of x and y by length."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    s, first = s - s[i], min(max(i - 2, 0), len(s) - 5)
    near = slice(first, first + 5)
    return np.roll(s, -i), np.polynomial.polynomial.polyfit(s[near], points[near], 2)


def _arcs(at: np.ndarray, way: np.ndarray) -> Flank:
    """A right flank through points from the apex on, level there and upright at its end: two arcs each."""
    way = way.copy()
    way[0], way[-1] = (1.0, 0.0), (0.0, 1.0)
    pieces = []
    for a, b, t, e in zip(at[:-1], at[1:], way[:-1], way[1:], strict=True):
        v, both = b - a, t + e
        # The arcs meet where tangents of one length d from both ends do.
        turn, rise = 2 * (1 - t @ e), v @ both
        d = (v @ v) / (rise + np.sqrt(rise**2 + turn * (v @ v)))
        middle = (a + b + d * (t - e)) / 2
        heading = (v - d * both) / np.hypot(*(v - d * both))
        for start, chord in ((t, middle - a), (heading, b - middle)):
            sine = (start[0] * chord[1] - start[1] * chord[0]) / (chord @ chord)
            size = np.hypot(*chord)
            half = np.arctan2(sine * size, start @ chord / size)
            pieces.append((2 * sine, size / np.sinc(half / np.pi)))
    return flank(*pieces, (0.0, np.inf))
