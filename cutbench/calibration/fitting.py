"""Fit: the parameters of one model from all tests of a campaign at once, with intervals.

The most probable values come from ``cutbench.calibration.estimation``, with noise, scatter of specimens, what
the model misses and the error of the computation in one covariance. Intervals come from (JᵀC⁻¹J)⁻¹ with
Student's t: what stems from the scatter between R specimens is known with R − 1 degrees of freedom, and the
parts are combined after Welch (1947, 10.1093/biomet/34.1-2.28) and Satterthwaite (1946, 10.2307/3002019).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy import stats

from cutbench.base.display import Displayed
from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.notebook import watched
from cutbench.base.progress import ALWAYS, OnProgress, Until, silent
from cutbench.base.threads import cores
from cutbench.base.toml import one_of
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.estimation import best_known, drop_unidentifiable, successive_estimates
from cutbench.calibration.identifiability import Identifiability, correlations, identifiability
from cutbench.calibration.mesh_error import MODEL, begun_later
from cutbench.calibration.parameters import FreeParameter, free_parameters
from cutbench.calibration.posterior import Estimated, Posterior
from cutbench.calibration.prediction import Predictions
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign, cut_case
from cutbench.data.covariance import (
    DISCREPANCY_LENGTH,
    Discrepancies,
    degrees_of_freedom,
    discrepancy_mean,
)
from cutbench.data.experiment import Experiment
from cutbench.data.fields import laid_out
from cutbench.data.measures import MeasuredCut
from cutbench.data.repetition import note_on_single_repetition
from cutbench.run.measures import SETTLED
from cutbench.run.pool.pool import TaskPool

#: Values on which each test is compared.
GRID = 40
#: Parts of a cut, in the order in which they come.
REGIMES = ("indentation", "onset", "transition", "steady")
#: A model that misses more than this part of a curve's maximum is far from the data.
FAR = 0.05
#: Of a test's course, over which what a model misses may be correlated; the first is that of its likelihood.
CORRELATION_LENGTHS = tuple(DISCREPANCY_LENGTH * 2**k for k in range(5))
#: Of intervals, and how far in q a parameter has moved that is not where it began.
LEVEL, UNMOVED = 0.95, 1e-6
#: How a fit ends.
CONVERGED, STOPPED, INTERRUPTED, LATE = "converged", "stopped", "interrupted", "out of time"
UNDER_WAY = "under way"


@dataclass(frozen=True)
class Estimate:
    """One parameter after the fit.

    Attributes
    ----------
    parameter : FreeParameter
        Which.
    value, low, high, sd : float
        Its value, the ends of its 95 % interval, and its standard deviation, internal units.
    dof : float
        Degrees of freedom of the standard deviation.
    at_bound, moved : bool
        Whether it lies at a bound, and elsewhere than it began.
    """

    parameter: FreeParameter
    value: float
    low: float
    high: float
    sd: float
    dof: float
    at_bound: bool
    moved: bool

    @property
    def label(self) -> str:
        """``G_c``, or ``tau_W[slow]`` for one test's own."""
        return self.parameter.label


