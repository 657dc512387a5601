"""The search: fit, score, extend, hold against what was not fitted, and again until nothing is gained."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, silent
from cutbench.calibration.fitting import fit
from cutbench.calibration.inverse import GRID
from cutbench.calibration.prediction import Predictor, predictor
from cutbench.data.campaign import Campaign
from cutbench.discovery.candidates import ORDER, Candidate, baseline_of, candidates, family_of
from cutbench.discovery.causes import PRICE, Cause, pruned
from cutbench.discovery.clean import clean_gain
from cutbench.discovery.columns import Sensed, sense
from cutbench.discovery.heldout import TESTS, Heldout, better_than, compare, decide
from cutbench.discovery.numerical import numerical_causes
from cutbench.discovery.outcome import (
    CHANCE,
    OWN,
    SHARE,
    SHARE_WEAK,
    Discovery,
    NumericalCauses,
    Round,
    Tried,
)
from cutbench.discovery.point import Point, extend, own_part, point_of, settled, undetermined
from cutbench.discovery.protocol import Proposal, cut_proposals, proposals, sentence
from cutbench.discovery.score import Score, Scores, deviations, score
from cutbench.discovery.where import sections
from cutbench.discovery.yardstick import Yardstick
from cutbench.run.pool.pool import cores

#: A candidate on its own is worth a fit if it gains more than chance does this often.
PROMISING = 0.1
#: Chances below this are all alike: the draws do not reach so far.
TOLD = 1e-4
#: So many are fitted in a round, without a mesh and with one.
FITS, FITS_MESHED = 6, 3
#: What may stay significant beside what was found, as a part of what was wrong; more is unexplained. Where
#: the scatter between specimens was not measured, more of it may be scatter.
REST, REST_ALONE = 0.25, 0.5
#: What a later cause must take away of what the baseline gets wrong, in the root mean square; its part of
#: what is left; by how many standard errors it must predict better. No specimen follows a formula: what that
#: of the first cause leaves is no cause of its own, and any other takes some of it up.
NAMED, MAIN, SURELY = 0.06, 0.5, 4.0
#: Or else, in tests that were not fitted: what it must take away of their error, by how many standard errors.
ELSEWHERE, LIKELY = 0.25, 2.5
#: Fits are told apart by so many standard errors of their difference; more if known to first order only.
APART, APART_MESHED = 2.0, 3.0
#: Values of shapes tried where the data leave them open; how far scores may lie behind, in prices.
SHAPES, OPEN = 3, 5
#: By so much the gain on held-out data may fall when the extended model is fitted to the end.
WORSE = 0.1
#: Causes found, at the most; firsts of a pair that are tried.
MOST, FIRSTS = 4, 3


@watched("")
def discover(
    campaign: Campaign,
    *,
    workers: int | None = None,
    refine: bool = True,
    on_progress: OnProgress = silent,
    grid: int = GRID,
    seed: int = 0,
) -> Discovery:
    """``on_progress`` has what is done now; how much there is to do is not known. Ctrl-C after a mechanism
    was found ends with that.

    Raises BadInput, and ComputationFailed if the baseline cannot be computed.
    """
    began = time.perf_counter()
    campaign = baseline_of(campaign)
    count = cores() if workers is None else workers
    on_progress(math.nan, math.nan, "fitting the baseline")
    fitted = fit(
        campaign, workers=count, refine=refine, grid=grid,
        on_progress=lambda done, total, text: on_progress(done, total, f"fitting the baseline, {text}"),
    )  # fmt: skip
    if fitted.status == "interrupted":
        raise KeyboardInterrupt
    runs = 3 * sum(e.kind == "cut" for e in campaign.experiments)
    with predictor(min(count, runs)) as run:
        point = point_of(fitted, run)
        rounds: list[Round] = []
        found: list[Candidate] = []
        numerics = NumericalCauses()
        interrupted = False
        try:
            while True:
                this, then = _round(point, run, seed, on_progress), None
                if not rounds:
                    numerics = numerical_causes(this, run, seed, on_progress)
                if numerics.explains:
                    this = replace(this, accepted=None)
                elif this.accepted is None and this.scores.p_residual < CHANCE:
                    this, then = _pair(this, run, seed, on_progress)
                more = [this] if then is None else [this, then]
                if rounds and not _worth_a_name(more[-1], rounds[0]):
                    more = [this := replace(this, accepted=None)]
                rounds += more
                if this.accepted is None or len(found) >= MOST:
                    break
                for each in more:
                    taken = next(t for t in each.tried if t.name == each.accepted)
                    found.append(taken.score.column.candidate)
                    point = taken.point
                point = _surer(rounds[0].point, point, settled(point, run, refine, on_progress))
        except KeyboardInterrupt:
            if not rounds:
                raise
            interrupted = True
        causes: list[Cause] = []
        if found and not interrupted:
            last = point
            point, causes = pruned(rounds[0].point, point, found, run, on_progress)
            if point is not last and rounds[-1].accepted is None:
                # What is left is that of the model that stays.
                rounds[-1] = replace(_round(point, run, seed, on_progress), accepted=None)
        elif found:
            causes = [Cause(c, None) for c in found]
        gain = compare(rounds[0].point, point) if causes else None
        clean = clean_gain(rounds[0].point, point, seed) if causes else None
        verdict = "mechanism" if interrupted else _verdict(rounds)
        asked = ([], "Not asked: interrupted.") if interrupted else _next(rounds, verdict, run, on_progress)
        proposed, text = asked
    stopped = "Interrupted: what was found stands, what else there may be was not asked."
    notes = (*([stopped] if interrupted else []), *fitted.notes, *rounds[0].point.trouble)
    return Discovery(
        campaign, fitted, verdict, tuple(causes), tuple(rounds), point, gain,
        tuple(sections(rounds[0].point)), tuple(sections(point)), numerics, tuple(proposed), text,
        time.perf_counter() - began, tuple(dict.fromkeys(notes)), interrupted, clean,
    )  # fmt: skip


def _next(
    rounds: list[Round], verdict: str, run: Predictor, on_progress: OnProgress
) -> tuple[list[Proposal], str]:
    """The test that would separate the first two of the first group."""
    named = [r for r in rounds if r.accepted] or rounds[:1]
    r = next((r for r in named if len(r.group) > 1), None)
    if verdict == "none" and not any(r.accepted for r in rounds):
        return [], "None is needed: the model describes the tests to within their scatter."
    if r is None:
        if verdict == "mechanism":
            return [], "None is needed to tell the candidates apart: these tests do."
        if verdict == "undecided":
            return [], "None before the candidates that could not be tried have been."
        return [], (
            "Repeat the test that fails worst at another speed: what is left depends on time if it moves"
            " along the displacement, on place if it does not."
        )
    first = r.accepted if r.accepted in r.group else r.group[0]
    # Another class first: formulas of one class are not what a test is made for.
    second = min((n for n in r.group if n != first), key=lambda n: family_of(n) == family_of(first))
    on_progress(math.nan, math.nan, f"looking for a test that tells {first} from {second}")
    points = {t.name: t.point for t in r.tried}
    scored = {s.name: s for s in r.scores.scores}
    kinds = {e.kind for e in r.point.campaign.train}
    found: list[Proposal] = []
    if kinds != {"cut"} and first in points and second in points:
        found += proposals(r.point, points[first], points[second])
    if "cut" in kinds:
        found += cut_proposals(r.point, scored[first], scored[second], run)
    found.sort(key=lambda p: -p.apart)
    return found, sentence((first, second), found)


def _round(point: Point, run: Predictor, seed: int, on_progress: OnProgress) -> Round:
    chosen, left_out = candidates(point.inverse, point.case)
    sensed = None
    if point.meshed:
        # Runs that would ask what is wrong are spared where nothing is.
        sensed = Sensed(dict(point.y), dict(point.J), [])
        scores = score(sensed, point.w.noise, point.residual, seed=seed)
    if sensed is None or scores.p_residual < PROMISING:
        on_progress(math.nan, math.nan, f"{len(chosen)} candidates beside {', '.join(point.case.mechanisms)}")
        sensed = sense(point.inverse, point.q, chosen, run)
        scores = score(sensed, point.w.noise, point.residual, seed=seed)
    else:
        chosen = []
    wrong = Yardstick(point, scores.expected)
    scored = {s.name for s in scores.scores}
    failed = {c.name: "no run could take it up beside the others" for c in chosen if c.name not in scored}
    worth = [s for s in scores.scores if s.p < PROMISING and s.gain > 1]
    tried = []
    # What is asked before physics costs little without a mesh.
    first = [s for s in worth[FITS:] if s.column.candidate.cause != "mechanism"]
    for s in _simplest(worth)[:FITS_MESHED] if point.meshed else [*worth[:FITS], *first]:
        on_progress(math.nan, math.nan, f"fitting {s.name}: score {s.z:.1f}")
        try:
            after = extend(point, s)
        except (ComputationFailed, BadInput) as error:
            failed[s.name] = str(error)
            continue
        after, held, kept = _shaped(point, s, after, scores)
        gain = max(after.likelihood - point.likelihood, 0.0)
        # Where chance made the residual as small as noise, what gains anything gains all of it.
        share = max(1 - wrong.left(after), 0.0)
        tried.append(Tried(s, after, held, gain, scores.p_any(s.name, gain), share, shapes_open=kept,
                           own=own_part(after, s.column.candidate)))  # fmt: skip
    tried, group = _ordered(tried, scores, point.meshed)
    # A residual that is not significant as a whole needs a candidate that explains most of it.
    needed = SHARE if scores.p_residual < CHANCE else SHARE_WEAK
    able = [t for t in tried if t.name in group and t.convincing and t.share >= needed]
    if able and all(t.heldout.how == TESTS for t in able):
        # What the fitted tests cannot tell apart, those that were not fitted may.
        able.sort(key=lambda t: -t.heldout.gain)
    # A machine or a value that explains as much as a mechanism is asked first.
    able.sort(key=lambda t: ORDER.index(t.score.column.candidate.cause))
    accepted = able[0].name if able else None
    return Round(point, sensed, scores, tuple(tried), tuple(group), accepted, left_out, failed)


def _pair(this: Round, run: Predictor, seed: int, on_progress: OnProgress) -> tuple[Round, Round | None]:
    """Where none convinces alone: the two, one after the other, that do together; else ``this`` as it is.

    A cause can hide behind another: what is left of it, taken alone, the other's shape contradicts.
    """
    wrong = Yardstick(this.point, this.scores.expected)
    best: tuple[float, Tried, Round] | None = None
    able = sorted((t for t in this.tried if t.p_any < CHANCE), key=lambda t: -t.gain)
    for t in able[: 1 if this.point.meshed else FIRSTS]:
        on_progress(math.nan, math.nan, f"what convinces beside {t.name}")
        then = _round(t.point, run, seed, on_progress)
        second = next((x for x in then.tried if x.name == then.accepted), None)
        if second is None or 1 - wrong.left(second.point) < SHARE:
            continue
        if decide(this.point, second.point).accepted and (best is None or second.point.likelihood > best[0]):
            best = second.point.likelihood, t, then
    if best is None:
        return this, None
    _, first, then = best
    return replace(this, accepted=first.name), then


def _surer(first: Point, point: Point, after: Point) -> Point:
    """``after``, or ``point`` where a fit to the end predicts what is held out worse than a few steps did:
    where data leave a value open, it runs away with it."""
    gains = [compare(first, each).gain for each in (point, after)]
    return after if gains[1] > gains[0] - WORSE else point


def _worth_a_name(this: Round, first: Round) -> bool:
    """Whether what a later round would add is more than the error of a formula."""
    added = next((t for t in this.tried if t.name == this.accepted and t.share >= MAIN), None)
    if added is None:
        return False
    held = added.heldout
    seen = held.how == TESTS and held.better > LIKELY * held.better_se
    if seen and max(held.gain, held.gain_of_shape) > ELSEWHERE:
        return True
    wrong = Yardstick(first.point, first.scores.expected)
    taken = math.sqrt(wrong.left(this.point)) - math.sqrt(wrong.left(added.point))
    return held.better > SURELY * held.better_se and taken > NAMED


def _simplest(scores: list[Score]) -> list[Score]:
    """By z, as far as draws can tell, then by gain; without those that add parameters to another of them and
    gain less by it than these cost."""

    def order(s: Score) -> tuple:
        return -min(s.z, deviations(TOLD)), PRICE * len(s.column.candidate.parameters) - s.gain, s.name

    def vain(s: Score, other: Score) -> bool:
        mine, less = (set(x.column.candidate.parameters) for x in (s, other))
        return less < mine and s.gain < other.gain + PRICE * (len(mine) - len(less))

    return [s for s in sorted(scores, key=order) if not any(vain(s, other) for other in scores)]


def _shaped(point: Point, s: Score, after: Point, scores: Scores) -> tuple[Point, Heldout, bool]:
    """Where the train data leave the shapes of a candidate open: the values that predict held-out data best.

    They are looked for among those that the train data do not exclude; with a mesh, none are looked for.
    """
    held = decide(point, after)
    kept = undetermined(after, s.column.candidate)
    if point.meshed or not kept:
        return after, held, kept
    most, near = after.likelihood, scores.others[s.name][:SHAPES]
    for other in [s, *(o for o in near if o.gain > s.gain - OPEN * PRICE)]:
        try:
            one = extend(point, other, shapes=False)
        except (ComputationFailed, BadInput):
            continue
        if one.likelihood >= most - PRICE and (mine := decide(point, one)).better > held.better:
            after, held = one, mine
    return after, held, True


def _ordered(tried: list[Tried], scores: Scores, meshed: bool) -> tuple[list[Tried], list[str]]:
    """By χ² with the price of parameters; those that cannot be told from the first by what they predict."""
    if not tried:
        return [], []

    def cost(t: Tried) -> float:
        predicted = t.heldout.better if t.heldout.how == TESTS else 0.0
        return PRICE * len(t.score.column.candidate.parameters) - t.point.likelihood - predicted

    # What leaves nothing of the specimen explains nothing.
    tried = sorted(tried, key=lambda t: (t.own < OWN, cost(t), t.name))
    best, placed = tried[0], []
    for t in tried:
        rise, se = better_than(t.point, best.point)
        placed.append(replace(t, behind=rise, behind_se=se))
    apart = APART_MESHED if meshed else APART
    alike = [t for t in placed if t.own >= OWN and t.behind < apart * t.behind_se]
    group = [t.name for t in placed if t is placed[0] or t in alike]
    fitted = {t.name for t in placed}
    for s in scores.scores:
        # Those that were not fitted count by their first order.
        behind = best.score.gain - s.gain
        if s.name not in fitted and behind < apart * 2 * np.linalg.norm(best.score.direction - s.direction):
            group.append(s.name)
    return placed, group


def _verdict(rounds: list[Round]) -> str:
    first, last = rounds[0], rounds[-1]
    found = any(r.accepted for r in rounds)
    alone = all(len(e.repetitions) == 1 for e in first.point.campaign.train)
    left = last.scores.p_residual < CHANCE
    most = REST_ALONE if alone else REST
    rest = Yardstick(first.point, first.scores.expected).left(last.point)
    if not left or (found and rest <= most):
        return "mechanism" if found else "none"
    # Nothing is unexplained before it was tried.
    tried = any(r.scores.scores for r in rounds)
    return "unexplained" if tried and not rounds[-1].failed else "undecided"
