"""Which cause, if any, do the data ask for? A comparison of nested models by their marginal likelihoods.

M₀ is the baseline, M_c the same with one candidate: a law, a rig, an error of the reading, or a parameter
that was held. All are fitted by the same likelihood (``cutbench.calibration.posterior``), and compared by
Laplace's marginal likelihoods (Kass & Raftery 1995, 10.1080/01621459.1995.10476572). How large a gain chance
makes, with the best of all candidates and shapes picked afterwards, comes from draws of data without effect
(``cutbench.discovery.score``). Causes are added one by one, and each is taken out again where the others do
without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.calibration.estimation import (
    best_maximum,
    best_places,
    estimate,
    estimate_by_emulator,
    evaluated_at,
)
from cutbench.calibration.parameters import FreeParameter
from cutbench.calibration.posterior import Estimated, Posterior
from cutbench.calibration.settings import SETTINGS
from cutbench.data.covariance import discrepancy_mean
from cutbench.discovery.candidates import CAUSES, FIXED, Candidate, candidates, family_of
from cutbench.discovery.held_out import TESTS, HeldOut, held_out
from cutbench.discovery.score import Score, Scores, score
from cutbench.discovery.screening import sensitivities
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import Mechanism
from cutbench.run.sensitivity import extended

#: What else a model may fail with that a person could not have known.
_FAILURES = (ComputationFailed, BadInput, np.linalg.LinAlgError)
#: A candidate is fitted from so many values of its shapes, and from these parts of what its score proposes.
MAX_SHAPES_TRIED, STEP_FRACTIONS = 3, (1.0, 0.2, 0.04)


@dataclass(frozen=True)
class ComparedModel:
    """A model with one more cause, beside the one without.

    Attributes
    ----------
    candidate : Candidate
        The cause.
    fitted : Estimated
        The model with it.
    evidence : float
        Logarithm of the ratio of marginal likelihoods.
    p : float
        Probability that chance alone makes any candidate gain as much.
    explained_variance : float
        Part of what the model misses beyond noise that it explains.
    held_out : HeldOut
        How both predict what was not fitted.
    significant : bool
        Whether the model without it misses more, as a whole, than chance makes, or is known from runs.
    computed : bool
        Whether cuts were computed at its place; else the emulator alone speaks for it.
    evidence_sd : float
        Standard deviation of the evidence by what the emulator and the mesh leave open.
    """

    candidate: Candidate
    fitted: Estimated
    evidence: float
    p: float
    explained_variance: float
    held_out: HeldOut
    significant: bool
    computed: bool = True
    evidence_sd: float = 0.0

    @property
    def name(self) -> str:
        """The candidate's."""
        return self.candidate.name

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why it may not be named; nothing where it may."""
        found = []
        if not self.computed:
            found.append("no cuts were computed where it is likeliest")
        if self.p >= SETTINGS.chance:
            found.append(f"chance alone gains as much in {100 * self.p:.2g} % of such data")
        if self.evidence <= 0:
            found.append("the evidence is for the model without it")
        elif self.evidence <= self.evidence_sd:
            found.append("the error of what is predicted may make as much evidence")
        if self.significant and self.explained_variance < SETTINGS.share:
            found.append(f"it explains {100 * max(self.explained_variance, 0):.0f} % of what is missed")
        if not self.held_out.better:
            found.append("it predicts what was not fitted no better")
        return tuple(found)

    @property
    def convincing(self) -> bool:
        """Whether it may be named."""
        return not self.doubts


@dataclass(frozen=True)
class ComparisonRound:
    """One round of the comparison.

    Attributes
    ----------
    null : Estimated
        The model that it began with.
    scores : Scores
        Of all candidates.
    compared : tuple of ComparedModel
        What was fitted, the most probable first.
    left_out, failed : mapping
        By name, why candidates do not apply, or could not be tried.
    whole : bool
        Whether it came to its end.
    """

    null: Estimated
    scores: Scores
    compared: tuple[ComparedModel, ...]
    left_out: Mapping[str, str]
    failed: Mapping[str, str]
    whole: bool = True

    @property
    def group(self) -> tuple[ComparedModel, ...]:
        """What the evidence cannot tell from the best that convinces; in the order of kinds."""
        good = [c for c in self.compared if c.convincing]
        if not good:
            return ()
        first = good[0]
        alike = [
            c for c in good
            if first.evidence - c.evidence <= SETTINGS.undecided + _evidence_sd(c.fitted, first.fitted)
        ]  # fmt: skip
        # What the fitted tests cannot tell apart, those that were not fitted may.
        by_tests = all(c.held_out.how == TESTS and c.held_out.tells for c in alike)
        return tuple(
            sorted(
                alike,
                key=lambda c: (
                    CAUSES.index(c.candidate.cause), -(c.held_out.gain if by_tests else c.evidence),
                ),
            )
        )  # fmt: skip

    @property
    def significant(self) -> bool:
        """Whether the model misses more than chance makes."""
        return self.scores.p_residual < SETTINGS.chance

    @property
    def ranking(self) -> list[tuple[Score, ComparedModel | None]]:
        """What was fitted, the most probable first, then the other candidates by their score."""
        scored, fitted = {s.name: s for s in self.scores.scores}, [c.name for c in self.compared]
        rest = [(s, None) for s in self.scores.scores if s.name not in fitted]
        return [*((scored[c.name], c) for c in self.compared), *rest]


@dataclass(frozen=True)
class FoundCause:
    """A cause that was found: ``compared`` in its ``step``."""

    compared: ComparedModel
    step: ComparisonRound

    @property
    def name(self) -> str:
        """The candidate's."""
        return self.compared.name

    @property
    def group(self) -> tuple[str, ...]:
        """Names of what the data cannot tell from it, itself first."""
        return tuple(dict.fromkeys([self.name, *(c.name for c in self.step.group)]))


