"""Calibration: the parameters of one model from all experiments of a campaign at once.

Gauss–Newton steps with Marquardt's damping on exact sensitivities; residuals whitened by the measured
covariance of the mean curves, by the computation's own error, which is measured on a finer mesh on the way,
and by what the model cannot describe, which is estimated by turns with the parameters. Intervals come from
(JᵀC⁻¹J)⁻¹ with Student's t: what stems from the scatter between R specimens is known with R − 1 degrees of
freedom, and the parts are combined after Welch (1947, 10.1093/biomet/34.1-2.28) and Satterthwaite (1946,
10.2307/3002019).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, silent
from cutbench.base.toml import one_of
from cutbench.calibration import by_work, lm, survey
from cutbench.calibration.fitted import FAR, LEVEL, ComparedCurve, Estimate, Fit, beside
from cutbench.calibration.identifiability import Unknown, identifiability, information_inverse, worth_it
from cutbench.calibration.inverse import GRID, Inverse, field_note
from cutbench.calibration.lm import INTERRUPTED
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.prediction import Predictor, predictor
from cutbench.calibration.profiled import profiled
from cutbench.calibration.sparing import Sparing
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.covariance import Covariance
from cutbench.data.discrepancy import allowing, independent, likeliest, likelihood, misfit, missed
from cutbench.data.repetition import Averaged, unrepeated
from cutbench.run.pool.pool import cores

#: First with guessed weights, as far as it pays or is foreseen; then with measured ones.
ROUGH = lm.Settings(promise=0.5, failures=2)
FINAL = lm.Settings(promise=0.2, failures=2)
#: Tests without a mesh cost next to nothing and have no jags.
SMOOTH = lm.Settings(promise=1e-8, jags=1.0, evaluations=100, failures=10)
#: Weights are made again if a computed curve has moved by this part of its maximum since (root mean square),
#: so often at the most; of tests without a mesh until nothing moves.
AGAIN, ROUNDS = 0.05, 3
STILL, ROUNDS_SMOOTH = 1e-3, 12
#: What misses more than this part of a curve's maximum is wrong: a twentieth of χ² pays for no derivatives.
WRONG, PAYS = 0.02, 0.05
#: A model that misses a curve by more than this part of its maximum is fitted from other starts, too, so many
#: and so far away in q, and the report says so. With a mesh, only the likeliest of them is gone on from.
STARTS, AWAY, AWAY_MESHED = 3, 1.5, 0.7


@watched("")
def fit(
    campaign: Campaign,
    *,
    workers: int | None = None,
    refine: bool = True,
    profile: Sequence[str] = (),
    on_progress: OnProgress = silent,
    grid: int = GRID,
    run: Predictor | None = None,
    looked_for: Sequence[Unknown] | None = None,
    start: Case | None = None,
    grids: Mapping[str, Averaged] | None = None,
    near: bool = False,
    kept: str | Path | None = None,
) -> Fit:
    """Fit what ``campaign.plan`` leaves free to all train experiments; predict the test experiments.

    ``workers`` processes compute the cuts (default: one a core; 0: this process), or those of ``run``; the
    folder ``kept`` has what was computed before, and gets the rest. ``refine``: measure the computation's
    own error. ``profile``: labels whose profile likelihood is computed, at several fits each. ``on_progress``
    has the evaluations of all stages. Ctrl-C ends with what is there. ``looked_for`` in place of what the
    plan says, from the values of ``start``, a case of another model perhaps; ``grids`` where known; ``near``
    the minimum already. Raises BadInput, and ComputationFailed if the start cannot be computed.
    """
    began = time.perf_counter()
    chosen = looked_for is None and campaign.plan.free is None
    looked_for = unknowns(campaign) if looked_for is None else looked_for
    for label in profile:
        if label not in (known := [u.label for u in looked_for]):
            raise BadInput("profile", label, one_of(label, known))
    count = min(cores() if workers is None else workers, sum(e.kind == "cut" for e in campaign.experiments))
    with predictor(count, kept) if run is None else nullcontext(run) as run:
        inverse = Inverse(campaign, looked_for, run, grid, start=start, grids=grids)
        return _Fitting(campaign, inverse, on_progress, refine).go(profile, began, chosen, not start, near)


class _Fitting:
    def __init__(self, campaign: Campaign, inverse: Inverse, on_progress: OnProgress, refine: bool):
        self.campaign, self.inverse, self.refine, self._on_progress = campaign, inverse, refine, on_progress
        self.notes = campaign.all_notes()
        self.evaluations = 0
        self.history: list[float] = []
        self.covariance: Covariance

    def go(self, profile: Sequence[str], began: float, choose: bool, anywhere: bool, near: bool) -> Fit:
        inverse = self.inverse
        q = np.zeros(len(inverse.unknowns))
        self.smooth = not any(e.kind == "cut" for e in self.campaign.train)
        self.covariance = inverse.guessed(q)
        J = self._whitened(q)[1]
        before = identifiability(J, inverse.unknowns)
        fixed: dict[str, str] = {}
        if choose:
            kept, fixed = worth_it(J, inverse.unknowns, self.campaign.plan.own)
            inverse = self.inverse = inverse.only(kept)
            q = np.zeros(len(kept))
        best = self._from(q, near)
        looked = not self.smooth and survey.Survey(self.inverse, [q]).problem.able
        if anywhere and not looked and best.message != INTERRUPTED and self._farthest(best)[0] > FAR:
            best = self._elsewhere(best)
        profiles = []
        for label in profile:
            if label in fixed:
                self.notes.append(f"No profile of {label}: it was left at its start.")
            elif best.message != INTERRUPTED:
                try:
                    covariance = information_inverse(best.J)
                    dof = self._degrees_of_freedom(best, covariance)
                    made, count = profiled(self.inverse, self._whitened, label, best, covariance, dof)
                    profiles.append(made)
                    self.evaluations += count
                except KeyboardInterrupt:
                    self.notes.append(f"The profile of {label} was interrupted.")
                    break
        status = INTERRUPTED if best.message == INTERRUPTED else "converged" if best.converged else "stopped"
        part, id = self._farthest(best)
        if part > FAR:
            best.message += f", at a misfit of {100 * part:.0f} % of the maximum in '{id}'"
        self.notes += [unrepeated(id) for id, grid in inverse.grids.items() if grid.estimated]
        covariance, estimates = self._estimates(best)
        if status == INTERRUPTED:
            # Where a search happens to stand is no estimate.
            covariance = np.full_like(covariance, np.nan)
            estimates = tuple(replace(e, sd=math.nan, low=math.nan, high=math.nan) for e in estimates)
            moved = any(e.moved for e in estimates)
            reached = (
                "values are those that it had reached"
                if moved
                else "nothing is fitted, values are the start's"
            )
            best.message = f"{INTERRUPTED} after {self.evaluations} evaluations, before a minimum: {reached}"
        compared = self._compared(best.q, status)
        self.notes += self._at_bounds(estimates, compared)
        return Fit(
            self.campaign, inverse.base(best.q), estimates, fixed, covariance, best.chi2, best.r.size,
            status, best.message, compared, before,
            identifiability(best.J, inverse.unknowns), tuple(dict.fromkeys(self.notes)), self.evaluations,
            tuple(self.history), time.perf_counter() - began, inverse, best.q, self.covariance,
            tuple(profiles),
        )  # fmt: skip

    def _at_bounds(self, estimates: Sequence[Estimate], compared: Sequence[ComparedCurve]) -> list[str]:
        """What bounds do to the fit: starts that lie beyond, and values that are held."""
        notes, held = [], []
        for e in estimates:
            u, show = e.unknown, e.unknown.quantity.show
            bounds = f"{show(u.low)} to {show(u.high)}"
            wanted = self.campaign.base.values.get(u.name, u.start)
            if not u.low <= wanted <= u.high:
                notes.append(f"{e.label} begins at {show(u.start)}: {show(wanted)} is not within {bounds}.")
            if e.at_bound:
                held.append(f"{e.label} ({bounds})")
        if held:
            part, id = max((c.rmse / float(np.abs(c.mean).max()), c.experiment.id) for c in compared)
            notes.append(
                f"Held by its bounds: {', '.join(held)}. There the fit misses '{id}' by {100 * part:.1f} % of"
                " its maximum (root mean square)."
            )
        return notes

    def _whitened(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.inverse.whitened(q, self.covariance)

    def _told(self, stage: str) -> OnProgress:
        def on_progress(done: float, total: float, text: str) -> None:
            self._on_progress(self.evaluations + done, math.nan, f"{stage}: {text}")

        return on_progress

    def _minimise(self, stage: str, q: np.ndarray, settings: lm.Settings) -> lm.Minimum:
        low, high = self.inverse.bounds
        on_progress = self._told(stage)
        if not self.smooth and (look := survey.Survey(self.inverse, [q])).problem.able:
            settings = replace(settings, evaluations=0) if settings is ROUGH else settings
            best = look.minimum(self.covariance, q, settings, on_progress)
            self.evaluations += look.evaluations
            self.history += best.history
            return best
        problem = self.inverse if self.smooth else Sparing(self.inverse)

        def residual(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return problem.whitened(q, self.covariance)

        while True:
            best = lm.minimise(residual, q, low, high, settings, on_progress, first=self._whitened(q))
            self.evaluations += best.evaluations
            self.history += best.history
            if self.smooth or best.message == INTERRUPTED or np.array_equal(best.q, q):
                return best
            # What ends by derivatives that were only updated goes on from those that are there, unless it
            # gained no more than noise, or next to nothing where it is wrong: then it ends with those.
            wrong = self._farthest(best)[0] > WRONG
            q, enough = best.q, max(best.excess, PAYS * best.chi2 if wrong else 0.0)
            if best.history[0] - best.chi2 <= enough:
                there, none = self._whitened(q), replace(settings, evaluations=0)
                last = lm.minimise(residual, q, low, high, none, first=there)
                return replace(last, converged=best.converged, message=best.message)

    def _from(self, q: np.ndarray, is_near: bool = False) -> lm.Minimum:
        """The minimum that is reached from ``q``: with guessed weights or by the work, as far as it pays;
        then with measured ones."""
        if self.smooth:
            self._weigh(self.inverse.guessed(q), q)
            best = self._minimise("rough", q, ROUGH)
            near = by_work.Nearby(best.q, self.inverse, 0, best.message == INTERRUPTED)
        elif is_near:
            near = by_work.Nearby(q, self.inverse, 0)
        else:
            near = survey.nearby(self.inverse, q, self._told("work"))
        self.evaluations += near.evaluations
        return self._stopped(near) if near.interrupted else self._with_measured_error(near, is_near)

    def _stopped(self, near: by_work.Nearby) -> lm.Minimum:
        """What is there after an interruption."""
        self.inverse, still = near.inverse, np.zeros(near.q.size)
        r, J = self._whitened(near.q)
        return lm.Minimum(near.q, r, J, False, INTERRUPTED, 0, outstanding=still)

    def _weigh(self, noise: Covariance, q: np.ndarray) -> None:
        """Take ``noise`` and what the model misses at ``q`` for the covariance."""
        self.covariance = allowing(noise, *self.inverse.residuals_inside(q, noise))

    def _with_measured_error(self, near: by_work.Nearby, is_near: bool = False) -> lm.Minimum:
        """The final stage: weights are made where the first one ended, and again if it moved far; beside what
        a model misses by more than ``FAR`` an error of the computation weighs little."""
        inverse, at = self.inverse, near.q
        notes: list[str] = []
        best: lm.Minimum | None = None
        settings, still, rounds = (SMOOTH, STILL, ROUNDS_SMOOTH) if self.smooth else (FINAL, AGAIN, ROUNDS)
        for _ in range(rounds):
            try:
                if not (self.smooth or is_near or best):
                    # What the mesh does is measured where the forces agree, not where the works do.
                    self._weigh(inverse.guessed(at), at)
                    best = self._minimise("rough", at, ROUGH)
                    at = best.q
                if best is not None and best.message == INTERRUPTED:
                    break
                noise, notes = inverse.measured(at) if self.refine else (inverse.guessed(at), [])
                self._weigh(noise, at)
                best = self._minimise("final", at, settings)
            except KeyboardInterrupt:
                best = best or self._stopped(near)
                best.message = INTERRUPTED
            if best.message == INTERRUPTED:
                break
            moved, at = self._moved(at, best.q), best.q
            if moved < still or (not self.smooth and self._farthest(best)[0] > FAR):
                break
        self.notes += [note for note in notes if note not in self.notes]
        assert best is not None, "there is a round at least"
        return best

    def _moved(self, q: np.ndarray, there: np.ndarray) -> float:
        """How far from ``q`` it is: the parameters, or with a mesh a curve, as a part of its maximum."""
        if self.smooth:
            return float(np.abs(there - q).max(initial=0.0))
        before, after = self.inverse.predictions(q), self.inverse.predictions(there)
        largest = {id: np.abs(grid.mean).max() for id, grid in self.inverse.grids.items()}
        return max(
            float(np.sqrt(np.mean((p.y - before[id].y) ** 2)) / largest[id]) for id, p in after.items()
        )

    def _elsewhere(self, best: lm.Minimum) -> lm.Minimum:
        """The likeliest of several minima: ``best`` and what is reached from other starts."""
        (low, high), most, weights = self.inverse.bounds, self._likelihood(best), self.covariance
        away = AWAY if self.smooth else AWAY_MESHED
        parts = 2 * stats.qmc.Halton(best.q.size, seed=0).random(STARTS) - 1
        starts = [np.clip(best.q + away * part, low, high) for part in parts]
        for start in starts if self.smooth else self._promising(starts, best.q):
            try:
                other = self._from(start)
            except ComputationFailed:
                continue
            if other.message == INTERRUPTED:
                break
            if self._likelihood(other) > most + 1e-3:
                best, most, weights = other, self._likelihood(other), self.covariance
        self.covariance = weights
        return best

    def _promising(self, starts: Sequence[np.ndarray], q: np.ndarray) -> list[np.ndarray]:
        """The likeliest of ``starts``, if it is likelier than ``q``: each costs one evaluation."""
        noise, ranked, problem = self.covariance.noise, [], Sparing(self.inverse)
        for start in (q, *starts):
            try:
                ranked.append((likeliest(noise, problem.residuals(start, noise)[0]), start))
            except ComputationFailed:
                continue
            except KeyboardInterrupt:
                return []
        self.evaluations += len(starts)
        _, start = max(ranked, key=lambda each: each[0])
        return [] if start is q else [start]

    def _likelihood(self, best: lm.Minimum) -> float:
        return likelihood(self.covariance, self.inverse.residuals(best.q, self.covariance)[0])

    def _farthest(self, best: lm.Minimum) -> tuple[float, str]:
        """Largest part of a curve's maximum that the model misses (root mean square), and of which test."""
        residual = self.inverse.residuals(best.q, self.covariance)[0]
        return max((misfit(self.covariance, id, residual[id]), id) for id in self.covariance.tests)

    # -- intervals -------------------------------------------------------------------------------
    def _estimates(self, best: lm.Minimum) -> tuple[np.ndarray, tuple[Estimate, ...]]:
        covariance = information_inverse(best.J)
        dof = self._degrees_of_freedom(best, covariance)
        low, _ = self.inverse.bounds
        # Where the model does not describe the data, what is wrong with it counts as noise.
        covariance = covariance * best.excess
        # What was left to do: next to nothing, or what the jags of the computed curves hide.
        covariance = covariance + np.outer(best.outstanding, best.outstanding)
        found, inside = [], self.inverse.inside(best.q)
        for k, u in enumerate(self.inverse.unknowns):
            q, sd = best.q[k], float(np.sqrt(covariance[k, k]))
            reach = stats.t.ppf((1 + LEVEL) / 2, dof[k]) * sd
            down = u.value(q - reach) if u.logarithmic else u.value(max(q - reach, low[k]))
            at_bound, moved = not bool(inside[k]), bool(abs(q) > 1e-6)
            spread = down, u.value(q + reach), sd * u.slope(q), float(dof[k])
            found.append(Estimate(u, u.value(q), *spread, at_bound, moved))
        return covariance, tuple(found)

    def _degrees_of_freedom(self, best: lm.Minimum, covariance: np.ndarray) -> np.ndarray:
        """Welch and Satterthwaite's (k,): of the factors, of each test's other scatter, of the rest."""
        gain = covariance @ best.J.T
        rest, factors = np.diag(covariance).copy(), self.covariance.factors
        by_factor = {kind: np.zeros(rest.size) for kind in factors}
        parts: list[tuple[np.ndarray, float]] = []
        first = 0
        for e in self.campaign.train:
            block = self.covariance.tests[e.id]
            mine = gain[:, first : (first := first + len(block.total))]
            by_factor[e.kind] += block.share(mine, block.by_factor)
            parts.append((block.share(mine, block.other), block.dof))
            if np.any(block.discrepancy):
                parts.append((block.share(mine, block.discrepancy), independent(block)))
        parts += [(by_factor[kind], pooled.dof) for kind, pooled in factors.items()]
        uncertain = np.zeros(rest.size)
        for part, dof in parts:
            if dof > 0:
                rest -= part
                uncertain += part**2 / dof
        uncertain += np.clip(rest, 0, None) ** 2 / max(best.r.size - best.q.size, 1)
        return np.maximum(np.diag(covariance) ** 2 / np.maximum(uncertain, 1e-300), 1.0)

    # -- beside the data -------------------------------------------------------------------------
    def _compared(self, q: np.ndarray, status: str) -> tuple[ComparedCurve, ...]:
        inverse, found = self.inverse, self.inverse.predictions(q)
        sides = {}
        for e in self.campaign.train:
            block, p = self.covariance.tests[e.id], found[e.id]
            sides[e.id] = beside(e, inverse, p, p.y + block.shift, block.deviation, q)
            gap = missed(block, sides[e.id].fitted - sides[e.id].mean)
            sides[e.id] = replace(sides[e.id], discrepancy=gap)
            self.notes += [field_note(e, p, "fit")] if e.fields else []
        for e in () if status == INTERRUPTED else self.campaign.test:
            try:
                (p,) = inverse.predicted(q, [e], fine=self.refine)
            except (ComputationFailed, BadInput) as error:
                self.notes.append(f"'{e.id}' could not be predicted: {error}")
                continue
            sides[e.id] = beside(e, inverse, p, p.y, inverse.grids[e.id].deviation, q)
            self.notes += [field_note(e, p, "prediction")] if e.fields else []
        return tuple(sides[e.id] for e in self.campaign.experiments if e.id in sides)
