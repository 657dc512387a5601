"""The most probable parameters of a model, from as few cuts as are needed.

Tests that have a formula are asked first, and say where cuts are worth computing. Cuts fill that box; the
emulator says what all others would give, so that the best place is looked for everywhere in it, and from
there by derivatives. Cuts are computed at the place that was found and told to the emulator, and the place is
looked for again about the best of them, until what was predicted and what is computed agree.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import ALWAYS, OnProgress, silent
from cutbench.calibration import mesh_error
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.identifiability import identifiable
from cutbench.calibration.mesh_error import field_block
from cutbench.calibration.posterior import (
    AT_BOUND,
    Estimated,
    LinearFields,
    MeshError,
    Posterior,
    least_squares_fit,
)
from cutbench.calibration.prediction import MAX_SLOPE, NotComputed
from cutbench.calibration.settings import SETTINGS
from cutbench.data.covariance import USUAL_SHAPE, Covariance
from cutbench.data.experiment import Experiment
from cutbench.data.fields import laid_out
from cutbench.data.measures import MeasuredCut

#: Places of the box that are looked at with the emulator, and the best of them, from which a maximum is
#: looked for: each of them alone goes to the same, of the cuts that were tried.
PLACES, STARTS = 64, 3
#: So often at most cuts are computed at the best place where a place is near already.
MAX_ROUNDS_NEARBY = 3
#: As many rounds as most fits take, for the time that is left.
USUAL_ROUNDS = 3
#: A place that moves by less than this part of all standard deviations stays where it is.
STATIONARY = 0.3
#: Half of the sides of a box about a place that other tests, or another model's fit, say: so many standard
#: deviations of theirs, between a sixth and the box without them.
HALF_SIDE_IN_SD, SMALLEST_HALF_SIDE = 2.5, 0.15


def drop_unidentifiable(
    posterior: Posterior, asked: Sequence[str] = ()
) -> tuple[Posterior, dict[str, str], np.ndarray]:
    """Leave at their start the parameters that the data do not tell there. Gives (M, k)."""
    J, residual, y, error = {}, {}, {}, {}
    q, cuts = np.zeros(len(posterior.parameters)), posterior.tests_with_runs
    exact = dict(zip([e.id for e in cuts], _exact_sensitivities(posterior, cuts, q), strict=True))
    for e in posterior.tests:
        if e.id in exact:
            y[e.id], J[e.id], onset = exact[e.id]
            error[e.id] = posterior.mesh_error(e, y[e.id], onset).covariance
        else:
            at = posterior.evaluate(q, [e])
            y[e.id], J[e.id], error[e.id] = at.y[e.id], at.J[e.id], at.error[e.id]
        residual[e.id] = y[e.id] - posterior.predictions.grids[e.id].mean
    kinds = {e.id: e.kind for e in posterior.tests}
    white = Covariance.of(posterior.predictions.grids, kinds, y, error).white(J)
    kept, why = identifiable(white, posterior.parameters, asked)
    return _restricted_to(posterior, kept), why, white


def _restricted_to(posterior: Posterior, kept: Sequence[int]) -> Posterior:
    parameters = tuple(posterior.parameters[k] for k in kept)
    made = posterior.predictions.with_free([u.name for u in parameters])
    widths, centres = posterior.prior_sds[kept], posterior.prior_means[kept]
    return replace(posterior, predictions=made, parameters=parameters, prior_sds=widths, prior_means=centres)


def _exact_sensitivities(
    posterior: Posterior, cuts: Sequence[Experiment], q: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Of each cut the readings (m,), their derivatives (m, k) by the exact ones of its own run, and where it
    begins."""
    p, found = posterior.predictions, []
    cases = [p.case(e, posterior.values(e, q)) for e in cuts]
    names = [u.name for u in posterior.parameters if all(u.name in case.values for case in cases)]
    runs = p.runs(cases, tuple(dict.fromkeys(names)))
    for e, case, run in zip(cuts, cases, runs, strict=True):
        if run is None:
            raise ComputationFailed(f"'{e.id}': {p.runs.failed[case.id]}")
        values = posterior.values(e, q)
        y, J = p.read(e, values, run.course), np.zeros((p.grids[e.id].mean.size, q.size))
        for k in posterior.parameter_numbers[e.id]:
            u = posterior.parameters[k]
            slope = run.slopes.get(u.name, np.zeros(run.course.shape[1]))
            most = {u.name: MAX_SLOPE * float(np.abs(run.course[1]).max()) / abs(u.slope(0.0))}
            J[:, k] = p.read_slopes(e, values, run.course, {u.name: slope}, most)[:, 0] * u.slope(0.0)
        found.append((y, J, run.onset_mm))
    return found


