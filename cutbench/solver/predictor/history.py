"""A guess at the next step's solution: what the block did when its cut was one element shorter.

Once the cut runs, everything near the blade moves down with it, and on a mesh whose elements along the cut
are alike the states repeat, one element lower, each time the cut has grown by one: the small snaps from
element to element, too, which no extrapolation in time foresees. So the increment of the displacements is
taken over from then and there. In coarse steady cutting it leaves a fifth of a straight line's residual.

It may lead past a small snap before its time. Straight lines stay with a state for as long as there is
equilibrium near it, and close the ledger better where the mesh is finer.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from cutbench.forms.space import Faces, Space

#: Length of the cut in elements, beyond those that it reaches back, from which on the past is asked.
BEGUN = 0.5
#: Steps that are remembered, at the most, for the growth of the cut by one element.
REMEMBERED = 300


class History:
    """Displacements since the cut was some elements shorter, and the way down by one element."""

    def __init__(self, space: Space, cut: Faces, ndof: int, elements: int = 1):
        """``cut``: the faces of the cut plane. Unknowns behind the displacements are not foreseen."""
        self._space, self._ndof, self._elements = space, ndof, elements
        self._weights = cut.w.ravel() / (cut.w.sum() / np.ptp(cut.X[1]))
        #: Height of an element of the cut plane, mm.
        self.fall = float(np.median(np.ptp(space.X[1, cut.nodes], axis=0)))
        self._down: sp.csr_matrix | None = None
        self._sought = False
        self.travel: list[float] = []
        self._u: list[np.ndarray] = []
        self._length: list[float] = []

    def add(self, travel: float, u: np.ndarray, damage: np.ndarray) -> None:
        """A step's end: its displacements and the damage (n,) at the points of the cut plane."""
        if self.travel and travel < self.travel[-1]:
            self.travel, self._u, self._length = [], [], []  # the way back is another one
        if self.travel and travel == self.travel[-1]:
            del self.travel[-1], self._u[-1], self._length[-1]  # the blade has rested: what it came to counts
        length = float(self._weights @ damage)
        if len(self.travel) > 2 and length - self._length[-2] < self.fall / REMEMBERED:
            # What is between two so near is not needed.
            self.travel[-1], self._u[-1], self._length[-1] = travel, u, length
        else:
            self.travel.append(travel)
            self._u.append(u)
            self._length.append(length)
        reach = length - self._elements * self.fall
        while len(self.travel) > 2 and (self._length[1] <= reach or len(self.travel) > 2 * REMEMBERED):
            del self.travel[0], self._u[0], self._length[0]

    def guesses(self, size: float, u: np.ndarray) -> Iterator[np.ndarray]:
        """u one step of ``size`` mm later, from when the cut was one element shorter, two, and so on; none
        from where the past does not reach back to, or not on for so long a step."""
        for n in range(1, self._elements + 1):
            length = self._length[-1] if self.travel else 0.0
            if length < (n + BEGUN) * self.fall or self._length[0] > length - n * self.fall:
                return
            then = np.interp(length - n * self.fall, self._length, self.travel)
            if then + size > self.travel[-1]:
                continue
            down = self._translation()
            if down is None:
                return
            du = self.at(then + size) - self.at(then)
            for _ in range(n):
                du = down @ du
            yield u + du

    def at(self, travel: float) -> np.ndarray:
        i = min(max(int(np.searchsorted(self.travel, travel)), 1), len(self.travel) - 1)
        a, b = self.travel[i - 1], self.travel[i]
        return self._u[i - 1] + (self._u[i] - self._u[i - 1]) * ((travel - a) / (b - a))

    def _translation(self) -> sp.csr_matrix | None:
        """Matrix (ndof, ndof) that takes displacements down by an element; None if points are not found."""
        if not self._sought:
            self._sought = True
            space = self._space
            points = space.inside
            points[1] = np.minimum(points[1] + self.fall, points[1].max())
            try:
                probes = space.probes(points)
            except ValueError:
                return None
            whole = sp.kron(probes, sp.identity(space.dim), format="csr")
            rest = sp.csr_matrix((self._ndof - space.ndof,) * 2)
            self._down = sp.block_diag([whole, rest], format="csr")
        return self._down

    def state(self) -> dict[str, list]:
        """What ``restore`` needs to go on from here."""
        return {"travel": [*self.travel], "u": [*self._u], "length": [*self._length]}

    def restore(self, state: dict[str, list] | None) -> None:
        """Go on from ``state``, or from nothing."""
        state = state or {"travel": [], "u": [], "length": []}
        self.travel, self._u, self._length = [*state["travel"]], [*state["u"]], [*state["length"]]
