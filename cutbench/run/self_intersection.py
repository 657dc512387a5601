"""Self-intersection: where material beside the blade passes through itself, at every step of a section."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from cutbench.forms.surface_lines import crossings, overlap, surface_lines
from cutbench.run.build import WIDE, Built
from cutbench.run.observer import Observer
from cutbench.run.remeshing import Transfer
from cutbench.solver.march import Accepted

#: Said of a run whose surface passes through itself at its end.
ADVICE = "(Beside the blade the surface passes through itself: nothing keeps one part of it off another.)"


def surface_lines_of(built: Built) -> list[np.ndarray]:
    """Nodes along top and cut face of a section, each side by itself; none in three dimensions, which are not
    looked at."""
    if built.case.dim == 3 or not built.blades:
        return []
    faces = built.blades[0].faces
    parts = {name: faces.some(np.arange(at.start, at.stop)) for name, at in faces.parts.items()}
    return surface_lines(parts, built.space.X, WIDE * built.case.p.thickness)


def crossed_area(built: Built, u: np.ndarray, lines: Iterable[np.ndarray] | None = None) -> float:
    """Area in mm² of a section, moved by ``u`` (ndof,), that is in one place twice: of its meshed part.

    ``lines`` are what ``surface_lines_of`` gives of it.
    """
    space, total = built.space, 0.0
    x = space.X + u[: space.X.size].reshape(space.dim, -1, order="F")
    for line in surface_lines_of(built) if lines is None else lines:
        moved = x[:2, line]
        if crossings(moved).size:
            # Closed through the body.
            top, base = (0, -1) if space.X[1, line[0]] > space.X[1, line[-1]] else (-1, 0)
            within = np.array([[moved[0, top]], [moved[1, base]]])
            total += overlap(np.hstack([moved, within]))
    return total


class SelfIntersection(Observer):
    """Cautions of a surface that crosses itself at the last step."""

    kept = ("caution", "_first", "_most")

    def __init__(self, built: Built) -> None:
        self._first, self._most = math.nan, 0.0
        self._built, self._lines = built, surface_lines_of(built)

    def renewed(self, transfer: Transfer) -> None:
        self._built, self._lines = transfer.new, surface_lines_of(transfer.new)

    def add(self, step: Accepted) -> None:
        area = crossed_area(self._built, step.u, self._lines)
        self.caution = ADVICE if area > 0 else ""
        if area > 0 and math.isnan(self._first):
            self._first = step.travel
        self._most = max(self._most, area)

    def measures(self) -> dict[str, float]:
        return {"crossed_mm": self._first, "crossed_mm2": self._most}
