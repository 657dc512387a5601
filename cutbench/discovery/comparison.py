"""Which cause, if any, do the data ask for? A comparison of nested models by their marginal likelihoods.

M₀ is the baseline, M_c the same with one candidate: a law, a rig, an error of the reading, or a parameter
that was held. All are fitted by the same likelihood (``cutbench.calibration.posterior``), and compared by
Laplace's marginal likelihoods (Kass & Raftery 1995, 10.1080/01621459.1995.10476572). How large a gain chance
makes, with the best of all candidates and shapes picked afterwards, comes from draws of data without effect
(``cutbench.discovery.score``). Causes are added one by one, the best two sets being carried on, and each is
taken out again where the others do without it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.calibration.estimation import estimate, said
from cutbench.calibration.homogeneous import scan
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.posterior import Estimated, Posterior
from cutbench.calibration.predict import NotKnown, Predictions
from cutbench.data.campaign import Campaign
from cutbench.data.discrepancy import missed
from cutbench.data.experiment import Experiment
from cutbench.discovery.candidates import FIXED, ORDER, Candidate, candidates, family_of
from cutbench.discovery.columns import Column, Sensed
from cutbench.discovery.score import Score, Scores, score
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import Mechanism
from cutbench.run.sensitivity import Added, extended


@dataclass(frozen=True)
class Rules:
    """What a decision rests on. All numbers of a search beside those of the estimates.

    Attributes
    ----------
    chance : float
        Probability of naming anything where nothing is wrong.
    undecided : float
        Logarithm of the evidence ratio up to which two models count as equally good: 20 to 1, Kass and
        Raftery's "strong".
    share : float
        Part of what the baseline misses beyond noise that a cause must explain, and of what is left that a
        later one must.
    rest : float
        Part of what the baseline misses, as a root mean square, of which no cause is looked for: no specimen
        follows a formula.
    strength, shape : float
        Standard deviations beforehand: of a strength in units of what is typical, and of a shape, as a
        logarithm.
    tried : int
        Candidates that are fitted in a round, beside those that are no laws.
    computed : int
        Models of a round at whose best places cuts are computed.
    most : int
        Causes at most.
    """

    chance: float = 0.005
    undecided: float = 3.0
    share: float = 0.3
    rest: float = 0.06
    strength: float = 3.0
    shape: float = 2.3
    tried: int = 6
    computed: int = 2
    most: int = 4


RULES = Rules()


@dataclass(frozen=True)
class Compared:
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
    share : float
        Part of what the model misses beyond noise that it explains.
    gain : float or None
        Fall of the root mean square error of the predicted tests; None without any.
    """

    candidate: Candidate
    fitted: Estimated
    evidence: float
    p: float
    share: float
    gain: float | None

    @property
    def name(self) -> str:
        """The candidate's."""
        return self.candidate.name

    @property
    def convincing(self) -> bool:
        """Whether it may be named."""
        better = self.gain is None or self.gain > 0
        return self.p < RULES.chance and self.evidence > 0 and self.share >= RULES.share and better


@dataclass(frozen=True)
class Step:
    """One round: the model that it began with, and all that was compared, the best first."""

    null: Estimated
    scores: Scores
    compared: tuple[Compared, ...]

    @cached_property
    def group(self) -> tuple[Compared, ...]:
        """What the evidence cannot tell from the best that convinces; in the order of kinds."""
        good = [c for c in self.compared if c.convincing]
        if not good:
            return ()
        first = good[0]
        alike = [c for c in good if first.evidence - c.evidence <= max(RULES.undecided, _apart(first, c))]
        return tuple(sorted(alike, key=lambda c: (ORDER.index(c.candidate.cause), -c.evidence)))


def _apart(one: Compared, other: Compared) -> float:
    """The standard error of the difference of two log likelihoods: how far apart their predictions are."""
    w = one.fitted.w
    d = {id: one.fitted.at.y[id] - other.fitted.at.y[id] for id in w.tests}
    return float(np.linalg.norm(w.white(d)))


@dataclass(frozen=True)
class Comparison:
    """All that was compared: the baseline, the rounds, and what was found, in its order."""

    baseline: Estimated
    steps: tuple[Step, ...]
    found: tuple[Compared, ...]
    final: Estimated
    verdict: str