@dataclass(frozen=True)
class Comparison:
    """All that was compared until now: the rounds, what was found, in its order, and the model with all of
    it."""

    steps: tuple[ComparisonRound, ...]
    found: tuple[FoundCause, ...]
    final: Estimated


def comparisons(
    baseline: Estimated, *, seed: int = 0, on_progress: OnProgress = silent
) -> Iterator[Comparison]:
    """Look for causes of what a fitted baseline misses, one after the other."""
    null = baseline
    if baseline.posterior.tests_with_runs:
        # The mesh errs elsewhere in another model, whose cuts begin elsewhere; but as much.
        post = replace(baseline.posterior, local_mesh_error=False, fields={})
        at = post.evaluate(baseline.q)
        null = baseline = Estimated(post, at, post.covariance(at))
    steps, found = list[ComparisonRound](), list[FoundCause]()
    whole = squared_discrepancy(baseline)
    while len(found) < SETTINGS.most:
        beside = f" beside {' and '.join(f.name for f in found)}" if found else ""
        on_progress(math.nan, math.nan, f"looking for a cause{beside}")
        step = comparison_round(null, seed, on_progress)
        try:
            likely = (step.group or step.compared)[:1] if step.whole else ()
            places = [c.fitted.q[: null.q.size] for c in likely]
            if (better := _refit_null_model(step.null, places)) is not None:
                # Some of the gain was that of other values: the cause is asked beside these.
                step = comparison_round(better, seed, on_progress)
        except KeyboardInterrupt:
            step = replace(step, whole=False)
        null, baseline = step.null, step.null if null is baseline else baseline
        steps.append(step)
        yield Comparison(tuple(steps), tuple(found), null)
        if not step.whole:
            raise KeyboardInterrupt
        best = step.group[0] if step.group else None
        if best is None or (found and not _worth_adding(step, best, whole)):
            break
        found.append(FoundCause(best, step))
        null = best.fitted
        yield Comparison(tuple(steps), tuple(found), null)
    found, null = _backward_elimination(baseline, found, null, on_progress)
    yield Comparison(tuple(steps), tuple(found), null)


def _by_emulator_alone(null: Estimated, compared: Sequence[ComparedModel]) -> Estimated:
    """The model without a cause as the emulator has it, also where others have its parameters."""
    likely = sorted(compared, key=lambda c: -c.evidence)[: SETTINGS.computed]
    return best_maximum(null.posterior.smooth, [null.q, *(c.fitted.q[: null.q.size] for c in likely)])


