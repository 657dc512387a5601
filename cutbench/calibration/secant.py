"""An inverse problem whose derivatives are computed at few places, and updated by what curves did elsewhere.

A cut costs less without its derivatives. Broyden's update (1965, 10.1090/S0025-5718-1965-0198670-6) is the
smallest change of the derivatives that makes them agree with the change of the curve over the last step; over
the length of a step it knows more of a curve that jumps than a tangent does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction, Task


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
            inverse.campaign, inverse.unknowns, inverse.run, start=inverse.start, grids=inverse.grids
        )
        self._exact = inverse._known
        self._places: list[tuple[np.ndarray, Mapping[str, Prediction]]] = []
        if values is not None and found is not None:
            self._places.append((np.array([values[u.label] for u in self.unknowns]), found))

    def predictions(self, q: np.ndarray) -> dict[str, Prediction]:
        """Of the train experiments; raises ComputationFailed."""
        key = q.tobytes()
        if key in self._exact:
            return self._exact[key]
        if key not in self._known:
            near = self._nearest(q)
            if near is None:
                return super().predictions(q)
            train = self.campaign.train
            cases = self.cases(q)
            tasks = [Task(e, c, self.grids[e.id]) for e, c in zip(train, cases, strict=True)]
            plain = dict(zip([e.id for e in train], self.run(tasks), strict=True))
            self._known[key] = {e.id: self._updated(e, plain[e.id], near, q) for e in train}
        return self._known[key]

    def _values(self, q: np.ndarray) -> np.ndarray:
        return np.array([u.value(x) for u, x in zip(self.unknowns, q, strict=True)])

    def _nearest(self, q: np.ndarray) -> tuple[np.ndarray, Mapping[str, Prediction]] | None:
        """Values (k,) of the unknowns and predictions where these are known nearest to ``q``."""
        known = [*self._exact.items(), *self._known.items()]
        places = [*self._places, *((self._values(np.frombuffer(key)), found) for key, found in known)]
        size, here = self._sizes(q), self._values(q)
        return min(places, key=lambda place: float(np.linalg.norm((place[0] - here) / size)), default=None)

    def _sizes(self, q: np.ndarray) -> np.ndarray:
        return np.array([u.slope(x) for u, x in zip(self.unknowns, q, strict=True)])

    def _updated(self, e, plain: Prediction, near, q: np.ndarray) -> Prediction:
        """``plain`` with the slopes of the ``near`` place, changed so that they give what is new since."""
        values, found = near
        old, names = found[e.id], self.names(e)
        mine = [
            next(k for k, u in enumerate(self.unknowns) if u.name == name and u.experiment in (None, e.id))
            for name in names
        ]
        size = self._sizes(q)[mine]
        step = (self._values(q) - values)[mine] / size
        order = [old.names.index(name) for name in names]

        def changed(slopes: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
            scaled = slopes[:, order] * size
            if not step @ step > 0:
                return slopes[:, order]
            missed = after - before - scaled @ step
            return (scaled + np.outer(missed, step) / (step @ step)) / size

        fields = (
            changed(old.field_slopes, old.fields, plain.fields) if plain.fields.size else old.field_slopes
        )
        return replace(plain, slopes=changed(old.slopes, old.y, plain.y), names=names, field_slopes=fields)