@dataclass(frozen=True)
class ComparedCurve:
    """One test beside the fit, on its grid.

    Attributes
    ----------
    experiment : Experiment
        The test.
    x, mean, sd : ndarray, shape (m,)
        Abscissa, measured mean, and the standard deviation of measurement and computation together.
    fitted : ndarray, shape (m,)
        The computed curve, corrected for its mesh.
    onset_mm, thickness_mm : float
        Where the cut begins, and how thick the blade is; nan where there is none.
    discrepancy : ndarray, shape (m,), optional
        Measured less computed: what the model cannot describe of a fitted test, as far as readings tell it
        from noise.
    computed : tuple of float
        What is computed of each measure, in its own unit, where measures and no curve are known.
    """

    experiment: Experiment
    x: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    fitted: np.ndarray
    onset_mm: float
    thickness_mm: float
    discrepancy: np.ndarray | None = None
    computed: tuple[float, ...] = ()

    @property
    def misfit(self) -> float:
        """Root mean square of the discrepancy, as a part of the largest value."""
        return 0.0 if self.discrepancy is None else _rms(self.discrepancy) / float(np.abs(self.mean).max())

    @property
    def residual(self) -> np.ndarray:
        """Measured less computed."""
        return self.mean - self.fitted

    @property
    def rmse(self) -> float:
        """Its root mean square."""
        return _rms(self.residual)

    @property
    def relative_rmse(self) -> float:
        """That as a part of the largest value: what is drawn between both."""
        return self.rmse / float(np.abs(self.mean).max())

    def regimes(self) -> dict[str, np.ndarray]:
        """Which grid values (m,) lie in which regime of a cut, by the onset that was computed.

        ``onset`` is one blade thickness before it, ``transition`` four after it. Regimes without a value
        are left out; a test that is no cut has none.
        """
        w = self.thickness_mm
        if math.isnan(w) or not self.experiment.curve:
            return {}
        onset = self.onset_mm if math.isfinite(self.onset_mm) else math.inf
        edges = (-math.inf, onset - w, onset, onset + SETTLED * w, math.inf)
        masks = {
            name: (self.x > low) & (self.x <= high)
            for name, low, high in zip(REGIMES, edges[:-1], edges[1:], strict=True)
        }
        return {name: mask for name, mask in masks.items() if mask.any()}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class Profile:
    """The profile likelihood of one parameter.

    Attributes
    ----------
    label : str
        Which.
    values, rise : ndarray, shape (n,)
        Values, internal units, and how far twice the log posterior falls from its maximum there, all other
        parameters fitted again.
    low, high : float
        Where it has fallen as far as at the ends of an interval; nan where that was not tried.
    """

    label: str
    values: np.ndarray
    rise: np.ndarray
    low: float
    high: float


@dataclass(frozen=True, repr=False)
class Fit(Displayed):
    """A fit is a model whose free parameters were estimated from all tests of a campaign at once.

    Intervals are of 95 %. What stems from the scatter between R specimens is known with R − 1 degrees of
    freedom, and the parts are combined after Welch (1947, 10.1093/biomet/34.1-2.28) and Satterthwaite (1946,
    10.2307/3002019).

    Attributes
    ----------
    campaign : Campaign
        The tests.
    estimated : Estimated or None
        The posterior at its maximum; None where a fit was stopped before it had any.
    case : Case
        The model with the fitted values.
    estimates : tuple of Estimate
        The k fitted parameters, with their intervals.
    fixed : mapping of str to str
        Why a parameter was left at its start, by its label.
    covariance : ndarray, shape (k, k)
        Of the scaled parameters; nan where nothing was estimated.
    status : str
        ``converged``, ``stopped``, ``interrupted`` or ``out of time``.
    message : str
        More of that.
    compared : tuple of ComparedCurve
        Each test beside its computed curve.
    before : Identifiability
        What the data can tell at the start.
    after : Identifiability
        What they can tell at the end.
    notes : tuple of str
        What else a person should know.
    runs : int
        Cuts that were computed.
    seconds : float, s
        How long it took.
    profiles : tuple of Profile
        Profile likelihoods, where they were asked for.

    Examples
    --------
    >>> import cutbench
    >>> import numpy as np
    >>> from cutbench.data import Experiment, FitPlan, Repetition, start_case
    >>> stretch = np.linspace(1.02, 1.5, 30)
    >>> stress = 0.01 * (stretch - stretch**-2)  # MPa, of a solid whose shear modulus is 10 kPa
    >>> pulled = Experiment("pulled", "uniaxial", (Repetition(stretch, stress),))
    >>> laws, soft = ["neo_hookean", "volumetric"], {"G": "20 kPa", "nu": 0.499}
    >>> base, _ = start_case(None, baseline=laws, kinds=["uniaxial"], parameters=soft)
    >>> campaign = cutbench.Campaign("Pulled", base, (pulled,), plan=FitPlan(free=("G",)))
    >>> found = cutbench.fit(campaign, workers=0)
    >>> one = found.estimate("G")
    >>> found.status, one.low < 0.01 < one.high
    ('converged', True)
    """

    display_module: ClassVar[str] = "cutbench.calibration.report"

    campaign: Campaign
    estimated: Estimated | None
    case: Case
    estimates: tuple[Estimate, ...]
    fixed: Mapping[str, str]
    covariance: np.ndarray
    status: str
    message: str
    compared: tuple[ComparedCurve, ...]
    before: Identifiability
    after: Identifiability
    notes: tuple[str, ...]
    runs: int
    seconds: float
    profiles: tuple[Profile, ...] = field(default=())

    @property
    def done(self) -> bool:
        """Whether it came to its end."""
        return self.status in (CONVERGED, STOPPED)

    @property
    def values(self) -> dict[str, float]:
        """The fitted values by label, in internal units."""
        return {e.label: e.value for e in self.estimates}

    @property
    def correlation(self) -> np.ndarray:
        """The correlations (k, k) of the fitted parameters."""
        return correlations(self.covariance)

    @property
    def readings(self) -> int:
        """The number of values that are compared."""
        return sum(c.x.size for c in self.compared if c.experiment.role == "train")

    @property
    def chi2(self) -> float:
        """The square of the whitened residuals; nan where nothing was estimated."""
        return math.nan if self.estimated is None else self.estimated.chi2

    @property
    def reduced_chi2(self) -> float:
        """The square of the whitened residuals over the degrees of freedom."""
        return self.chi2 / max(self.readings - len(self.estimates), 1)

    @property
    def far(self) -> str:
        """A sentence that no parameters bring the model near the data; empty where some do or may."""
        worst = max(self.compared, key=lambda c: c.misfit, default=None)
        if worst is None or worst.misfit <= FAR or not self.done:
            return ""
        return (
            "No parameters that were tried bring this model near the data: it misses"
            f" {100 * worst.relative_rmse:.0f} % of the maximum of '{worst.experiment.id}' (root mean"
            " square). Estimates are those of a wrong model."
        )

    def estimate(self, label: str) -> Estimate:
        """Return the estimate of one parameter.

        Parameters
        ----------
        label : str
            The parameter, such as ``G_c``, or ``tau_W[slow]`` for one test's own.

        Returns
        -------
        Estimate
            Its value, interval and standard deviation, internal units.

        Raises
        ------
        BadInput
            For a label that was not fitted.
        """
        for e in self.estimates:
            if e.label == label:
                return e
        labels = [e.label for e in self.estimates]
        raise BadInput("parameter", label, one_of(label, labels))


