"""The testing machine in a test without a mesh: what it does to displacements and forces, both ways.

From the recorded displacement to the specimen's own, at the measured force: how far a machine gives at a
reading follows from the force that it read there. From the specimen's force to the recorded one.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.case.model import Model
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.data.repetition import Averaged
from cutbench.homogeneous.history import LoadingHistory


class Machine:
    """The rig of ``model`` with ``p``, whose values may be complex and arrays (m,), in ``experiment``."""

    def __init__(self, experiment: Experiment, model: Model, p: SimpleNamespace, at: Averaged):
        self.model, self.area = model, experiment.area_mm2 or np.nan
        stretched = experiment.kind in HOMOGENEOUS
        self.length = experiment.specimen.get("length", np.nan) if stretched else 1.0
        # Loaded over free area, of a cylinder.
        shape = np.sqrt(self.area / np.pi) / (2 * self.length) if stretched else 0.0
        self.p = SimpleNamespace(**{**vars(p), "shape_factor": shape, "specimen_length": self.length})
        clock = np.zeros(at.x.size) if at.time_s is None else at.time_s - at.time_s[0]
        self.time = clock[:, None]
        self.displacement = (at.x - experiment.rest)[:, None] * self.length
        self.force = at.mean[:, None] * self.area

    def specimen(self, history: LoadingHistory) -> LoadingHistory:
        """The history of the specimen itself, (n, m) if ``p`` has arrays."""
        shown, _ = self.model.record(self.displacement, self.force, self.time, self.p)
        own = history.rest + (2 * self.displacement - shown) / self.length
        # Travel shown before the specimen is met does nothing to it: a strip is slack, a plate in air.
        way = np.sign(self.displacement[np.argmax(np.abs(self.displacement))])
        before = (way * np.real(own - history.rest) < 0) & (way * self.displacement >= 0)
        own = np.where(np.logical_and.accumulate(before, axis=0), history.rest, own)
        if history.rest == 1.0 and np.min(np.real(own)) < 0.05:
            raise ComputationFailed("the machine would give by more than the specimen's length")
        return replace(history, x=own)

    def reading(self, stress: np.ndarray) -> np.ndarray:
        """Recorded (n, m) for the specimen's stress or traction (n, m)."""
        return self.model.record(self.displacement, stress * self.area, self.time, self.p)[1] / self.area
