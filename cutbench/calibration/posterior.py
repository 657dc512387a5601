"""One likelihood of all tests, whatever they are, and the most probable parameters of a model.

readings = prediction(θ) + discrepancy + noise + error of the emulator and of the mesh: one Gaussian a test,
with the covariance of ``cutbench.data.covariance`` and the discrepancy of ``cutbench.data.discrepancy``,
whose size is the likeliest (Kennedy & O'Hagan 2001, 10.1111/1467-9868.00294; Brynjarsdóttir & O'Hagan 2014,
10.1088/0266-5611/30/11/114007). Parameters are normal beforehand, broadly. The marginal likelihood is
Laplace's (Kass & Raftery 1995, 10.1080/01621459.1995.10476572).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.looked_for import visible
from cutbench.calibration.mesh_error import guessed_error
from cutbench.calibration.predict import Predictions
from cutbench.data.covariance import Covariance
from cutbench.data.discrepancy import allowing, likelihood
from cutbench.data.experiment import Experiment


@dataclass(frozen=True)
class EstimationSettings:
    """What an estimate rests on beside the data.

    Attributes
    ----------
    broad : float
        Standard deviation beforehand of a parameter of the baseline, as a logarithm or in units of its start:
        a factor of twenty either way, so that only what the data do not tell feels it.
    steps, turns : int
        So many steps at most are made with one covariance, and so often at most it is found anew.
    still : float
        They are found when no parameter moves by more than this part of its own standard deviation.
    absurd : float
        A prediction that is so many times the largest reading counts as none.
    """

    broad: float = 3.0
    steps: int = 8
    turns: int = 8
    still: float = 0.1
    absurd: float = 1e4


SETTINGS = EstimationSettings()


@dataclass(frozen=True)
class Evaluated:
    """All fitted tests at one place: by id the ``residual`` (m,), predicted less measured, its derivatives
    ``J`` (m, k) by the scaled parameters, and the ``error`` (m, m) of the prediction."""

    q: np.ndarray
    y: Mapping[str, np.ndarray]
    residual: Mapping[str, np.ndarray]
    J: Mapping[str, np.ndarray]
    error: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class MeshError:
    """Of one cut: what is added to the computed curve (m,), and the covariance (m, m) of what is missing."""

    shift: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Posterior:
    """A model's parameters given the tests.

    Attributes
    ----------
    predictions : Predictions
        What the model says.
    parameters : tuple of Unknown
        What is looked for. One with an ``experiment`` is that test's own.
    widths, centres : ndarray, shape (k,)
        Standard deviations and means beforehand of the scaled parameters.
    mesh : mapping
        By id, the error of the mesh of a cut.
    """

    predictions: Predictions
    parameters: tuple[Unknown, ...]
    widths: np.ndarray
    centres: np.ndarray
    mesh: Mapping[str, MeshError] = field(default_factory=dict)

    @classmethod
    def of(cls, predictions: Predictions, parameters: Sequence[Unknown]) -> Posterior:
        """Of a baseline, whose parameters may be anything beforehand."""
        size = len(parameters)
        return cls(predictions, tuple(parameters), np.full(size, SETTINGS.broad), np.zeros(size))

    @property
    def tests(self) -> tuple[Experiment, ...]:
        """Those that are fitted."""
        return self.predictions.campaign.train

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the scaled parameters (k,) each."""
        reach = np.array([u.reach for u in self.parameters]).reshape(-1, 2)
        return reach[:, 0], reach[:, 1]

    @cached_property
    def mine(self) -> dict[str, list[int]]:
        """By id, the numbers of the parameters that a test depends on."""
        base = self.predictions.base
        return {
            e.id: [
                k for k, u in enumerate(self.parameters)
                if u.name in visible(e, base) and u.experiment in (None, e.id)
            ]
            for e in self.predictions.campaign.experiments
        }  # fmt: skip

    def values(self, e: Experiment, q: np.ndarray) -> dict[str, float]:
        """Values of the parameters of a test, internal units; the mean of the others' own where it has
        none."""
        found: dict[str, float] = {}
        for name in dict.fromkeys(u.name for u in self.parameters):
            all_ = [
                (u.experiment, u.value(x)) for u, x in zip(self.parameters, q, strict=True) if u.name == name
            ]
            mine = [v for of, v in all_ if of in (None, e.id)]
            found[name] = float(np.mean(mine or [v for _, v in all_]))
        return found

    def evaluate(self, q: np.ndarray, tests: Sequence[Experiment] | None = None) -> Evaluated:
        """All fitted tests at the scaled parameters ``q`` (k,). Raises NotKnown, ComputationFailed."""
        y, residual, J, error = {}, {}, {}, {}
        for e in self.tests if tests is None else tests:
            mine = self.mine[e.id]
            names = tuple(dict.fromkeys(self.parameters[k].name for k in mine))
            p = self.predictions.predict(e, self.values(e, q), names)
            largest = SETTINGS.absurd * np.abs(self.predictions.grids[e.id].mean).max()
            if not (np.isfinite(p.slopes).all() and np.abs(p.y).max() < largest):
                raise ComputationFailed(f"'{e.id}': what is predicted makes no sense")
            mesh = self.mesh_error(e, p.y)
            y[e.id] = p.y + mesh.shift
            error[e.id] = p.root @ p.root.T + mesh.covariance
            residual[e.id] = y[e.id] - self.predictions.grids[e.id].mean
            J[e.id] = np.zeros((p.y.size, len(self.parameters)))
            for k in mine:
                u = self.parameters[k]
                J[e.id][:, k] = p.slopes[:, names.index(u.name)] * u.slope(q[k])
        return Evaluated(q, y, residual, J, error)

    def mesh_error(self, e: Experiment, y: np.ndarray) -> MeshError:
        """What is known of the mesh's error, or guessed before it was measured; none of what has no mesh."""
        if e.id in self.mesh:
            return self.mesh[e.id]
        if e.kind == "cut":
            return MeshError(np.zeros(y.size), guessed_error(self.predictions.grids[e.id].along, y))
        return MeshError(np.zeros(y.size), np.zeros((y.size, y.size)))

    def noise(self, at: Evaluated) -> Covariance:
        """Of all readings, with the error of what is predicted, without a discrepancy."""
        kinds = {e.id: e.kind for e in self.predictions.campaign.experiments if e.id in at.y}
        return Covariance.of(self.predictions.grids, kinds, at.y, at.error)

    def covariance(self, at: Evaluated) -> Covariance:
        """The same with each test's likeliest discrepancy."""
        return allowing(self.noise(at), at.residual, at.J)

    def log_prior(self, q: np.ndarray) -> float:
        """Logarithm of the density of ``q`` beforehand."""
        return (
            -0.5 * float((((q - self.centres) / self.widths) ** 2).sum())
            - float(np.log(self.widths).sum())
            - (0.5 * q.size * math.log(2 * math.pi))
        )

    def whitened(self, at: Evaluated, w: Covariance) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (M,) and derivatives (M, k), with a row a parameter for what is expected beforehand."""
        r, J = w.white(at.residual), w.white(at.J)
        return np.append(r, (at.q - self.centres) / self.widths), np.vstack([J, np.diag(1 / self.widths)])

    def maximum(self, q: np.ndarray) -> Estimated:
        """The most probable parameters near ``q`` (k,). Raises NotKnown, ComputationFailed."""
        low, high = self.bounds
        known: dict[bytes, Evaluated] = {}

        def evaluated(x: np.ndarray) -> Evaluated:
            if x.tobytes() not in known:
                known[x.tobytes()] = self.evaluate(x)
            return known[x.tobytes()]

        at = evaluated(_within(np.clip(q, low, high), low, high))
        size = sum(y.size for y in at.y.values()) + q.size
        for _ in range(SETTINGS.turns):
            w, before = self.covariance(at), at.q

            def white(x: np.ndarray, w: Covariance = w) -> tuple[np.ndarray, np.ndarray]:
                try:
                    return self.whitened(evaluated(x), w)
                except ComputationFailed:  # no answer there: as bad as can be
                    return np.full(size, 1e3), np.zeros((size, x.size))

            found = least_squares(
                lambda x: white(x)[0], before, lambda x: white(x)[1], bounds=(low, high), x_scale="jac",
                max_nfev=SETTINGS.steps, xtol=1e-4, ftol=1e-4,
            )  # fmt: skip
            at = evaluated(_within(found.x, low, high))
            precision = np.linalg.norm(self.whitened(at, w)[1], axis=0)
            if np.all(np.abs(at.q - before) * precision <= SETTINGS.still):
                break
        return Estimated(self, at, self.covariance(at))


def _within(q: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Off the bounds, as the search wants its start."""
    width = np.where(np.isfinite(high - low), high - low, 1.0)
    return np.clip(q, low + 1e-8 * width, high - 1e-8 * width)


@dataclass(frozen=True)
class Estimated:
    """The most probable parameters of a model: where, and the covariance of the readings there."""

    posterior: Posterior
    at: Evaluated
    w: Covariance

    @property
    def q(self) -> np.ndarray:
        """(k,) scaled."""
        return self.at.q

    @property
    def log_likelihood(self) -> float:
        """But for a constant."""
        return 0.5 * likelihood(self.w, self.at.residual)

    @property
    def log_posterior(self) -> float:
        """Of likelihood and prior, but for a constant."""
        return self.log_likelihood + self.posterior.log_prior(self.q)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(k, k) of the scaled parameters, afterwards."""
        J = self.posterior.whitened(self.at, self.w)[1]
        return np.linalg.inv(J.T @ J)

    @property
    def log_evidence(self) -> float:
        """Logarithm of the marginal likelihood (Laplace), but for the same constant."""
        volume = 0.5 * (np.linalg.slogdet(self.covariance)[1] + self.q.size * math.log(2 * math.pi))
        return self.log_posterior + volume

    def values(self) -> dict[str, float]:
        """By label, internal units."""
        return {u.label: u.value(x) for u, x in zip(self.posterior.parameters, self.q, strict=True)}