def compare_models(baseline: Estimated, *, seed: int = 0, on_progress: OnProgress = silent) -> Comparison:
    """Look for causes of what a fitted baseline misses.

    Parameters
    ----------
    baseline : Estimated
        The fit of the model without any.
    seed : int
        Of the draws of chance.
    on_progress : callable
        Told what is done.

    Returns
    -------
    Comparison
    """
    null, steps, found = baseline, [], []
    whole = _missed(baseline)
    while len(found) < RULES.most:
        on_progress(len(found), RULES.most, f"looking for a cause beside {[c.name for c in found]}")
        step = _step(null, seed)
        steps.append(step)
        left = _missed(null)
        if found and left < RULES.rest**2 * whole:
            break
        if not step.group:
            break
        best = _named(step.group)
        found.append(best)
        null = best.fitted
    found, null = _without_idle(baseline, found, null)
    wrong = steps[0].scores.p_residual < RULES.chance
    verdict = "mechanism" if found else "unexplained" if wrong else "none"
    return Comparison(baseline, tuple(steps), tuple(found), null, verdict)


def _named(group: Sequence[Compared]) -> Compared:
    """The one of a group that is added: of its first kind, the most probable."""
    return group[0]


def _step(null: Estimated, seed: int) -> Step:
    """One formula of each class first, the one that promises most; then the others of the class that the
    evidence prefers."""
    campaign = null.posterior.predictions.campaign
    asked = SimpleNamespace(campaign=campaign, unknowns=null.posterior.parameters)
    chosen = _of_classes(candidates(asked, _case(null), one_a_class=False)[0], campaign)
    scores = score(_sensed(null, chosen), null.w.noise, null.at.residual, seed=seed)
    first: dict[str, Score] = {}
    for s in scores.scores:
        first.setdefault(family_of(s.name), s)
    laws = [s for s in first.values() if s.column.candidate.cause == "mechanism"][: RULES.tried]
    others = [s for s in scores.scores if s.column.candidate.cause != "mechanism"]
    compared = [_compared(null, s, scores) for s in [*others, *laws] if s.gain > RULES.undecided]
    best = max((c for c in compared if c is not None), key=lambda c: c.evidence, default=None)
    if best is not None and best.evidence > 0:
        done = {c.name for c in compared if c is not None}
        alike = [s for s in scores.scores if family_of(s.name) == family_of(best.name) and s.name not in done]
        compared += [_compared(null, s, scores) for s in alike]
    found = sorted((c for c in compared if c is not None), key=lambda c: (-c.evidence, c.name))
    if any(e.kind == "cut" for e in campaign.train):
        found = [*(_computed(null, c, scores) for c in found[: RULES.computed]), *found[RULES.computed :]]
    return Step(null, scores, tuple(sorted(found, key=lambda c: (-c.evidence, c.name))))


def _computed(null: Estimated, c: Compared, scores: Scores) -> Compared:
    """The same with cuts computed at its best place, and as it is where they cannot be."""
    try:
        fitted = estimate(c.fitted.posterior, c.fitted.q, refine=False)
    except (ComputationFailed, NotKnown):
        return c
    return _beside(null, c.candidate, fitted, scores)


def _of_classes(chosen: Sequence[Candidate], campaign: Campaign) -> list[Candidate]:
    """All of them where tests have formulas; of laws that take cuts of their own the simplest of each class,
    beside those that do what another value does."""
    if all(e.kind != "cut" for e in campaign.train):
        return list(chosen)
    laws, found = registry(), []
    simplest: dict[str, Candidate] = {}
    for c in sorted(chosen, key=lambda c: (len(c.parameters), c.name)):
        simplest.setdefault(family_of(c.name), c)
    for c in chosen:
        equal = c.name in laws and type(laws[c.name]).like is not Mechanism.like
        if c.slot in ("rig", FIXED) or equal or simplest[family_of(c.name)] is c:
            found.append(c)
    return found


def _compared(null: Estimated, s: Score, scores: Scores) -> Compared | None:
    """The model with a candidate beside the one without; None where it has no answer."""
    fitted = _fitted(null, s, scores)
    return None if fitted is None else _beside(null, s.column.candidate, fitted, scores)


def _beside(null: Estimated, candidate: Candidate, fitted: Estimated, scores: Scores) -> Compared:
    gain = 2 * (fitted.log_likelihood - null.log_likelihood)
    share = 1 - _missed(fitted) / max(_missed(null), 1e-300)
    p = scores.p_any(candidate.name, max(gain, 0.0))
    evidence = fitted.log_evidence - null.log_evidence
    return Compared(candidate, fitted, evidence, p, share, _gain(null, fitted))


def _case(fitted: Estimated):
    """The model's case with the values found."""
    post = fitted.posterior
    values = {**post.predictions.base.values, **post.values(post.tests[0], fitted.q)}
    return replace(post.predictions.base, values=values)