def _refit_null_model(null: Estimated, places: Sequence[np.ndarray]) -> Estimated | None:
    """The model without a cause, from other places (k,); None where it is no likelier there."""
    for q in places:
        try:
            found = null.posterior.maximum(q)
            promised = evaluated_at(null.posterior, found.q, sure=True)
            if promised.log_posterior < null.log_posterior + SETTINGS.gained:
                continue
            better = _estimated_nearby(null.posterior, found.q, rounds=1)
        except _FAILURES:
            continue
        if better is not None and better.log_posterior > null.log_posterior + SETTINGS.gained:
            return better
    return None


def _worth_adding(step: ComparisonRound, best: ComparedModel, whole: float) -> bool:
    """Whether a later cause is more than the error of a formula that was found: what it is found in is more
    than chance, and more than a trifle or told by tests that were not fitted."""
    more = squared_discrepancy(step.null) >= SETTINGS.trifle**2 * whole
    return step.significant and (more or best.held_out.gains_much)


def comparison_round(null: Estimated, seed: int, on_progress: OnProgress = silent) -> ComparisonRound:
    """One formula of each class first, the one that promises most; then the others of the class that the
    evidence prefers."""
    campaign = null.posterior.predictions.campaign
    chosen, left_out = candidates(campaign, null.case, {u.name for u in null.posterior.parameters})
    chosen = _simplest_of_each_class(chosen, null.posterior, left_out)
    sensed = sensitivities(null, chosen)
    scores = score(sensed, null.w.noise, null.at.residual, seed=seed)
    known, failed = {s.name for s in scores.scores}, dict[str, str]()
    for c in (c for c in chosen if c.name not in known):
        if c.slot == "support" or (c.name in registry() and registry()[c.name].directed):
            left_out[c.name] = "it changes what is solved for, so that no run says what it would do first"
        else:
            by_atlas = null.posterior.predictions.by_atlas and any(c.acts_on(e) for e in null.posterior.cuts)
            failed[c.name] = "runs alone say what it does" if by_atlas else "it has no answer at off"
    # Of cuts the first order says little; what the emulator knows costs no run, and is fitted in any case.
    runs, cuts = bool(null.posterior.tests_with_runs), bool(null.posterior.cuts)
    promising = [
        s
        for s in _chosen_for_fit(scores, null)
        if s.gain > SETTINGS.undecided or (cuts and not s.sensitivity.by_runs)
    ]
    compared: list[ComparedModel] = []

    def compare(asked: Sequence[Score]) -> None:
        for number, s in enumerate(asked):
            on_progress(number, len(asked), f"fitting the model with {s.name}")
            fitted = _fitted(null, s, scores)
            if fitted is not None:
                compared.append(_compared_with_null(null, s.sensitivity.candidate, fitted, scores))
            elif s.name not in failed:
                failed[s.name] = "the model with it has no answer"

    whole = True
    try:
        compare(promising)
        best = max(compared, key=lambda c: c.evidence, default=None)
        if best is not None and best.evidence > 0:
            done, family = {c.name for c in compared}, family_of(best.name)
            compare([s for s in scores.scores if family_of(s.name) == family and s.name not in done])
        if runs:
            plain = _by_emulator_alone(null, compared)
            if (better := _refit_null_model(null, [plain.q])) is not None:
                # What laws would change first is much the same there, and takes runs of minutes.
                null, inside = better, better.posterior.inside(better.q)
                sensed = replace(sensed, y=null.at.y, J={id: J * inside for id, J in null.at.J.items()})
                scores = score(sensed, null.w.noise, null.at.residual, seed=seed)
                plain = _by_emulator_alone(null, compared)
            # What the emulator says of models it says of all of them, with its error in each.
            compared = [
                _compared_with_null(plain, c.candidate, c.fitted, scores)
                for c in compared if c.name in scores.scale
            ]  # fmt: skip
            compared = _with_computed_cuts(null, compared, scores, on_progress)
    except KeyboardInterrupt:
        whole, compared = False, [replace(c, computed=not runs) for c in compared]
    compared.sort(key=lambda c: (-c.evidence, c.name))
    return ComparisonRound(null, scores, tuple(compared), left_out, failed, whole)