def successive_estimates(
    posterior: Posterior,
    start: np.ndarray | None = None,
    *,
    refine: bool = True,
    rounds: int | None = None,
    on_progress: OnProgress = silent,
) -> Iterator[Estimated]:
    """The most probable parameters, better and better: the last one is what was looked for. With ``start``
    (k,). Raises ComputationFailed."""
    cuts = posterior.tests_with_runs
    q = np.zeros(len(posterior.parameters)) if start is None else start
    if not cuts:
        yield from _without_runs(
            posterior, [q] if start is not None else [q, *_further_starts(posterior, q)], on_progress
        )
        return
    runs, count = posterior.predictions.runs, SETTINGS.first + SETTINGS.each * q.size
    if start is None:
        q, low, high = _search_box(posterior, q)
    fills = start is None and not is_within_emulator(posterior, q)
    progress = _Progress(runs, on_progress, fills * count + len(cuts) * (2 * USUAL_ROUNDS + 4 * refine))
    best: Estimated | None = None
    if start is None:
        if fills:
            progress.text = "computing the cuts where the search begins"
            _compute_cuts(posterior, cuts, [q] * len(cuts))
            best = evaluated_at(posterior, q)
            yield best
            progress.text = f"computing {count} cuts that fill the box; where it begins, {worst_misfit(best)}"
            _compute_initial_design(posterior, cuts, low, high, count)
            best = evaluated_at(posterior, q)
        found, reach = best_maximum(posterior, best_places(posterior, q, low, high)), (high - low) / 4
        yield found
    else:
        found, reach = estimate_by_emulator(posterior, q), _search_radius(posterior, q)
    # A fit leaves room for the finer cuts that end it, and for those at the place that these lead to.
    settled, last = False, SETTINGS.budget(SETTINGS.search_runs, len(cuts))
    if start is None:
        last = SETTINGS.budget(SETTINGS.fit_runs, len(cuts)) - 3 * len(cuts)
    rng = np.random.default_rng(0)
    for number in range(rounds or (SETTINGS.rounds if start is None else MAX_ROUNDS_NEARBY)):
        if best is not None and runs.count + len(cuts) > last:
            break
        still_to_come = max(USUAL_ROUNDS - number, 1) + 4 * refine  # a finer cut takes as long as some others
        progress.text, progress.left = worst_misfit(best or found), len(cuts) * still_to_come
        promised = evaluated_at(found.posterior, found.q, sure=True).log_posterior
        places = [found.q] * len(cuts)
        if start is None and not fills:  # what may be as likely, for all that is known: one place a test
            places += _drawn(found, len(cuts), rng)
        _compute_cuts(posterior, [*cuts, *cuts][: len(places)], places)
        there = evaluated_at(posterior, found.q)
        worse = best is not None and there.log_posterior <= best.log_posterior
        if best is None or not worse:
            best = there
            yield best
        # What the emulator promises is asked only as far from the best place as its promises hold.
        reach = reach / 2 if worse else reach
        about = _surrogate_about(best)
        found = about.maximum(best.q, reach)
        still = np.all(np.abs(found.q - best.q) < STATIONARY * np.sqrt(np.diag(best.covariance)))
        gained = found.log_posterior - evaluated_at(about, best.q).log_posterior
        # A run jags about what is promised: held against it is what the emulator has learnt there.
        smooth = posterior.smooth
        kept = evaluated_at(smooth, there.q, sure=True).log_posterior > promised - SETTINGS.undecided
        if start is None:  # whoever is near a wrong maximum is as sure of nothing as of how far it is off
            other = best_maximum(posterior, best_places(posterior, best.q, low, high))
            worth = [evaluated_at(smooth, x, sure=True).log_posterior for x in (other.q, best.q)]
            if worth[0] > worth[1] + SETTINGS.undecided:
                found, kept = other, False
        if settled := kept and (bool(still) or gained < SETTINGS.gained):
            break
    assert best is not None, "there is a round at least"
    if refine:
        progress.text = "measuring the error of the mesh on finer ones"
        best = _with_mesh_error(posterior, cuts, best)
    runs.on_run = lambda: None  # what others compute is not of this search
    yield replace(best, settled=settled)


