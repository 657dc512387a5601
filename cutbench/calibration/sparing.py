"""An inverse problem whose derivatives are computed at few places, and updated between them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction


class Sparing(Inverse):
    """``inverse`` without derivatives of its own: they go on from the nearest place where they are known.
    What it computes ``inverse`` knows, too.

    ``values`` by label and ``found`` by id: such a place, if ``inverse`` has none yet.
    """

    def __init__(
        self,
        inverse: Inverse,
        values: Mapping[str, float] | None = None,
        found: Mapping[str, Prediction] | None = None,
    ):
        super().__init__(
            inverse.campaign, inverse.unknowns, inverse.run, start=inverse.start, grids=inverse.grids
        )
        self._known, self._places = inverse._known, inverse._places
        self._given: list[tuple[np.ndarray, Mapping[str, Prediction]]] = []
        if values is not None and found is not None:
            self._given.append((np.array([values[u.label] for u in self.unknowns]), found))

    def _near(self, q: np.ndarray) -> tuple[np.ndarray, Mapping[str, Prediction]] | None:
        known = ((self.values(np.frombuffer(key)), found) for key, found in self._known.items())
        return self._nearest([*self._given, *self._places, *known], q)
