"""How the blade moves over time: at one speed, or along a polyline with holds, returns and other speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Motion:
    """Blade travel as a polyline over time; steps are counted in time × ``speed``, a way in mm.

    ``points`` ((time s, travel mm), …) begin at (0, 0). Without any the blade goes to ``depth`` at ``speed``,
    and the way is the travel.
    """

    depth: float
    speed: float
    points: tuple[tuple[float, float], ...] = ()

    @property
    def end(self) -> float:
        """The way at which it is over."""
        return self.points[-1][0] * self.speed if self.points else self.depth

    def travel(self, way: float) -> float:
        """Blade travel, mm."""
        if not self.points:
            return way
        times, travels = zip(*self.points, strict=True)
        return float(np.interp(way / self.speed, times, travels))

    def room(self, way: float) -> float:
        """Way to the next corner, or to the end: no step goes across."""
        for time, _ in self.points:
            if time * self.speed > way + 1e-9:
                return time * self.speed - way
        return self.end - way

    def turns(self, way: float) -> bool:
        """Whether there is a corner here, so that nothing goes on as it did."""
        return any(abs(time * self.speed - way) < 1e-9 for time, _ in self.points)
