"""The cut plane in strips across the blade: in each of them the cut has a front of its own.

A section is one strip. A section that is drawn out is cut in its planes; of tetrahedra a strip is as long as
an element along the blade.
"""

from __future__ import annotations

import numpy as np

from cutbench.forms.space import Faces, Space


class Strips:
    """``z`` (n,) are their middles, mm; ``width`` (n,) what the faces in each add up to over the height, mm,
    or 1; ``at`` (points,) says in which each point of the ``faces`` lies.

    ``folded``: of both halves of a block together, from its middle on; the first then has the points within
    ``near`` mm of the middle. ``count``: so many, of tetrahedra.
    """

    def __init__(self, space: Space, faces: Faces, *, folded: bool = False, count: int | None = None):
        self._folded = folded
        of_nodes = self._along(space.X)
        along = float(np.median(np.ptp(of_nodes[faces.nodes], axis=0)))
        low, high = float(of_nodes.min()), float(of_nodes.max())
        if along > 0:
            count = count or max(1, round((high - low) / along))
            edges = np.linspace(low, high, count + 1)
            self.z, self.near = (edges[1:] + edges[:-1]) / 2, (high - low) / count
        else:
            self.near = 1e-9 * max(high - low, 1e-300)
            self.z = self.near * np.unique(np.round(self._along(faces.X) / self.near))
            edges = np.concatenate([[low], (self.z[1:] + self.z[:-1]) / 2, [high]])
        self._edges = edges[1:-1]
        self.at = self.of(faces.X).ravel()
        tall = float(np.ptp(space.X[1]))
        self.width = np.bincount(self.at, faces.w.ravel(), self.z.size) / tall

    def _along(self, X: np.ndarray) -> np.ndarray:
        z = X[2] if len(X) == 3 else np.zeros(X.shape[1:])
        return np.abs(z) if self._folded else z

    def of(self, X: np.ndarray) -> np.ndarray:
        """In which of them points X (dim, …) lie, as they were before loading."""
        return np.searchsorted(self._edges, self._along(X), side="right")

    def lengths(self, area: np.ndarray) -> np.ndarray:
        """How long the cut is in each (n,), mm, of what is cut at each point of the faces (points,)."""
        return np.bincount(self.at, area, self.z.size) / self.width

    def half(self, values: np.ndarray, within: float) -> float:
        """What half of the blade has at most, of ``values`` (n,) or nan; nan where less than half has one.
        The blade reaches ``within`` mm of the middle."""
        those = self.z <= max(within, self.z[0])
        order = np.argsort(values[those])
        share = self.width[those][order]
        return float(np.interp(0.5, (np.cumsum(share) - share / 2) / share.sum(), values[those][order]))

    def lowest(self, height: np.ndarray, some: np.ndarray, top: float) -> np.ndarray:
        """The lowest ``height`` (points,) of ``some`` (points,) in each (n,), ``top`` where none is."""
        found = np.full(self.z.size, top)
        np.minimum.at(found, self.at[some], height[some])
        return found