@watched("")
def fit(
    campaign: Campaign,
    *,
    workers: int | None = None,
    refine: bool = True,
    profile: Sequence[str] = (),
    on_progress: OnProgress = silent,
    limit_s: float = math.inf,
    store: str | Path | None = None,
    runs: CutRuns | None = None,
    on_stage: Callable[[Fit], None] | None = None,
    by_atlas: bool = False,
) -> Fit:
    """Fit the free parameters of a campaign's model to all its train tests, and predict the other tests.

    Ctrl-C ends the fit with what is there.

    Parameters
    ----------
    campaign : Campaign
        The tests, the model, and what is free.
    workers : int, optional
        Processes that compute cuts; one a core unless given, 0 for this one.
    refine : bool
        Whether the error of a cut's mesh is measured.
    profile : sequence of str
        Labels whose profile likelihood is computed.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with what was computed, what is left, and what is known.
    limit_s : float, s
        The fit ends after this time, too, with what is there.
    store : str or Path, optional
        Folder with a store of runs: what is there is not computed again, and the rest is left there.
    runs : CutRuns, optional
        Computes cuts in place of ``workers`` and ``store``.
    on_stage : callable, optional
        Called with what is known, each time that better values are found.
    by_atlas : bool
        Whether cuts are those of the atlas that cutbench brings along: none is computed, and its error is
        part of the intervals.

    Returns
    -------
    Fit
        Estimates with intervals, and each test beside its computed curve.

    Raises
    ------
    BadInput
        If a name cannot be fitted.
    ComputationFailed
        If the tests cannot be computed.

    Examples
    --------
    >>> import cutbench
    >>> import numpy as np
    >>> from cutbench.data import Experiment, FitPlan, Repetition, start_case
    >>> stretch = np.linspace(1.02, 1.5, 30)
    >>> stress = 0.01 * (stretch - stretch**-2)  # MPa, of a solid whose shear modulus is 10 kPa
    >>> pulled = Experiment("pulled", "uniaxial", (Repetition(stretch, stress),))
    >>> laws, soft = ["neo_hookean", "volumetric"], {"G": "20 kPa", "nu": 0.499}
    >>> base, _ = start_case(None, baseline=laws, kinds=["uniaxial"], parameters=soft)
    >>> campaign = cutbench.Campaign("Pulled", base, (pulled,), plan=FitPlan(free=("G",)))
    >>> found = cutbench.fit(campaign, workers=0)
    >>> print(found.status, f"{1e3 * found.values['G']:.1f} kPa")
    converged 10.0 kPa
    """
    parameters = free_parameters(campaign)
    for label in profile:
        if label not in (known := [u.label for u in parameters]):
            raise BadInput("profile", label, one_of(label, known))
    with runs_for(campaign, workers, store, limit_s, runs) as ready:
        fitting = Fitting(campaign, ready, parameters, on_progress, refine, on_stage, by_atlas)
        fitting.go(due=time.monotonic() + limit_s)
        return fitting.result(profile)


