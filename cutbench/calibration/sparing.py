"""An inverse problem whose derivatives are computed at few places, and updated between them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction, Task
from cutbench.calibration.secant import carried, updated

#: Values (k,) of the unknowns, for each test, and predictions, both by id.
_Known = tuple[Mapping[str, np.ndarray], Mapping[str, Prediction]]


class Sparing(Inverse):
    """``inverse`` without derivatives of its own: they go on from the nearest place where they are known.

    ``values`` by id and label and ``found`` by id: such a place, if ``inverse`` has none yet.
    """

    def __init__(
        self,
        inverse: Inverse,
        values: Mapping[str, Mapping[str, float]] | None = None,
        found: Mapping[str, Prediction] | None = None,
    ):
        super().__init__(
            inverse.campaign, inverse.unknowns, inverse.run, start=inverse.start, grids=inverse.grids,
            across=inverse.across or found is not None,
        )  # fmt: skip
        self._computed = inverse._known
        self._given: list[_Known] = []
        if values is not None and found is not None:
            labels = [u.label for u in self.unknowns]
            mine = {id: np.array([by[label] for label in labels]) for id, by in values.items()}
            self._given.append((mine, found))

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
            values, found = near
            self._known[key] = {e.id: updated(self, e, plain[e.id], (values[e.id], found), q) for e in train}
        return self._known[key]

    def carried(self, q: np.ndarray) -> dict[str, Prediction]:
        """At ``q`` by the derivatives of the nearest place that is known, without a run."""
        near = self._nearest(q)
        assert near is not None, "a place that is known is asked from"
        values, found = near
        return {e.id: carried(self, e, (values[e.id], found), q) for e in self.campaign.train}

    def _nearest(self, q: np.ndarray) -> _Known | None:
        """Where predictions are known nearest to ``q``."""
        size, here, ids = self.sizes(q), self.values(q), [e.id for e in self.campaign.train]
        places = list(self._given)
        for known in (self._computed, self._known):
            for key, found in known.items():
                places.append((dict.fromkeys(ids, self.values(np.frombuffer(key))), found))

        def far(place: _Known) -> float:
            return sum(float(np.sum(((values - here) / size) ** 2)) for values in place[0].values())

        return min(places, key=far, default=None)
