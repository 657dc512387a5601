"""An inverse problem whose derivatives are computed at few places, and updated between them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction, Task
from cutbench.calibration.secant import updated


class Sparing(Inverse):
    """``inverse`` without derivatives of its own: they go on from the nearest place where they are known.

    ``values`` by label and ``found`` by id: such a place, if ``inverse`` has none yet.
    """

    def __init__(
        self,
        inverse: Inverse,
        values: Mapping[str, float] | None = None,
        found: Mapping[str, Prediction] | None = None,
    ):
        super().__init__(
            inverse.campaign, inverse.unknowns, inverse.run, start=inverse.start, grids=inverse.grids,
            across=inverse.across or found is not None,
        )  # fmt: skip
        self._computed = inverse._known
        self._given: list[tuple[np.ndarray, Mapping[str, Prediction]]] = []
        if values is not None and found is not None:
            self._given.append((np.array([values[u.label] for u in self.unknowns]), found))

    def predictions(self, q: np.ndarray) -> Mapping[str, Prediction]:
        """Of the train experiments; raises ComputationFailed."""
        key = q.tobytes()
        if key in self._computed:
            return self._computed[key]
        if key not in self._known:
            near = self._nearest(q)
            if near is None:
                return super().predictions(q)
            train = self.campaign.train
            tasks = [Task(e, self.checked_case(e, q), self.grids[e.id]) for e in train]
            plain = dict(zip([e.id for e in train], self.run(tasks), strict=True))
            self._known[key] = {e.id: updated(self, e, plain[e.id], near, q) for e in train}
        return self._known[key]

    def _nearest(self, q: np.ndarray) -> tuple[np.ndarray, Mapping[str, Prediction]] | None:
        """Values (k,) of the unknowns and predictions where these are known nearest to ``q``."""
        known = (
            (self.values(np.frombuffer(k)), p) for d in (self._computed, self._known) for k, p in d.items()
        )
        size, here = self.sizes(q), self.values(q)
        places = [*self._given, *known]
        return min(places, key=lambda place: float(np.linalg.norm((place[0] - here) / size)), default=None)