@contextmanager
def runs_for(
    campaign: Campaign, workers: int | None, store: str | Path | None, limit_s: float, runs: CutRuns | None
) -> Iterator[CutRuns]:
    """What computes a campaign's cuts: ``runs``, or new processes until ``limit_s``."""
    if runs is not None:
        yield runs
        return
    cuts = any(e.kind == "cut" for e in campaign.experiments)
    count = (cores() if workers is None else workers) if cuts else 0
    # One process alone would only wait, so it is this one, unless a limit is to end a run under way.
    with TaskPool(count if count > 1 or math.isfinite(limit_s) else 0) as pool:
        yield CutRuns(pool, None if store is None else Path(store), Until(time.monotonic() + limit_s))


def with_one_detail(campaign: Campaign) -> Case:
    """The start of a fit. Where an edge or a cohesive zone is finer than the blade, elements keep the size
    that they ask for there, whatever values are tried: so what is predicted is smooth."""
    cuts = [cut_case(e, campaign.base) for e in campaign.train if e.kind == "cut"]
    finest = min((cut.sizes.detail_mm / cut.unit_mm for cut in cuts), default=1.0)
    return (
        campaign.base
        if campaign.base.numerics.detail or finest > 1 - 1e-9
        else campaign.base.set(detail=finest)
    )


