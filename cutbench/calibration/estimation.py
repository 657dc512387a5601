"""The most probable parameters of a model, from as few cuts as are needed.

Tests that have a formula are asked first, and say where cuts are worth computing. Cuts fill that box; the
emulator says what all others would give, so that the best place is looked for everywhere in it, and from
there by derivatives. A cut is computed at the place that was found, told to the emulator, and the place
looked for again, until what was predicted and what is computed agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.calibration import mesh_error
from cutbench.calibration.identifiability import worth_it
from cutbench.calibration.posterior import Estimated, MeshError, Posterior
from cutbench.calibration.predict import NotKnown, Predictions
from cutbench.data.covariance import Covariance
from cutbench.data.experiment import Experiment


@dataclass(frozen=True)
class DesignSettings:
    """How many cuts a fit computes, and where.

    Attributes
    ----------
    reach : float
        Half of the box's side before any test says more, as a logarithm or in units of the start: a factor of
        two and a half, as far as a person's guess may be off.
    deviations : float
        Half of it where tests with a formula do, in standard deviations.
    first, each : int
        Cuts of the first design: so many, and so many more for each parameter.
    places : int
        Places of the box that are looked at with the emulator.
    starts : int
        The best of them, from which a maximum is looked for.
    near : float
        Half of the box's side where a place is near already.
    rounds, again : int
        So often at most cuts are computed at the place that was found; ``again`` from a place that is near.
    gained : float
        It is found when the log posterior grows by less, where cuts were computed.
    """

    reach: float = 0.9
    deviations: float = 2.5
    first: int = 6
    each: int = 4
    places: int = 256
    starts: int = 3
    near: float = 0.3
    rounds: int = 8
    again: int = 3
    gained: float = 0.5


DESIGN = DesignSettings()


def choose(posterior: Posterior, asked: Sequence[str] = ()) -> tuple[Posterior, dict[str, str]]:
    """Leave at their start the parameters that the data do not tell there.

    Parameters
    ----------
    posterior : Posterior
        With all that may be looked for.
    asked : sequence of str
        Names that stay.

    Returns
    -------
    Posterior
        With the others.
    dict
        By label, why a parameter was left.
    """
    J, residual, y = {}, {}, {}
    for e in posterior.tests:
        J[e.id], y[e.id] = _derivatives(posterior, e)
        residual[e.id] = y[e.id] - posterior.predictions.grids[e.id].mean
    kinds = {e.id: e.kind for e in posterior.tests}
    error = {e.id: posterior.mesh_error(e, y[e.id]).covariance for e in posterior.tests}
    w = Covariance.of(posterior.predictions.grids, kinds, y, error)
    kept, why = worth_it(w.white(J), posterior.parameters, asked)
    return _only(posterior, kept), why


def _only(posterior: Posterior, kept: Sequence[int]) -> Posterior:
    parameters = tuple(posterior.parameters[k] for k in kept)
    p = posterior.predictions
    made = Predictions(p.campaign, p.base, p.grids, p.runs, [u.name for u in parameters])
    prior = {"widths": posterior.widths[kept], "centres": posterior.centres[kept]}
    return replace(posterior, predictions=made, parameters=parameters, **prior)


def _derivatives(posterior: Posterior, e: Experiment) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (m, k) of a test at the start, and the test (m,): of a cut by the exact ones of a run."""
    p, q = posterior.predictions, np.zeros(len(posterior.parameters))
    if e.kind != "cut":
        at = posterior.evaluate(q, [e])
        return at.J[e.id], at.y[e.id]
    mine = [posterior.parameters[k] for k in posterior.mine[e.id]]
    case = p.case(e, posterior.values(e, q))
    (run,) = p.runs([case], [u.name for u in mine if u.name in case.values])
    if run is None:
        raise ComputationFailed(f"'{e.id}': {p.runs.failed[case.id]}")
    y, J = p.read(e, posterior.values(e, q), run.course), np.zeros((p.grids[e.id].mean.size, q.size))
    for k, u in enumerate(posterior.parameters):
        if u in mine and u.name in run.slopes:
            course = run.course.copy()
            slope = np.nan_to_num(run.slopes[u.name])
            # Derivatives beyond the onset are those of a stair; they count no more than the force itself.
            slope = np.clip(slope * u.slope(0.0), -6 * y.max(), 6 * y.max())
            course[1] = slope
            J[:, k] = p.read(e, {}, course)
    return J, y


def estimate(
    posterior: Posterior,
    start: np.ndarray | None = None,
    *,
    refine: bool = True,
    on_progress: OnProgress = silent,
) -> Estimated:
    """The most probable parameters.

    Parameters
    ----------
    posterior : Posterior
        Of the model.
    start : ndarray, shape (k,), optional
        Scaled parameters near which they are expected; without, they are looked for in the whole box.
    refine : bool
        Whether the error of a cut's mesh is measured at the end.
    on_progress : callable
        Told what is done.

    Returns
    -------
    Estimated

    Raises
    ------
    ComputationFailed
        If a test cannot be computed anywhere near.
    """
    cuts = [e for e in posterior.tests if e.kind == "cut"]
    q = np.zeros(len(posterior.parameters)) if start is None else start
    if not cuts:
        return _best(posterior, [q, *_elsewhere(posterior, q)])
    if start is None:
        q, low, high = _box(posterior, q)
        _design(posterior, cuts, q, low, high, on_progress)
        found = _best(posterior, _places(posterior, q, low, high))
    else:
        low, high = _beside(posterior, q)
        if not said(posterior, q):
            _design(posterior, cuts, q, low, high, on_progress, part=0.4)
        found = _best(posterior, [q])
    for turn in range(DESIGN.rounds if start is None else DESIGN.again):
        on_progress(
            turn,
            DESIGN.rounds,
            f"computing the cuts at the best place, log posterior {found.log_posterior:.1f}",
        )
        _compute(posterior, cuts, [found.q] * len(cuts))
        exact = Estimated(posterior, at := posterior.evaluate(found.q), posterior.covariance(at))
        edge = (found.q < low + 0.02 * (high - low)) | (found.q > high - 0.02 * (high - low))
        if edge.any():
            half = (high - low) / 4
            low, high = np.minimum(low, found.q - half), np.maximum(high, found.q + half)
            _design(posterior, cuts, found.q, found.q - half, found.q + half, on_progress, part=0.4)
        elsewhere = _places(posterior, found.q, low, high) if start is None else []
        again = _best(posterior, [found.q, *elsewhere])
        if not edge.any() and again.log_posterior - exact.log_posterior < DESIGN.gained:
            break
        found = again
    if refine:
        posterior = replace(posterior, mesh=_mesh_errors(posterior, cuts, exact.q))
        again = posterior.maximum(exact.q)
        _compute(posterior, cuts, [again.q] * len(cuts))
        at = posterior.evaluate(again.q)
        return Estimated(posterior, at, posterior.covariance(at))
    return exact