def _chosen_for_fit(scores: Scores, null: Estimated) -> list[Score]:
    """One formula of each class of laws, and all that is no law; of what takes runs, so many as may be
    computed, those that promise most."""
    first: dict[str, Score] = {}
    for s in scores.scores:
        first.setdefault(family_of(s.name), s)
    laws = [s for s in first.values() if s.sensitivity.candidate.cause == "mechanism"]
    others = [s for s in scores.scores if s.sensitivity.candidate.cause != "mechanism"]
    if not null.posterior.tests_with_runs:
        return [*others, *laws[: SETTINGS.tried]]
    # What the emulator knows costs no run, whatever its class.
    free = [s for s in scores.scores if not s.sensitivity.by_runs]
    costly = sorted((s for s in [*others, *laws] if s.sensitivity.by_runs), key=lambda s: -s.gain)
    return [*free, *costly[: SETTINGS.tried]]


def _with_computed_cuts(
    null: Estimated, compared: list[ComparedModel], scores: Scores, on_progress: OnProgress
) -> list[ComparedModel]:
    """The same with cuts computed at their best places: again and again of the one that may be the best,
    until none may be that was not computed."""
    found = {c.name: replace(c, computed=False) for c in compared}
    rounds = dict.fromkeys(found, 0)
    runs, cuts = null.posterior.predictions.runs, len(null.posterior.tests_with_runs)
    while runs.count + cuts <= SETTINGS.budget(SETTINGS.search_runs, cuts):
        best = max((c.evidence for c in found.values() if c.computed), default=-math.inf)
        open_ = [
            c for c in found.values()
            if rounds[c.name] < SETTINGS.computed and not (c.computed and c.fitted.settled)
            and _attainable_evidence(c) > max(best - SETTINGS.undecided, 0.0)
        ]  # fmt: skip
        if not open_:
            break
        c = max(open_, key=_attainable_evidence)
        on_progress(math.nan, math.nan, f"computing cuts of the model with {c.name}")
        rounds[c.name] += 1
        fitted = _estimated_nearby(c.fitted.posterior, c.fitted.q, on_progress, 1)
        if fitted is None:
            rounds[c.name] = SETTINGS.computed
            continue
        again = _compared_with_null(null, c.candidate, fitted, scores)
        found[c.name] = again if not c.computed or again.evidence > c.evidence else c
    return [*found.values()]


def _attainable_evidence(c: ComparedModel) -> float:
    """The evidence that there may be once cuts are computed, as far as the emulator's error allows."""
    return c.evidence if c.computed else c.evidence + 2 * c.evidence_sd


def _simplest_of_each_class(
    chosen: Sequence[Candidate], posterior: Posterior, left_out: dict[str, str]
) -> list[Candidate]:
    """All of them where tests have formulas; of laws that take runs of their own the simplest of each class,
    beside those that do what another value does."""
    if not posterior.tests_with_runs:
        return list(chosen)
    laws, found = registry(), []
    simplest: dict[str, Candidate] = {}
    for c in sorted(chosen, key=lambda c: (len(c.parameters), c.name)):
        simplest.setdefault(family_of(c.name), c)
    for c in chosen:
        equal = c.name in laws and type(laws[c.name]).like is not Mechanism.like
        if c.slot in ("rig", FIXED) or equal or (first := simplest[family_of(c.name)]) is c:
            found.append(c)
        else:
            left_out[c.name] = f"{first.name} is tried for its class, {family_of(c.name)}"
    return found


def _compared_with_null(
    null: Estimated, candidate: Candidate, fitted: Estimated, scores: Scores
) -> ComparedModel:
    gain = 2 * (fitted.log_likelihood - null.log_likelihood)
    share = 1 - squared_discrepancy(fitted) / max(squared_discrepancy(null), 1e-300)
    p = scores.p_any(candidate.name, max(gain, 0.0))
    evidence = float(fitted.log_evidence - null.log_evidence)
    # Runs jag: of what they leave, a part must be explained even where chance could make it.
    significant = scores.p_residual < SETTINGS.chance or bool(null.posterior.cuts)
    told = held_out(null, fitted)
    return ComparedModel(
        candidate, fitted, evidence, p, share, told, significant, evidence_sd=_evidence_sd(fitted, null)
    )