class Fitting:
    """A fit under way: what is known until now is a result at any time."""

    def __init__(
        self,
        campaign: Campaign,
        runs: CutRuns,
        parameters: Sequence[FreeParameter],
        on_progress: OnProgress = silent,
        refine: bool = True,
        on_stage: Callable[[Fit], None] | None = None,
        by_atlas: bool = False,
    ):
        self._began, self._on_stage = time.perf_counter(), on_stage
        self.campaign, self.runs, self.refine, self._on_progress = campaign, runs, refine, on_progress
        grids = {e.id: e.on_grid(GRID) for e in campaign.experiments}
        names = [u.name for u in parameters]
        self.posterior = Posterior.of(
            Predictions(campaign, with_one_detail(campaign), grids, runs, names, by_atlas), parameters
        )
        self.best: Estimated | None = None
        self.status, self.fixed = UNDER_WAY, dict[str, str]()
        # Nothing is known of it before the cuts where the search begins.
        self.before = replace(identifiability(np.zeros((0, len(parameters))), parameters), sentences=())

    def go(self, due: float = math.inf) -> None:
        """Estimate until it is found, or stopped. Raises ComputationFailed."""
        parameters = self.posterior.parameters
        try:
            some, fixed, white = drop_unidentifiable(self.posterior, self.campaign.plan.own)
            self.before = identifiability(white, parameters)
            if self.campaign.plan.free is None:
                self.posterior, self.fixed = some, fixed
            for found in successive_estimates(
                self.posterior, refine=self.refine, on_progress=self._on_progress
            ):
                self.best = found
                if self._on_stage is not None:
                    self._on_stage(self.result())
            self.status = CONVERGED if self.best is not None and self.best.settled else STOPPED
        except KeyboardInterrupt:
            self.status = LATE if time.monotonic() >= due else INTERRUPTED
            # What has a formula alone would be fitted after all.
            self.best = best_known(self.posterior, self.best) if self.posterior.tests_with_runs else self.best
        self.runs.check = ALWAYS  # what is known can be asked

    def result(self, profile: Sequence[str] = ()) -> Fit:
        """What is known."""
        posterior = self.posterior if self.best is None else self.best.posterior
        done, notes = self.status in (CONVERGED, STOPPED), list(self.campaign.all_notes())
        if self.posterior.predictions.by_atlas:
            notes.append(
                "Cuts are those of the atlas: an estimate, whose error the intervals have. Runs say more."
            )
        covariance, found = _estimates(posterior, self.best, done)
        case = posterior.case(np.zeros(len(posterior.parameters)) if self.best is None else self.best.q)
        compared = _compared(posterior, self.best, notes, done)
        notes += _at_bounds(posterior, found, compared)
        notes += [
            note_on_single_repetition(id)
            for id, grid in posterior.predictions.grids.items()
            if grid.estimated
        ]
        profiles: list[Profile] = []
        for label in profile if done else ():
            if self.best is None or label in self.fixed:
                notes.append(f"No profile of {label}: it was left at its start.")
                continue
            try:
                profiles.append(_profiled(self.best, label, self._on_progress))
            except KeyboardInterrupt:
                notes.append(f"The profile of {label} was interrupted.")
                break
        after = self.before if self.best is None else identifiability(self.best.white_J, posterior.parameters)
        return Fit(
            self.campaign, self.best, case, found, self.fixed,
            covariance, self.status, self._message(compared), compared, self.before, after,
            tuple(dict.fromkeys(notes)), self.runs.count, time.perf_counter() - self._began, tuple(profiles),
        )  # fmt: skip

    def _message(self, compared: Sequence[ComparedCurve]) -> str:
        if self.status not in (CONVERGED, STOPPED):
            moved = self.best is not None and bool(np.any(np.abs(self.best.q) > UNMOVED))
            reached = "the best that is known" if moved else "the start's, nothing is fitted"
            if moved and self.posterior.tests_with_runs and not self.runs.count:
                reached = "what the atlas has as likeliest"
            return f"{self.status} before a maximum, cuts computed: {self.runs.count}; values are {reached}"
        worst = max(compared, key=lambda c: c.misfit, default=None)
        if worst is None or worst.misfit <= FAR:
            return self.status
        part = f"{100 * worst.relative_rmse:.0f} % of the maximum in '{worst.experiment.id}'"
        return f"{self.status}, at a misfit of {part}"


def _estimates(
    posterior: Posterior, best: Estimated | None, done: bool
) -> tuple[np.ndarray, tuple[Estimate, ...]]:
    k = len(posterior.parameters)
    q = np.zeros(k) if best is None else best.q
    if best is None or not done:  # where a search happens to stand is no estimate
        nan = [
            Estimate(u, u.value(x), math.nan, math.nan, math.nan, math.nan, False, moves)
            for u, x, moves in zip(posterior.parameters, q, (np.abs(q) > UNMOVED).tolist(), strict=True)
        ]
        return np.full((k, k), np.nan), tuple(nan)
    covariance, dof = _sampling_covariance(best)
    found, inside, (low, _) = [], posterior.inside(q), posterior.bounds
    for i, u in enumerate(posterior.parameters):
        sd = float(np.sqrt(covariance[i, i]))
        reach = float(stats.t.ppf((1 + LEVEL) / 2, dof[i])) * sd
        down = u.value(q[i] - reach) if u.logarithmic else u.value(max(q[i] - reach, low[i]))
        spread = down, u.value(q[i] + reach), sd * u.slope(q[i]), float(dof[i])
        found.append(Estimate(u, u.value(q[i]), *spread, not bool(inside[i]), bool(abs(q[i]) > UNMOVED)))
    return covariance, tuple(found)


