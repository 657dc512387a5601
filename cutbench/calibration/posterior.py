"""One likelihood of all tests, whatever they are, and the most probable parameters of a model.

readings = prediction(θ) + discrepancy + noise + error of the emulator and of the mesh: one Gaussian a test,
with the covariance of ``cutbench.data.covariance`` and the discrepancy of ``cutbench.data.covariance``,
whose size is the likeliest (Kennedy & O'Hagan 2001, 10.1111/1467-9868.00294; Brynjarsdóttir & O'Hagan 2014,
10.1088/0266-5611/30/11/114007). Parameters are normal beforehand, broadly. The marginal likelihood is
Laplace's (Kass & Raftery 1995, 10.1080/01621459.1995.10476572).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.mesh_error import guessed_error
from cutbench.calibration.parameters import FreeParameter, parameters_felt_by
from cutbench.calibration.prediction import NotComputed, Predicted, Predictions
from cutbench.calibration.settings import SETTINGS
from cutbench.case.case import Case
from cutbench.data.covariance import Block, Covariance, twice_log_likelihood, with_discrepancy
from cutbench.data.experiment import Experiment

#: A prediction that is so many times the largest reading counts as none.
MAX_PREDICTION_RATIO = 1e4
#: A parameter is at a bound that is nearer than this.
AT_BOUND = 1e-6
#: So many steps at most are made with one covariance, and so often at most it is found anew, until no
#: parameter moves by more than this part of its own standard deviation; or, of cuts, the log posterior grows
#: by less twice.
MAX_STEPS, MAX_FIXED_POINT_ITERATIONS, STATIONARY = 12, 8, 0.1


@dataclass(frozen=True)
class Evaluated:
    """All fitted tests at one place: by id the ``residual`` (m,), predicted less measured, its derivatives
    ``J`` (m, k) by the scaled parameters, and the ``error`` (m, m) of the prediction."""

    q: np.ndarray
    y: Mapping[str, np.ndarray]
    residual: Mapping[str, np.ndarray]
    J: Mapping[str, np.ndarray]
    error: Mapping[str, np.ndarray]
    onset_mm: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LinearFields:
    """Displacement fields of one cut about a place ``q`` (k,): computed less measured ``residual`` (f,), its
    derivatives ``J`` (f, k) by the scaled parameters, and the covariance of the measured ones."""

    q: np.ndarray
    residual: np.ndarray
    J: np.ndarray
    block: Block


@dataclass(frozen=True)
class MeshError:
    """Of one cut: what is added to the computed curve (m,), the covariance (m, m) of what is missing, what
    finer numerics change (m,), and how large that is beside a guess, before the cut begins and behind it.

    All but the last hold where they were measured: elsewhere a cut begins at another place.
    """

    shift: np.ndarray
    covariance: np.ndarray
    change: np.ndarray
    sizes: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True)
class Posterior:
    """A model's parameters given the tests.

    Attributes
    ----------
    predictions : Predictions
        What the model says.
    parameters : tuple of FreeParameter
        What is looked for. One with an ``experiment`` is that test's own.
    prior_sds, prior_means : ndarray, shape (k,)
        Standard deviations and means of the scaled parameters' prior distribution.
    mesh : mapping
        By id, the error of the mesh of a cut.
    fields : mapping
        By id, the displacement fields of a cut.
    fixed_q : mapping
        By number, scaled parameters that stay where they are.
    local_mesh_error : bool
        Whether the error of the mesh is that of the place where it was measured, or only as large.
    """

    predictions: Predictions
    parameters: tuple[FreeParameter, ...]
    prior_sds: np.ndarray
    prior_means: np.ndarray
    mesh: Mapping[str, MeshError] = field(default_factory=dict)
    fields: Mapping[str, LinearFields] = field(default_factory=dict)
    fixed_q: Mapping[int, float] = field(default_factory=dict)
    local_mesh_error: bool = True

    @classmethod
    def of(cls, predictions: Predictions, parameters: Sequence[FreeParameter]) -> Posterior:
        """Of a baseline, whose parameters may be anything beforehand."""
        sds = SETTINGS.broad * np.array([u.spread for u in parameters])
        return cls(predictions, tuple(parameters), sds, np.zeros(len(parameters)))

    @property
    def smooth(self) -> Posterior:
        """The same by the emulator alone, also where cuts were computed."""
        return replace(self, predictions=self.predictions.smooth)

    @property
    def tests(self) -> tuple[Experiment, ...]:
        """Those that are fitted."""
        return self.predictions.campaign.train

    @property
    def cuts(self) -> list[Experiment]:
        """Those of them that are cuts."""
        return [e for e in self.tests if e.kind == "cut"]

    @property
    def tests_with_runs(self) -> list[Experiment]:
        """Those of them that are known from runs."""
        return [e for e in self.tests if self.predictions.needs_runs(e)]

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the scaled parameters (k,) each."""
        reach = np.array([u.reach for u in self.parameters]).reshape(-1, 2)
        for k, q in self.fixed_q.items():
            reach[k] = q - AT_BOUND, q + AT_BOUND
        return reach[:, 0], reach[:, 1]

    @cached_property
    def parameter_numbers(self) -> dict[str, list[int]]:
        """By id, the numbers of the parameters that a test depends on."""
        base = self.predictions.base
        return {
            e.id: [
                k for k, u in enumerate(self.parameters)
                if u.name in parameters_felt_by(e, base) and u.experiment in (None, e.id)
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

    def case(self, q: np.ndarray) -> Case:
        """The model at ``q`` (k,); the mean where each test has a value of its own."""
        found: dict[str, list[float]] = {}
        for u, x in zip(self.parameters, q, strict=True):
            found.setdefault(u.name, []).append(u.value(x))
        base = self.predictions.base
        return replace(base, values={**base.values, **{n: float(np.mean(v)) for n, v in found.items()}})

    def evaluate(
        self,
        q: np.ndarray,
        tests: Sequence[Experiment] | None = None,
        differentiate: bool = True,
        sure: bool = False,
    ) -> Evaluated:
        """All fitted tests at the scaled parameters ``q`` (k,), with derivatives or without, with errors or
        as if predictions were ``sure``. Raises NotComputed, ComputationFailed."""
        y, residual, J, error, onset = {}, {}, {}, {}, {}
        for e in self.tests if tests is None else tests:
            mine = self.parameter_numbers[e.id] if differentiate else []
            names = tuple(dict.fromkeys(self.parameters[k].name for k in mine))
            p = self.predicted(e, self.values(e, q), names, sure)
            mesh = self.mesh_error(e, p.y, p.onset_mm)
            y[e.id], onset[e.id] = p.y + mesh.shift, p.onset_mm
            error[e.id] = p.root @ p.root.T + mesh.covariance
            residual[e.id] = y[e.id] - self.predictions.grids[e.id].mean
            J[e.id] = np.zeros((p.y.size, len(self.parameters)))
            for k in mine:
                u = self.parameters[k]
                J[e.id][:, k] = p.slopes[:, names.index(u.name)] * u.slope(q[k])
        return Evaluated(q, y, residual, J, error, onset)

    def predicted(
        self, e: Experiment, values: Mapping[str, float], names: Sequence[str], sure: bool = False
    ) -> Predicted:
        """What a test reads. Raises NotComputed, ComputationFailed."""
        try:
            p = self.predictions.predict(e, values, names, sure)
        except NotComputed:  # a cut that was computed says itself what it gives
            p = self.predictions.computed(e, values, names)
        largest = MAX_PREDICTION_RATIO * np.abs(self.predictions.grids[e.id].mean).max()
        if not (np.isfinite(p.slopes).all() and np.isfinite(p.root).all() and np.abs(p.y).max() < largest):
            raise ComputationFailed(f"'{e.id}': what is predicted makes no sense")
        return p

    def mesh_error(self, e: Experiment, y: np.ndarray, onset_mm: float) -> MeshError:
        """What is known of the mesh's error of a curve ``y`` (m,) that begins at ``onset_mm``, or guessed
        before it was measured; none of what has no mesh."""
        if self.local_mesh_error and e.id in self.mesh:
            return self.mesh[e.id]
        if self.predictions.needs_runs(e):
            meet = self.predictions.parts_meet_mm(e, onset_mm)
            sizes = self.mesh[e.id].sizes if e.id in self.mesh else (1.0, 1.0)
            guess = guessed_error(self.predictions.grids[e.id], y, meet, sizes)
            return MeshError(np.zeros(y.size), guess, np.zeros(y.size))
        return MeshError(np.zeros(y.size), np.zeros((y.size, y.size)), np.zeros(y.size))

    def noise(self, at: Evaluated) -> Covariance:
        """Of all readings, with the error of what is predicted, without a discrepancy."""
        kinds = {e.id: e.kind for e in self.predictions.campaign.experiments if e.id in at.y}
        return Covariance.of(self.predictions.grids, kinds, at.y, at.error)

    def covariance(self, at: Evaluated) -> Covariance:
        """The same with each test's likeliest discrepancy. A parameter at a bound takes up nothing that is
        beyond it."""
        inside = self.inside(at.q)
        return with_discrepancy(self.noise(at), at.residual, {id: J * inside for id, J in at.J.items()})

    def inside(self, q: np.ndarray) -> np.ndarray:
        """Which of ``q`` (k,) no bound holds."""
        low, high = self.bounds
        return (q - low > AT_BOUND) & (high - q > AT_BOUND)

    def log_prior(self, q: np.ndarray) -> float:
        """Logarithm of the density of ``q`` beforehand."""
        return (
            -0.5 * float((((q - self.prior_means) / self.prior_sds) ** 2).sum())
            - float(np.log(self.prior_sds).sum())
            - (0.5 * q.size * math.log(2 * math.pi))
        )

    def whitened(self, at: Evaluated, w: Covariance) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (M,) and derivatives (M, k): of the tests, of their fields, and a row a parameter for
        what is expected beforehand."""
        r, J = w.white(at.residual), w.white(at.J)
        more = [
            (f.block.white(f.residual + f.J @ (at.q - f.q)), f.block.white(f.J)) for f in self.fields.values()
        ]
        before = (at.q - self.prior_means) / self.prior_sds, np.diag(1 / self.prior_sds)
        rows, columns = zip((r, J), *more, before, strict=True)
        return np.concatenate(rows), np.vstack(columns)

    def maximum(self, q: np.ndarray, reach: np.ndarray | float = math.inf) -> Estimated:
        """The most probable parameters near ``q`` (k,), no farther from it than ``reach``. Raises
        NotComputed, ComputationFailed."""
        low, high = self.bounds
        low, high = np.maximum(low, q - reach), np.minimum(high, q + reach)
        at = self.evaluate(_strictly_within(np.clip(q, low, high), low, high))
        size = (
            sum(y.size for y in at.y.values()) + sum(f.residual.size for f in self.fields.values()) + q.size
        )
        best = last = Estimated(self, at, self.covariance(at))
        in_vain = 0
        for _ in range(MAX_FIXED_POINT_ITERATIONS):
            w, before = last.w, last.q

            def white(x: np.ndarray, w: Covariance = w) -> tuple[np.ndarray, np.ndarray]:
                try:  # one covariance holds for many places, so none asks for errors
                    return self.whitened(self.evaluate(x, sure=True), w)
                except ComputationFailed:  # no answer there: as bad as can be
                    return np.full(size, 1e3), np.zeros((size, x.size))

            found = least_squares_fit(white, before, low, high)
            at = self.evaluate(_strictly_within(found.x, low, high))
            precision = np.linalg.norm(self.whitened(at, w)[1], axis=0)
            last = Estimated(self, at, self.covariance(at))
            gained = last.log_posterior - best.log_posterior
            best = last if gained > 0 else best
            # An emulator has kinks, about which a search may go on for ever.
            in_vain = in_vain + 1 if gained < STATIONARY else 0
            if (self.cuts and in_vain > 1) or np.all(np.abs(at.q - before) * precision <= STATIONARY):
                return best
        return replace(best, settled=False)


def least_squares_fit(
    off: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    q: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> OptimizeResult:
    """Where residuals are least, from ``q`` (k,) between two ends; ``off`` gives them with their
    derivatives."""
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def both(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in known:
            known[x.tobytes()] = off(x)
        return known[x.tobytes()]

    return least_squares(
        lambda x: both(x)[0], q, lambda x: both(x)[1], bounds=(low, high), x_scale="jac",
        max_nfev=MAX_STEPS, xtol=1e-4, ftol=1e-4,
    )  # fmt: skip


def _strictly_within(q: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Off the bounds, as the search wants its start."""
    width = np.minimum(high - low, 1.0)
    return np.clip(q, low + 1e-8 * width, high - 1e-8 * width)


@dataclass(frozen=True)
class Estimated:
    """The most probable parameters of a model.

    Attributes
    ----------
    posterior : Posterior
        Of which it is the maximum.
    at : Evaluated
        All fitted tests there.
    w : Covariance
        Of the readings, with the likeliest discrepancies.
    settled : bool
        Whether nothing more is gained from there, as far as that is known.
    """

    posterior: Posterior
    at: Evaluated
    w: Covariance
    settled: bool = True

    @property
    def q(self) -> np.ndarray:
        """(k,) scaled."""
        return self.at.q

    @cached_property
    def log_likelihood(self) -> float:
        """With the likeliest discrepancy of each test, but for a constant."""
        noise = self.w.noise
        fields = (f.block.white(f.residual + f.J @ (self.q - f.q)) for f in self.posterior.fields.values())
        volume = sum(block.volume for block in noise.tests.values())
        return 0.5 * (
            twice_log_likelihood(noise, self.at.residual) - volume - sum(float(r @ r) for r in fields)
        )

    @property
    def log_posterior(self) -> float:
        """Of likelihood and prior, but for a constant."""
        return self.log_likelihood + self.posterior.log_prior(self.q)

    @property
    def chi2(self) -> float:
        """Square of the tests' whitened residuals."""
        r = self.w.white(self.at.residual)
        return float(r @ r)

    @cached_property
    def white_J(self) -> np.ndarray:
        """Whitened derivatives (M, k), with what is expected beforehand last."""
        return self.posterior.whitened(self.at, self.w)[1]

    @cached_property
    def covariance(self) -> np.ndarray:
        """(k, k) of the scaled parameters, afterwards."""
        return np.linalg.inv(self.white_J.T @ self.white_J)

    @property
    def log_evidence(self) -> float:
        """Logarithm of the marginal likelihood (Laplace), but for the same constant."""
        volume = 0.5 * (np.linalg.slogdet(self.covariance)[1] + self.q.size * math.log(2 * math.pi))
        return self.log_posterior + volume

    def values(self) -> dict[str, float]:
        """By label, internal units."""
        return {u.label: u.value(x) for u, x in zip(self.posterior.parameters, self.q, strict=True)}

    @property
    def case(self) -> Case:
        """The model with the values found; the mean where each test has its own."""
        return self.posterior.case(self.q)

    def predicted(self, e: Experiment) -> Predicted:
        """What the model says of any test, with derivatives by its free parameters. Raises
        ComputationFailed."""
        names = tuple(
            dict.fromkeys(self.posterior.parameters[k].name for k in self.posterior.parameter_numbers[e.id])
        )
        return self.posterior.predicted(e, self.posterior.values(e, self.q), names)

    def scaled_slopes(self, e: Experiment) -> np.ndarray:
        """Derivatives (m, k) of any test by the scaled parameters. Raises ComputationFailed."""
        return self.posterior.evaluate(self.q, [e]).J[e.id]