def _evidence_sd(one: Estimated, other: Estimated) -> float:
    """Standard deviation of the difference of two models' evidences by errors of their predictions: an error
    e changes the logarithm of a likelihood by rᵀC⁻¹e, and much of it is common to both."""
    variance = 0.0
    for id, error in one.at.error.items():
        pulls = [np.linalg.solve(m.w.tests[id].total, m.at.residual[id]) for m in (one, other)]
        variance += float((pulls[0] - pulls[1]) @ error @ (pulls[0] - pulls[1]))
    return math.sqrt(variance)


def squared_discrepancy(fitted: Estimated) -> float:
    """Square of what a model misses beyond noise, as a part of each curve's largest value; mean of all."""
    w, total = fitted.w, 0.0
    for id, block in w.tests.items():
        residual = fitted.at.residual[id]
        # Measures have no discrepancy: what is off is off.
        gap = residual if w.grids[id].independent else discrepancy_mean(block, residual)
        total += float(np.mean(gap**2)) / float(np.abs(w.grids[id].mean).max()) ** 2
    return total / len(w.tests)


def _fitted(null: Estimated, s: Score, scores: Scores) -> Estimated | None:
    """The model with a candidate, from the steps that its scores propose; None where it has no answer."""
    typical, cuts = _with_typical_strengths(s), bool(null.posterior.cuts)
    # Derivatives at off say little of cuts, and what is likeliest elsewhere in the box they do not know.
    others = [] if cuts else scores.others.get(s.name, [])[: MAX_SHAPES_TRIED - 1]
    tried = [typical] if s.sensitivity.by_runs else [s, *others, typical]
    tries = [*(_fitted_from_score(null, each) for each in tried), _fitted_within_box(null, typical)]
    found = [each for each in tries if each is not None]
    return max(found, key=lambda each: each.log_posterior, default=None)


def _fitted_within_box(null: Estimated, s: Score) -> Estimated | None:
    """The model with a candidate wherever it is likeliest within the box of a search of cuts: what a cause
    does to these other parameters may have taken up, far from where they are without it."""
    if not null.posterior.cuts:
        return None
    try:
        posterior, q = _extended_posterior(null, s)
        half = np.full(q.size, SETTINGS.reach)
        half[null.q.size :] = np.maximum(np.abs(q - posterior.prior_means)[null.q.size :], 1e-3)
        middle = np.append(np.zeros(null.q.size), posterior.prior_means[null.q.size :])
        low, high = (np.clip(middle + side * half, *posterior.bounds) for side in (-1, 1))
        return posterior.maximum(best_places(posterior, q, low, high)[0])
    except _FAILURES:
        return None


def _fitted_from_score(null: Estimated, s: Score) -> Estimated | None:
    """The model with a candidate from a score's step, and from parts of it where a law may lock before."""
    best: Estimated | None = None
    # A formula may lock before; a cut may not, and costs more.
    quick = not (null.posterior.cuts or s.sensitivity.candidate.shapes)
    for part in STEP_FRACTIONS:
        try:
            posterior, q = _extended_posterior(null, replace(s, strengths=part * s.strengths))
            # What the emulator says of a model is enough to rank it; cuts are computed for the best.
            found = estimate_by_emulator(posterior, q)
            if found.log_likelihood < null.log_likelihood:  # it lost its way: from where it does nothing
                found = posterior.maximum(np.append(null.q, posterior.prior_means[null.q.size :]))
        except _FAILURES:
            continue
        if best is None or found.log_posterior > best.log_posterior:
            best = found
        if not quick:
            break
    return best


def _with_typical_strengths(s: Score) -> Score:
    """A score whose strengths are of a size that runs tell: derivatives at off say little of it where a cut
    begins elsewhere."""
    found = []
    for q, strength in zip(s.sensitivity.candidate.strengths, s.strengths, strict=True):
        typical = abs(q.typical * q.factor - q.off_value) or abs(q.off_value) or 1.0
        sign = np.sign(strength) or (1.0 if q.bounds[1] > q.off_value else -1.0)
        found.append(sign * float(np.clip(abs(strength), typical / 3, typical)))
    return replace(s, strengths=np.array(found), free=np.zeros_like(s.free))