def _sampling_covariance(best: Estimated) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (k, k) of the estimates, with degrees of freedom (k,), where the model is wrong (sandwich).

    The estimates weigh readings as if what the model misses were correlated over a short way. Here it is as
    correlated as it is likeliest; and what tests contradict each other more than their covariance has it, as
    a cause that a model lacks makes them, is a scatter between them (DerSimonian & Laird 1986,
    10.1016/0197-2456(86)90046-2; the expectation is that of Bell & McCaffrey 2002). What is common to all
    cuts, where they begin, is no scatter.
    """
    V, dof, w = best.covariance, _degrees_of_freedom(best), best.w
    noise_alone, p = best.posterior.noise(best.at), best.posterior.predictions
    total, between, expected, common = V.copy(), np.zeros(len(V)), np.zeros(len(V)), np.zeros(len(V))
    for id, block in w.tests.items():
        residual, J = best.at.residual[id], best.at.J[id]
        gain = np.linalg.solve(block.total, J @ V).T
        noise = noise_alone.tests[id]
        tried = [Discrepancies(noise, w.grids[id], length) for length in CORRELATION_LENGTHS]
        likely = max(tried, key=lambda d: d.likelihood(residual[:, None])[0])
        if likely is not tried[0] and np.any(block.discrepancy):
            size = likely.tried[likely.gains(residual[:, None])[:, 0].argmax()]
            total += gain @ (likely.covariance(size) - block.discrepancy) @ gain.T
        if p.needs_runs(e := p.campaign.experiment(id)):
            y, meet = best.at.y[id], p.parts_meet_mm(e, best.at.onset_mm[id])
            common += gain @ (begun_later(w.grids[id], y, meet, MODEL.common) - y)
        H = gain @ J
        between += (gain @ residual) ** 2
        expected += np.diag(H @ V - 2 * H @ H @ V + H @ V @ H.T)
    total += np.outer(common, common)
    n, known = len(w.tests), np.diag(total)
    more = np.maximum(between - expected, 0.0) * n / max(n - 1, 1)
    stretch = np.sqrt(1 + more / known)
    dof = (known + more) ** 2 / (known**2 / dof + more**2 / max(n - 1, 1))
    return total * np.outer(stretch, stretch), np.maximum(dof, 1.0)


def _degrees_of_freedom(best: Estimated) -> np.ndarray:
    """Welch and Satterthwaite's (k,): of the factors, of each test's other scatter, of the rest."""
    covariance, J, w = best.covariance, best.white_J, best.w
    gain = covariance @ J.T
    rest, factors = np.diag(covariance).copy(), w.factors
    by_factor = {kind: np.zeros(rest.size) for kind in factors}
    parts: list[tuple[np.ndarray, float]] = []
    first = 0
    for id, block in w.tests.items():
        mine = gain[:, first : (first := first + len(block.total))]
        by_factor[w.kinds[id]] += block.share(mine, block.by_factor)
        parts.append((block.share(mine, block.other), block.dof))
        if w.grids[id].independent:  # how well measures are known is stated
            parts.append((block.share(mine, np.diag(w.grids[id].reading ** 2)), math.inf))
        if np.any(block.discrepancy):
            parts.append((block.share(mine, block.discrepancy), degrees_of_freedom(block)))
    parts += [(by_factor[kind], pooled.dof) for kind, pooled in factors.items()]
    uncertain = np.zeros(rest.size)
    for part, dof in parts:
        if dof > 0:
            rest -= part
            uncertain += part**2 / dof
    uncertain += np.clip(rest, 0, None) ** 2 / max(J.shape[0] - rest.size, 1)
    return np.maximum(np.diag(covariance) ** 2 / np.maximum(uncertain, 1e-300), 1.0)


def _compared(
    posterior: Posterior, best: Estimated | None, notes: list[str], done: bool
) -> tuple[ComparedCurve, ...]:
    """Each test beside its curve, as far as that is known; tests that are predicted are computed now."""
    p, found = posterior.predictions, []
    q = np.zeros(len(posterior.parameters)) if best is None else best.q
    for e in p.campaign.experiments:
        values = posterior.values(e, q)
        try:
            if done:
                try:
                    p.compute(e, values)
                except KeyboardInterrupt:  # what is fitted stands
                    done = False
                    notes.append("Interrupted while tests were predicted: they are as the emulator has them.")
            at = best.at if best is not None and e.id in best.at.y else posterior.evaluate(q, [e])
        except ComputationFailed as error:
            verb = "predicted" if e.role == "test" else "computed"
            notes.append(f"'{e.id}' could not be {verb}: {error}")
            continue
        grid, fitted = p.grids[e.id], e.id in (best.w.tests if best else ())
        sd, gap = grid.deviation, None
        if best is not None and fitted:
            block = best.w.tests[e.id]
            sd, gap = block.deviation, discrepancy_mean(block, at.residual[e.id])
        computed: tuple[float, ...] = ()
        if isinstance(e, MeasuredCut):
            computed = tuple(e.read_off(*p.curve(e, values)))
        found.append(
            ComparedCurve(
                e, grid.x, grid.mean, sd, at.y[e.id], at.onset_mm[e.id], p.thickness_mm(e), gap, computed
            )
        )
        if e.id in posterior.mesh:
            change = _rms(posterior.mesh[e.id].change) / float(np.abs(at.y[e.id]).max())
            notes.append(
                f"'{e.id}': finer numerics change the computed curve by {100 * change:.1f} % of its"
                " maximum (root mean square); the fit allows for that."
            )
        if e.fields and e.id in posterior.fields:
            notes.append(_field_note(e, posterior.fields[e.id].residual))
    return tuple(found)


def _field_note(e: Experiment, residual: np.ndarray) -> str:
    """How near computed displacement fields of a test are to the measured ones, in a sentence."""
    known = residual != 0
    if not known.any():
        return f"'{e.id}': none of the places of its fields lies in the computed body."
    fields = f"{len(e.fields)} field{'s' * (len(e.fields) > 1)}"
    return (
        f"'{e.id}': of {known.sum()} displacements in {fields} the fit is off by"
        f" {_rms(residual[known]):.3g} mm (root mean square), where {_rms(laid_out(e.fields)[known]):.3g} mm"
        f" were measured and {e.field_noise_mm:g} mm are noise."
    )


def _at_bounds(
    posterior: Posterior, found: Sequence[Estimate], compared: Sequence[ComparedCurve]
) -> list[str]:
    """What bounds do to the fit: starts that lie beyond, and values that are held."""
    notes, held, base = [], [], posterior.predictions.base
    for e in found:
        u, show = e.parameter, e.parameter.quantity.show
        bounds, wanted = f"{show(u.low)} to {show(u.high)}", base.values.get(u.name, u.start)
        if not u.low <= wanted <= u.high:
            notes.append(f"{e.label} begins at {show(u.start)}: {show(wanted)} is not within {bounds}.")
        if e.at_bound:
            held.append(f"{e.label} ({bounds})")
    if held and compared:
        part, id = max((c.relative_rmse, c.experiment.id) for c in compared)
        notes.append(
            f"Held by its bounds: {', '.join(held)}. There the fit misses '{id}' by {100 * part:.1f} % of"
            " its maximum (root mean square)."
        )
    return notes


def _profiled(best: Estimated, label: str, on_progress: OnProgress) -> Profile:
    """Along one parameter, on each side until the log posterior has fallen as far as at the ends of an
    interval, or three values are tried. Raises KeyboardInterrupt."""
    posterior = best.posterior
    k = [u.label for u in posterior.parameters].index(label)
    u, (low, high) = posterior.parameters[k], posterior.bounds
    t, sd = float(stats.t.ppf((1 + LEVEL) / 2, _degrees_of_freedom(best)[k])), best.covariance[k, k] ** 0.5
    points, ends = [(best.q[k], 0.0)], {-1: math.nan, 1: math.nan}
    for side in (-1, 1):
        way, before = t * sd, (best.q[k], 0.0)
        for _ in range(3):
            q = float(np.clip(best.q[k] + side * way, low[k], high[k]))
            on_progress(math.nan, math.nan, f"profile of {label}")
            try:
                # The largest log posterior with this parameter held, from where the others would follow it.
                start = best.q + best.covariance[:, k] / best.covariance[k, k] * (q - best.q[k])
                held = replace(posterior, fixed_q={k: q}).maximum(start).log_posterior
                risen = 2 * (best.log_posterior - held)
            except ComputationFailed:
                break
            points.append((q, risen))
            if risen >= t**2:  # the root of χ² is close to linear
                a, b = math.sqrt(max(before[1], 0.0)), math.sqrt(risen)
                ends[side] = u.value(before[0] + (q - before[0]) * (t - a) / (b - a))
                break
            before, way = (q, risen), way * min(1.15 * t / max(math.sqrt(max(risen, 0.0)), t / 3), 3.0)
    points.sort()
    values = np.array([u.value(q) for q, _ in points])
    return Profile(label, values, np.array([risen for _, risen in points]), ends[-1], ends[1])
