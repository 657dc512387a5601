"""What a fit leaves: estimates with intervals, each experiment beside its computed curve, profiles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.handled import Handled
from cutbench.base.toml import one_of
from cutbench.calibration.identifiability import Identifiability, Unknown, correlations
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.covariance import Covariance
from cutbench.data.experiment import Experiment
from cutbench.run.measures import TRANSITION

#: Parts of a cut, in the order in which they come.
REGIMES = ("indentation", "onset", "transition", "steady")
#: A model that misses more than this part of a curve's maximum is far from the data.
FAR = 0.05
#: Of intervals.
LEVEL = 0.95


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class Estimate:
    """One parameter after the fit, internal units. ``low``/``high``: 95 % interval; ``sd`` of the value."""

    unknown: Unknown
    value: float
    low: float
    high: float
    sd: float
    dof: float
    at_bound: bool
    moved: bool

    @property
    def label(self) -> str:
        return self.unknown.label


@dataclass(frozen=True)
class ComparedCurve:
    """One experiment beside the fit, on its grid: ``fitted`` (m,) is the computed curve, corrected for its
    mesh; ``sd`` (m,) the measurement's and the computation's together. ``discrepancy`` (m,), measured less
    computed: what the model cannot describe of a fitted test, as far as readings tell it from noise."""

    experiment: Experiment
    x: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    fitted: np.ndarray
    onset_mm: float
    thickness_mm: float
    discrepancy: np.ndarray | None = None

    @property
    def missed(self) -> float:
        """Root mean square of the discrepancy, as a part of the largest value."""
        return 0.0 if self.discrepancy is None else _rms(self.discrepancy) / float(np.abs(self.mean).max())

    @property
    def residual(self) -> np.ndarray:
        """Measured less computed."""
        return self.mean - self.fitted

    @property
    def rmse(self) -> float:
        return _rms(self.residual)

    def regimes(self) -> dict[str, np.ndarray]:
        """Which grid values (m,) lie in which regime of a cut, by the onset that was computed.

        ``onset`` is one blade thickness before it, ``transition`` four after it. Regimes without a value
        are left out; a test that is no cut has none.
        """
        if self.experiment.kind != "cut":
            return {}
        onset = self.onset_mm if math.isfinite(self.onset_mm) else math.inf
        w = self.thickness_mm
        edges = (-math.inf, onset - w, onset, onset + TRANSITION * w, math.inf)
        masks = {
            name: (self.x > low) & (self.x <= high)
            for name, low, high in zip(REGIMES, edges[:-1], edges[1:], strict=True)
        }
        return {name: mask for name, mask in masks.items() if mask.any()}


@dataclass(frozen=True)
class Profile:
    """χ² above its minimum (n,) at ``values`` (n,) of one parameter (internal units), all others fitted
    again; ``low``/``high`` where it reaches the level of the interval (nan: not within what was tried)."""

    label: str
    values: np.ndarray
    rise: np.ndarray
    low: float
    high: float


@dataclass(frozen=True, repr=False)
class Fit(Handled):
    """What a fit leaves. ``covariance`` (k, k) of the scaled parameters, widened by the reduced χ² where that
    is above 1; ``case``: the model with the values found; ``before``/``after``: what the data can tell at
    the start and at the end; ``fixed``: what the fit left at its start, with the reason. ``status``:
    ``converged``, ``stopped`` or ``interrupted``. ``inverse`` is the problem that was solved, ``q`` (k,) its
    answer, ``data_covariance`` that of the readings less the computed curves.
    """

    handled_in: ClassVar[str] = "cutbench.calibration.handled"

    campaign: Campaign
    case: Case
    estimates: tuple[Estimate, ...]
    fixed: Mapping[str, str]
    covariance: np.ndarray
    chi2: float
    readings: int
    status: str
    message: str
    compared: tuple[ComparedCurve, ...]
    before: Identifiability
    after: Identifiability
    notes: tuple[str, ...]
    evaluations: int
    history: tuple[float, ...]
    seconds: float
    inverse: Inverse
    q: np.ndarray
    data_covariance: Covariance
    profiles: tuple[Profile, ...] = field(default=())

    @property
    def values(self) -> dict[str, float]:
        """By label, in internal units."""
        return {e.label: e.value for e in self.estimates}

    @property
    def correlation(self) -> np.ndarray:
        return correlations(self.covariance)

    @property
    def reduced_chi2(self) -> float:
        return self.chi2 / max(self.readings - len(self.estimates), 1)

    @property
    def far(self) -> str:
        """That no parameters bring the model near the data, and how near; empty where some do."""
        missed, id = max(((c.missed, c.experiment.id) for c in self.compared), default=(0.0, ""))
        if missed <= FAR:
            return ""
        return (
            f"No parameters that were tried bring this model near the data: it misses {100 * missed:.0f} % of"
            f" the maximum of '{id}' (root mean square). Estimates are those of a wrong model."
        )

    def estimate(self, label: str) -> Estimate:
        """Raises BadInput for a label that was not fitted."""
        for e in self.estimates:
            if e.label == label:
                return e
        labels = [e.label for e in self.estimates]
        raise BadInput("parameter", label, one_of(label, labels))


def beside(
    e: Experiment, inverse: Inverse, p: Prediction, y: np.ndarray, sd: np.ndarray, q: np.ndarray
) -> ComparedCurve:
    """What is computed, ``y`` (m,) beside what was measured of ``e``."""
    grid, case = inverse.grids[e.id], inverse.case(e, q)
    return ComparedCurve(e, grid.x, grid.mean, sd, y, p.onset_mm, case.values.get("thickness", np.nan))