def _beside(posterior: Posterior, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A small box about a place that is near already; a strength from off to twice what is proposed."""
    low, high = posterior.bounds
    half = np.full(q.size, DESIGN.near)
    for k, u in enumerate(posterior.parameters):
        if not u.logarithmic:
            half[k] = max(abs(q[k] - posterior.centres[k]), 0.5 * DESIGN.near)
    return np.maximum(q - half, low), np.minimum(q + half, high)


def said(posterior: Posterior, q: np.ndarray) -> bool:
    """Whether enough cuts are known for the model to say anything."""
    try:
        posterior.evaluate(q)
    except NotKnown:
        return False
    return True


def _box(posterior: Posterior, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where cuts are worth computing, as far as tests that have a formula say: a place, and the ends."""
    half = np.full(q.size, DESIGN.reach)
    exact = tuple(e for e in posterior.tests if e.kind != "cut")
    if exact:
        campaign = posterior.predictions.campaign
        alone = replace(campaign, experiments=exact)
        p = posterior.predictions
        predictions = Predictions(alone, p.base, p.grids, p.runs, p.free)
        some = Posterior(predictions, posterior.parameters, np.full(q.size, DESIGN.reach), q)
        told = some.maximum(q)
        q, half = told.q, np.minimum(half, DESIGN.deviations * np.sqrt(np.diag(told.covariance)))
        half = np.maximum(half, 0.15)
    low, high = posterior.bounds
    return q, np.maximum(q - half, low), np.minimum(q + half, high)


def _design(posterior, cuts, q, low, high, on_progress: OnProgress, part: float = 1.0) -> None:
    """Cuts that fill the box, by turns of each test, and those in its middle."""
    count = round(part * (DESIGN.first + DESIGN.each * q.size))
    runs = posterior.predictions.runs
    made = qmc.Sobol(q.size, seed=len(runs.database.runs)).random_base2(math.ceil(math.log2(count)))[:count]
    places = [*(low + (high - low) * row for row in made)]
    tests = [cuts[i % len(cuts)] for i in range(count)]
    on_progress(0, count, f"computing {count} cuts that fill the box")
    _compute(posterior, [*cuts, *tests], [q] * len(cuts) + places)


def _compute(posterior: Posterior, tests: Sequence[Experiment], places: Sequence[np.ndarray]) -> None:
    p = posterior.predictions
    found = p.runs([p.case(e, posterior.values(e, q)) for e, q in zip(tests, places, strict=True)])
    if not any(run is not None for run in found):
        raise ComputationFailed(f"no cut can be computed: {next(iter(p.runs.failed.values()), '')}")


def _places(posterior: Posterior, q: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """The best places of the box by the emulator."""
    rows = low + (high - low) * qmc.Sobol(q.size, seed=0).random(DESIGN.places)
    worth = []
    for row in rows:
        try:
            at = posterior.evaluate(row)
        except (ComputationFailed, NotKnown):
            worth.append(-np.inf)
            continue
        worth.append(Estimated(posterior, at, posterior.covariance(at)).log_posterior)
    order = np.argsort(worth)[::-1]
    return [rows[i] for i in order[: DESIGN.starts]]


def _elsewhere(posterior: Posterior, q: np.ndarray) -> list[np.ndarray]:
    """Other starts of what has a formula."""
    rows = qmc.Sobol(q.size, seed=0).random(4)[1:]
    return [q + DESIGN.reach * (2 * row - 1) for row in rows]


def _best(posterior: Posterior, starts: Sequence[np.ndarray]) -> Estimated:
    found, why = [], "nothing to start from"
    for q in starts:
        try:
            found.append(posterior.maximum(q))
        except (ComputationFailed, NotKnown) as error:
            why = str(error)
    if not found:
        raise ComputationFailed(why)
    return max(found, key=lambda each: each.log_posterior)


def _mesh_errors(posterior: Posterior, cuts: Sequence[Experiment], q: np.ndarray) -> dict[str, MeshError]:
    """Of each cut, from one on a finer mesh."""
    p, found = posterior.predictions, {}
    coarse = [p.case(e, posterior.values(e, q)) for e in cuts]
    fine = p.runs([mesh_error.finer(case) for case in coarse])
    for e, plain, better in zip(cuts, p.runs(coarse), fine, strict=True):
        if plain is None or better is None:
            continue
        values, x = posterior.values(e, q), p.grids[e.id].along
        y, exact = p.read(e, values, plain.course), p.read(e, values, better.course)
        found[e.id] = MeshError(mesh_error.correction(x, y, exact), mesh_error.measured_error(x, y, exact))
    return found