def _sensed(null: Estimated, chosen: Sequence[Candidate]) -> Sensed:
    """What each candidate would change first: derivatives of all readings at off."""
    post, parts = null.posterior, {}
    for c in chosen:
        seen = [e for e in post.tests if c.seen_by(e)]
        for e in (e for e in seen if e.kind != "cut"):
            parts.update({(c.name, k, e.id): by for k, by in enumerate(_by_formula(null, e, c))})
        for k in range(len(c.grid)) if any(e.kind == "cut" for e in seen) else ():
            parts.update(_by_emulator(null, c, k, [e for e in seen if e.kind == "cut"]))
    parts.update(
        _by_runs(null, [c for c in chosen if (c.name, len(c.grid) // 2) not in {k[:2] for k in parts}])
    )
    columns = []
    for c in chosen:
        nothing = {id: np.zeros((y.size, len(c.strengths))) for id, y in null.at.y.items()}
        for k, shapes in enumerate(c.grid):
            if all((c.name, k, e.id) in parts for e in post.tests if c.seen_by(e)):
                by = {id: np.nan_to_num(parts.get((c.name, k, id), none)) for id, none in nothing.items()}
                columns.append(Column(c, shapes, by))
    return Sensed(dict(null.at.y), dict(null.at.J), columns)


def _by_formula(null: Estimated, e: Experiment, c: Candidate) -> list[np.ndarray]:
    """Derivatives (m, p) of a test with a formula by a candidate's strengths, with each of its shapes; none
    where they are not known."""
    post = null.posterior
    case, strengths = post.predictions.case(e, post.values(e, null.q)), [s.name for s in c.strengths]
    try:
        more = extended(case, c.added) if c.added else case
        return list(scan(e, more.model, more.p, strengths, c.grid, post.predictions.grids[e.id]))
    except (ComputationFailed, BadInput):
        return []


def _by_emulator(
    null: Estimated, c: Candidate, k: int, cuts: Sequence[Experiment]
) -> dict[tuple[str, int, str], np.ndarray]:
    """The same of cuts, where those that are known say it: what a machine does to the record, and what
    another value of a parameter does."""
    post, p = null.posterior, null.posterior.predictions
    try:
        base = extended(_case(null), c.added, c.grid[k]) if c.added else _case(null)
        names = [u.name for u in post.parameters]
        more = Predictions(p.campaign, base, p.grids, p.runs, [*names, *(q.name for q in c.parameters)])
        strengths = [s.name for s in c.strengths]
        return {(c.name, k, e.id): more.predict(e, post.values(e, null.q), strengths).slopes for e in cuts}
    except (NotKnown, BadInput, ComputationFailed):
        return {}


def _by_runs(null: Estimated, asked: Sequence[Candidate]) -> dict[tuple[str, int, str], np.ndarray]:
    """The same by the exact derivatives of the cuts at the place that was found, with shapes in the middle of
    their grids. Beyond the onset they are those of a stair, and count no more than the force itself."""
    post, p, parts = null.posterior, null.posterior.predictions, {}
    cuts = [e for e in post.tests if e.kind == "cut" and any(c.seen_by(e) for c in asked)]
    for e in cuts:
        case = p.case(e, post.values(e, null.q))
        beside = []
        for c in asked:
            with suppress(BadInput):
                more = extended(case, c.added, c.grid[len(c.grid) // 2])
                if (added := Added(more, tuple(s.name for s in c.strengths))).beside(case):
                    beside.append((c, added))
        (run,) = p.runs([case], (), [added for _, added in beside])
        if run is None:
            continue
        y = null.at.y[e.id]
        for (c, _), by in zip(beside, run.by_added, strict=True):
            columns = []
            for s in c.strengths:
                size = max(abs(s.typical * s.factor), 1e-12)
                most = 2 * np.abs(y).max() / size
                course = run.course.copy()
                course[1] = np.clip(np.nan_to_num(by[s.name]), -most, most)
                columns.append(p.read(e, {}, course))
            parts[c.name, len(c.grid) // 2, e.id] = np.stack(columns, axis=1)
    return parts


def _fitted(null: Estimated, s: Score, scores: Scores) -> Estimated | None:
    """The model with a candidate, from the steps that its scores propose."""
    best: Estimated | None = None
    for each in [s, *scores.others.get(s.name, [])[:2]]:
        try:
            posterior, q = _extended(null, each)
            # What the emulator says of a model is enough to rank it; cuts are computed for the best.
            found = posterior.maximum(q) if said(posterior, q) else estimate(posterior, q, refine=False)
        except (ComputationFailed, BadInput, NotKnown, np.linalg.LinAlgError):
            continue
        if best is None or found.log_posterior > best.log_posterior:
            best = found
    return best


def _extended(null: Estimated, s: Score) -> tuple[Posterior, np.ndarray]:
    """The posterior of the model with a candidate, and the place that a score proposes."""
    post, c, base = null.posterior, s.column.candidate, _case(null)
    case = extended(base, c.added, s.column.shapes) if c.added else base
    case = replace(case, values={**case.values, **s.column.shapes})
    fixed = post.predictions.campaign.plan.fixed
    new, centres, widths, start = [], [], [], []
    for q, strength in zip(c.strengths, s.strengths, strict=True):
        low, high = q.bounds
        value = float(np.clip(q.off_value + strength, low, high))
        u = Unknown(q, value if c.slot == FIXED else q.off_value, low, high)
        new.append(u)
        typical = max(abs(q.typical * q.factor), 1e-12)
        centres.append(u.q(q.off_value))
        widths.append(RULES.strength * typical / u.slope(0.0) if c.slot != FIXED else 1.0)
        start.append(u.q(value))
    for q in (q for q in c.shapes if q.name not in fixed):
        u = Unknown(q, case.values[q.name], *q.bounds)
        new.append(u)
        centres.append(0.0)
        widths.append(
            RULES.shape if u.logarithmic else RULES.shape * abs(q.typical * q.factor or 1) / u.scale
        )
        start.append(0.0)
    p = post.predictions
    parameters = (*post.parameters, *new)
    made = Predictions(p.campaign, case, p.grids, p.runs, [u.name for u in parameters])
    posterior = replace(
        post, predictions=made, parameters=parameters, widths=np.append(post.widths, widths),
        centres=np.append(post.centres, centres),
    )  # fmt: skip
    limit = np.clip(s.free, -1.0, 1.0)
    return posterior, np.append(null.q + limit, start)


def _missed(fitted: Estimated) -> float:
    """Square of what a model misses beyond noise, as a part of each curve's largest value; mean of all."""
    w, total = fitted.w, 0.0
    for id, block in w.tests.items():
        gap = missed(block, fitted.at.residual[id])
        total += float(np.mean(gap**2)) / float(np.abs(w.grids[id].mean).max()) ** 2
    return total / len(w.tests)


def _gain(before: Estimated, after: Estimated) -> float | None:
    """Fall of the root mean square error of the predicted tests, each test's own factor between specimens
    taken out of both; None where there are none, or where they do not tell the two apart."""
    errors, apart = np.zeros(2), 0.0
    for e in before.posterior.predictions.campaign.test:
        each = []
        for k, fitted in enumerate((before, after)):
            try:
                y = predicted(fitted, e)
            except (ComputationFailed, NotKnown):
                return None
            mean = fitted.posterior.predictions.grids[e.id].mean
            y = y * (y @ mean) / max(float(y @ y), 1e-300)
            each.append(y / np.abs(mean).max())
            errors[k] += float(np.mean((y - mean) ** 2) / np.abs(mean).max() ** 2)
        apart += float(np.mean((each[0] - each[1]) ** 2))
    # Where the two say the same, they are not told apart by what they say.
    return float(1 - np.sqrt(errors[1] / errors[0])) if apart > 0.01 * errors[0] else None


def predicted(fitted: Estimated, e: Experiment) -> np.ndarray:
    """What a fitted model says of any test (m,)."""
    post = fitted.posterior
    return post.predictions.predict(e, post.values(e, fitted.q)).y


def _without_idle(
    baseline: Estimated, found: list[Compared], last: Estimated
) -> tuple[list[Compared], Estimated]:
    """Take out causes, the first ones, that the others do without (backward elimination)."""
    kept = list(found)
    for each in found[:-1]:
        rest = [c for c in kept if c is not each]
        fitted = baseline
        for c in rest:
            again = _again(fitted, c, last)
            if again is None:
                break
            fitted = again
        else:
            if fitted.log_evidence > last.log_evidence - RULES.undecided:
                kept, last = rest, fitted
    return kept, last


def _again(null: Estimated, c: Compared, last: Estimated) -> Estimated | None:
    """The model with a cause that was found beside others, from its values there."""
    values = last.values()
    strengths = np.array([values[q.name] - q.off_value for q in c.candidate.strengths])
    shapes = {q.name: values[q.name] for q in c.candidate.shapes if q.name in values}
    column = Column(c.candidate, shapes, {})
    s = Score(column, 0.0, strengths, np.zeros(null.q.size), np.zeros(0))
    try:
        posterior, q = _extended(null, s)
        return estimate(posterior, q, refine=False)
    except (ComputationFailed, BadInput, NotKnown, np.linalg.LinAlgError):
        return None


def summary(c: Comparison) -> Mapping[str, object]:
    """The verdict in short."""
    return {"verdict": c.verdict, "found": [f.name for f in c.found]}