def _drawn(found: Estimated, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Places (k,) that may be the best for all that is known (Thompson 1933, 10.2307/2332286), no farther
    than a person's guess may be off."""
    low, high = found.posterior.bounds
    root = np.linalg.cholesky(found.covariance)
    steps = np.clip(rng.standard_normal((count, found.q.size)) @ root.T, -SETTINGS.reach, SETTINGS.reach)
    return [np.clip(found.q + step, low, high) for step in steps]


def _without_runs(
    posterior: Posterior, starts: Sequence[np.ndarray], on_progress: OnProgress
) -> Iterator[Estimated]:
    """The same of tests that take no runs: maxima from all ``starts``, each better than the last."""
    best: Estimated | None = None
    for number, each in enumerate(starts):
        on_progress(number, len(starts), "looking for the most probable values")
        with suppress(ComputationFailed):
            there = posterior.maximum(each)
            if best is None or there.log_posterior > best.log_posterior:
                best = there
                yield best
    if best is None:
        posterior.maximum(starts[0])  # says why not


def _surrogate_about(best: Estimated) -> Posterior:
    """The posterior as the emulator has it, made to agree with the cuts that were computed at a place: they
    jag, and what is near is smooth."""
    post, smooth, mesh = best.posterior, best.posterior.smooth, dict(best.posterior.mesh)
    at = smooth.evaluate(best.q, post.tests_with_runs, differentiate=False)
    for e in post.tests_with_runs:
        known = post.mesh_error(e, at.y[e.id], at.onset_mm[e.id])
        mesh[e.id] = replace(known, shift=known.shift + best.at.y[e.id] - at.y[e.id])
    return replace(smooth, mesh=mesh, local_mesh_error=True)


def evaluated_at(posterior: Posterior, q: np.ndarray, sure: bool = False) -> Estimated:
    """The posterior at a place (k,), as if the emulator were ``sure`` or with its error."""
    at = posterior.evaluate(q, sure=sure)
    return Estimated(posterior, at, posterior.covariance(at))


def worst_misfit(found: Estimated) -> str:
    """What a model misses most, in a sentence."""
    grids = found.w.grids
    parts = {id: np.abs(r) / np.abs(grids[id].mean).max() for id, r in found.at.residual.items()}
    id = max(parts, key=lambda each: float(np.mean(parts[each] ** 2)))
    far = int(np.flatnonzero(parts[id] > parts[id].max() / 2)[0])
    e = found.posterior.predictions.campaign.experiment(id)
    if isinstance(e, MeasuredCut):
        worst = int(np.abs(found.at.residual[id]).argmax())
        off = abs(found.at.residual[id][worst])
        return f"the model misses the {e.measures[worst].name} of '{id}' by {off:.1f} standard deviations"
    unit = e.x_unit
    place = f"{grids[id].x[far]:.2g}{'' if unit == '1' else f' {unit}'}"
    missed = 100 * math.sqrt(float(np.mean(parts[id] ** 2)))
    return f"the model misses '{id}' by {missed:.0f} % of its maximum, most from {place} on"


class _Progress:
    """Tells of each cut that is computed, with how many there will be."""

    def __init__(self, runs: CutRuns, on_progress: OnProgress, left: int):
        self.text, self._done, self._on_progress, self.left = "", 0, on_progress, left
        runs.on_run = self._report

    def _report(self) -> None:
        self._done, self.left = self._done + 1, max(self.left - 1, 1)
        self._on_progress(self._done, self._done + self.left, self.text)


def estimate(
    posterior: Posterior,
    start: np.ndarray | None = None,
    *,
    refine: bool = True,
    rounds: int | None = None,
    on_progress: OnProgress = silent,
) -> Estimated:
    """The last of ``successive_estimates``."""
    *_, found = successive_estimates(posterior, start, refine=refine, rounds=rounds, on_progress=on_progress)
    return found


def _further_starts(posterior: Posterior, q: np.ndarray) -> list[np.ndarray]:
    """Other starts of what takes no runs."""
    rows = qmc.Sobol(q.size, seed=0).random(4)[1:]
    reach = SETTINGS.reach * np.array([u.spread for u in posterior.parameters])
    likely = best_places(posterior, *_search_box(posterior, q)) if posterior.cuts else []
    return [*likely, *(q + reach * (2 * row - 1) for row in rows)]


def best_maximum(posterior: Posterior, starts: Sequence[np.ndarray]) -> Estimated:
    """The likeliest of the maxima that are reached. Raises ComputationFailed."""
    found, why = [], "nothing to start from"
    for q in starts:
        try:
            found.append(posterior.maximum(q))
        except ComputationFailed as error:
            why = str(error)
    if not found:
        raise ComputationFailed(why)
    return max(found, key=lambda each: each.log_posterior)


def is_within_emulator(posterior: Posterior, q: np.ndarray) -> bool:
    """Whether enough cuts are known for the emulator to say what all tests read."""
    try:
        for e in posterior.tests_with_runs:
            posterior.predictions.predict(e, posterior.values(e, q))
    except NotComputed:
        return False
    return True


def estimate_by_emulator(posterior: Posterior, q: np.ndarray) -> Estimated:
    """The most probable parameters near ``q`` (k,) as far as the emulator knows; where it does not, all cuts
    are computed there first. Raises ComputationFailed."""
    if not is_within_emulator(posterior, q):
        _compute_cuts(posterior, cuts := posterior.tests_with_runs, [q] * len(cuts))
    return posterior.maximum(q)


def _search_radius(posterior: Posterior, q: np.ndarray) -> np.ndarray:
    """How far (k,) the emulator is asked about a place that is near already; of a strength, to off."""
    half = np.full(q.size, 2 * SMALLEST_HALF_SIDE)
    for k, u in enumerate(posterior.parameters):
        if not u.logarithmic:
            half[k] = max(abs(q[k] - posterior.prior_means[k]), SMALLEST_HALF_SIDE)
    return half


def _search_box(posterior: Posterior, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where cuts are worth computing, as far as tests that have a formula say: a place, and the ends."""
    half = SETTINGS.reach * np.array([u.spread for u in posterior.parameters])
    low, high = posterior.bounds
    exact = tuple(e for e in posterior.tests if e not in posterior.cuts)
    if exact:
        p = posterior.predictions
        alone = replace(p.campaign, experiments=exact)
        some = Posterior(p.of(alone), posterior.parameters, half.copy(), q)
        found = some.maximum(q)
        q, half = (
            found.q,
            np.clip(HALF_SIDE_IN_SD * np.sqrt(np.diag(found.covariance)), SMALLEST_HALF_SIDE, half),
        )
    return q, np.maximum(q - half, low), np.minimum(q + half, high)


def _compute_initial_design(
    posterior: Posterior, cuts: Sequence[Experiment], low: np.ndarray, high: np.ndarray, count: int
) -> None:
    """Cuts that fill the box, by turns of each test; those that are known count."""
    try:
        known = min(posterior.predictions.emulator(e).count for e in cuts) - len(cuts)
    except NotComputed:
        known = 0
    if (count := count - known) <= 0:
        return
    made = qmc.Sobol(low.size, seed=0).random_base2(math.ceil(math.log2(count)))[:count]
    tests = [cuts[i % len(cuts)] for i in range(count)]
    _compute_cuts(posterior, tests, [low + (high - low) * row for row in made])


def _compute_cuts(posterior: Posterior, tests: Sequence[Experiment], places: Sequence[np.ndarray]) -> None:
    p = posterior.predictions
    found = p.runs([p.case(e, posterior.values(e, q)) for e, q in zip(tests, places, strict=True)])
    if not any(run is not None for run in found):
        raise ComputationFailed(f"no cut can be computed: {next(iter(p.runs.failed.values()), '')}")


def best_known(posterior: Posterior, best: Estimated | None) -> Estimated | None:
    """What the cuts that were computed say once a search was stopped: ``best``, or a place that the emulator
    has as likelier. No cut is computed."""
    runs, before = posterior.predictions.runs, posterior.predictions.runs.check
    runs.check = ALWAYS
    try:
        q, low, high = _search_box(posterior, np.zeros(len(posterior.parameters)))
        likely = posterior.maximum(best_places(posterior, q, low, high)[0])
    except (ComputationFailed, KeyboardInterrupt):
        return best
    finally:
        runs.check = before
    return likely if best is None or likely.log_posterior > best.log_posterior else best


def best_places(posterior: Posterior, q: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """The places of the box from which a maximum is worth looking for, by the emulator.

    The likelihood has maxima wherever drops do not meet: also where a cut never begins. The work that a blade
    has done until each reading leads to one place from far, as it is the more off the farther a drop is.
    """
    rows = low + (high - low) * qmc.Sobol(q.size, seed=0).random(PLACES)
    worth = [float(np.sum(_off_by_work(posterior, row, False)[0] ** 2)) for row in rows]
    high = np.maximum(high, low + AT_BOUND)  # a box may have no room between bounds
    best = [rows[i] for i in np.argsort(worth)[:STARTS]]
    found = [least_squares_fit(lambda x: _off_by_work(posterior, x), q, low, high) for q in best]
    return [each.x for each in sorted(found, key=lambda each: each.cost)]


def _off_by_work(
    posterior: Posterior, q: np.ndarray, differentiate: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """How far (M,) the work of each blade until each reading is off, and other tests' readings themselves, in
    units of what specimens usually differ by; and the derivatives (M, k). Beside what is expected
    beforehand."""
    rows = [(q - posterior.prior_means) / posterior.prior_sds]
    columns = [np.diag(1 / posterior.prior_sds)]
    try:
        at = posterior.evaluate(q, differentiate=differentiate, sure=True)
    except ComputationFailed:  # no answer there: as bad as can be
        size = sum(posterior.predictions.grids[e.id].mean.size for e in posterior.tests)
        return np.append(rows[0], np.full(size, 1e3)), np.vstack([columns[0], np.zeros((size, q.size))])
    for e in posterior.tests:
        both, grid = np.column_stack([at.residual[e.id], at.J[e.id]]), posterior.predictions.grids[e.id]
        size = np.abs(grid.mean).max() * math.sqrt(grid.mean.size)
        if e.kind == "cut" and not grid.independent:
            both, size = both.cumsum(axis=0), np.abs(grid.mean).sum() * math.sqrt(grid.mean.size)
        rows.append(both[:, 0] / (USUAL_SHAPE * size))
        columns.append(both[:, 1:] / (USUAL_SHAPE * size))
    return np.concatenate(rows), np.vstack(columns)


def _with_mesh_error(posterior: Posterior, cuts: Sequence[Experiment], found: Estimated) -> Estimated:
    """With the error of each cut's mesh, from one on a finer mesh, and with the fields that were measured."""
    p, q, mesh = posterior.predictions, found.q, {}
    coarse = [p.case(e, posterior.values(e, q)) for e in cuts]
    fine = p.runs([mesh_error.refined_case(case) for case in coarse])
    for e, plain, better in zip(cuts, p.runs(coarse), fine, strict=True):
        if plain is None or better is None:
            continue
        values, grid = posterior.values(e, q), p.grids[e.id]
        y, exact = p.read(e, values, plain.course), p.read(e, values, better.course)
        # Where the cut begins has an error of its own.
        same = p.read(e, values, mesh_error.aligned(better, plain))
        onset = p.parts_meet_mm(e, plain.onset_mm)
        shift = mesh_error.correction(grid, y, same, onset)
        error = mesh_error.measured_error(grid, y, same, onset)
        sizes = mesh_error.sizes_of_error(grid, y, same, onset)
        mesh[e.id] = MeshError(shift, error, exact - y, sizes)
    # One of three may be off where few readings are behind its onset; cuts of a campaign err alike.
    sizes = tuple(np.median([m.sizes for m in mesh.values()] or [(1.0, 1.0)], axis=0))
    posterior = replace(posterior, mesh={id: replace(m, sizes=sizes) for id, m in mesh.items()})
    for _ in range(MAX_ROUNDS_NEARBY if any(e.fields for e in cuts) else 1):
        before = q
        fields = {e.id: _linearised_fields(posterior, e, q) for e in cuts if e.fields}
        posterior = replace(posterior, fields={id: f for id, f in fields.items() if f is not None})
        q = posterior.maximum(q).q
        _compute_cuts(posterior, cuts, [q] * len(cuts))
        there = evaluated_at(posterior, q)
        if np.all(np.abs(q - before) < STATIONARY * np.sqrt(np.diag(there.covariance))):
            break
    return there


def _linearised_fields(posterior: Posterior, e: Experiment, q: np.ndarray) -> LinearFields | None:
    """The fields of a cut about a place (k,); None where it cannot be computed."""
    p, J = posterior.predictions, np.zeros((laid_out(e.fields).size, q.size))
    case = p.case(e, posterior.values(e, q))
    names = [posterior.parameters[k].name for k in posterior.parameter_numbers[e.id]]
    names = [name for name in dict.fromkeys(names) if name in case.values]
    if (run := p.runs.with_fields(case, names, e)) is None:
        return None
    for k in posterior.parameter_numbers[e.id]:
        u = posterior.parameters[k]
        if u.name in names:
            J[:, k] = run.field_slopes[:, names.index(u.name)] * u.slope(q[k])
    block, measured = field_block(e, run.fields), laid_out(e.fields)
    known = np.isfinite(measured) & np.isfinite(run.fields)
    residual = np.where(known, run.fields - measured, 0.0)
    return LinearFields(q, residual, np.where(known[:, None], np.nan_to_num(J), 0.0), block)