def _estimated_nearby(
    posterior: Posterior, q: np.ndarray, on_progress: OnProgress = silent, rounds: int | None = None
) -> Estimated | None:
    """The fit from a place that is near already; None where it has no answer."""
    try:
        return estimate(posterior, q, refine=False, rounds=rounds, on_progress=on_progress)
    except _FAILURES:
        return None


def _extended_posterior(null: Estimated, s: Score) -> tuple[Posterior, np.ndarray]:
    """The posterior of the model with a candidate, and the place that a score proposes."""
    post, c, base = null.posterior, s.sensitivity.candidate, null.case
    case = extended(base, c.added, s.sensitivity.shapes) if c.added else base
    case = replace(case, values={**case.values, **s.sensitivity.shapes})
    new, centres, widths, start = [], [], [], []
    bounds, scales = post.predictions.campaign.plan.bounds, _strength_scales(s, null)
    for q, strength, scale in zip(c.strengths, s.strengths, scales, strict=True):
        low, high = bounds.get(q.name, q.bounds)
        value = float(np.clip(q.off_value + strength, low, high))
        u = FreeParameter(q, value if c.slot == FIXED else q.off_value, low, high)
        new.append(u)
        centres.append(u.q(q.off_value))
        widths.append(SETTINGS.strength * scale / u.slope(0.0) if c.slot != FIXED else 1.0)
        start.append(u.q(value))
    for q in c.shapes:
        u = FreeParameter(q, case.values[q.name], *bounds.get(q.name, q.bounds))
        new.append(u)
        centres.append(0.0)
        size = 1.0 if u.logarithmic else abs(q.typical * q.factor or 1) / u.scale
        widths.append(SETTINGS.shape * size)
        start.append(0.0)
    parameters = (*post.parameters, *new)
    made = post.predictions.extended(case, [u.name for u in parameters])
    posterior = replace(
        post, predictions=made, parameters=parameters, prior_sds=np.append(post.prior_sds, widths),
        prior_means=np.append(post.prior_means, centres), fields={},
    )  # fmt: skip
    return posterior, np.append(null.q + np.clip(s.free, -1.0, 1.0), start)


def _strength_scales(s: Score, null: Estimated) -> list[float]:
    """What a candidate's strengths may be: as large as is typical, or as changes the readings by a third of
    themselves, whatever the units and sizes of the tests."""
    found = []
    for k, q in enumerate(s.sensitivity.candidate.strengths):
        typical = max(abs(q.typical * q.factor), 1e-12)
        parts = [
            np.linalg.norm(by[:, k]) / np.linalg.norm(null.at.y[id]) for id, by in s.sensitivity.by.items()
        ]
        steep = max(parts, default=0.0)
        found.append(float(max(typical, 1 / (3 * steep)) if steep > 1e-3 / typical else typical))
    return found


def _backward_elimination(
    baseline: Estimated, found: list[FoundCause], last: Estimated, on_progress: OnProgress
) -> tuple[list[FoundCause], Estimated]:
    """Take out causes that the others do without (backward elimination)."""
    kept = list(found)
    for each in found if len(found) > 1 else ():
        on_progress(math.nan, math.nan, f"the model without {each.name}")
        rest, fitted = [f for f in kept if f is not each], baseline
        for f in rest:
            again = _refitted(fitted, f, last)
            if again is None:
                break
            fitted = again
        else:
            if fitted.log_evidence > last.log_evidence - SETTINGS.undecided:
                kept, last = rest, fitted
    return kept, last


def _refitted(null: Estimated, f: FoundCause, last: Estimated) -> Estimated | None:
    """The model with a cause that was found beside others, from its values there; with the prior that it was
    found with."""
    values, c = last.values(), f.compared.candidate
    strengths = np.array([values[q.name] - q.off_value for q in c.strengths])
    shapes = {q.name: values[q.name] for q in c.shapes}
    scored = next(s for s in f.step.scores.scores if s.name == c.name)
    column = replace(scored.sensitivity, shapes=shapes)
    s = replace(scored, sensitivity=column, strengths=strengths, free=np.zeros(null.q.size))
    try:
        return _estimated_nearby(*_extended_posterior(null, s))
    except _FAILURES:
        return None
