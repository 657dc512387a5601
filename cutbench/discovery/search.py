"""The search: fit, score, extend, hold against what was not fitted, and again until nothing is gained."""

from __future__ import annotations

import math
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, Until, silent
from cutbench.calibration.fitted import Fit
from cutbench.calibration.fitting import fit
from cutbench.calibration.inverse import GRID
from cutbench.calibration.prediction import Predictor, predictor
from cutbench.data.campaign import Campaign
from cutbench.discovery.candidates import CLOCKLESS, Candidate, baseline_of, family_of
from cutbench.discovery.causes import Cause, pruned
from cutbench.discovery.clean import clean_gain
from cutbench.discovery.event import events
from cutbench.discovery.heldout import TESTS, compare, decide
from cutbench.discovery.judging import against
from cutbench.discovery.numerical import numerical_causes
from cutbench.discovery.outcome import (
    CHANCE,
    ELSEWHERE,
    INTERRUPTED,
    LATE,
    SHARE,
    SURELY,
    Discovery,
    NumericalCauses,
    Round,
    Tried,
)
from cutbench.discovery.point import Point, point_of, settled
from cutbench.discovery.protocol import Proposal, cut_proposals, proposals, sentence
from cutbench.discovery.rounds import PROMISING, round_of
from cutbench.discovery.sounder import moved
from cutbench.discovery.where import sections
from cutbench.discovery.yardstick import Yardstick
from cutbench.run.pool.pool import cores

#: What may stay significant beside what was found, as a part of what was wrong, where candidates could not be
#: tried. Where the scatter between specimens was not measured, more of it may be scatter.
REST, REST_ALONE = 0.25, 0.5
#: What a later cause must take away of what the baseline gets wrong, in the root mean square; its part of
#: what is left; by how many standard errors it must predict better. No specimen follows a formula: what that
#: of the first cause leaves is no cause of its own, and any other takes some of it up. Of cuts, jags leave a
#: per cent or two of each curve, too.
NAMED, NAMED_MESHED, MAIN = 0.06, 0.1, 0.5
#: Or else it must take away ``ELSEWHERE`` of the error of tests that were not fitted, and by so many standard
#: errors.
LIKELY = 2.5
#: By so much the gain on held-out data may fall when the extended model is fitted to the end.
WORSE = 0.1
#: Causes found, at the most; firsts of a pair that are tried.
MOST, FIRSTS = 4, 3
#: So often a model is fitted again where the search for what it lacks has led.
AGAIN = 2


@watched("")
def discover(
    campaign: Campaign,
    *,
    workers: int | None = None,
    refine: bool = True,
    on_progress: OnProgress = silent,
    grid: int = GRID,
    seed: int = 0,
    kept: str | Path | None = None,
    limit_s: float = math.inf,
    run: Predictor | None = None,
) -> Discovery:
    """``on_progress`` has what is done now; how much there is to do is not known. Ctrl-C, or the end of
    ``limit_s`` seconds, once the baseline is fitted ends with what was found until then. Cuts are left in the
    folder ``kept``, and taken from there if they were computed before. ``run`` predicts in place of that.

    Raises BadInput, ComputationFailed if the baseline cannot be computed, or not in ``limit_s``, and
    KeyboardInterrupt.
    """
    began = time.perf_counter()
    due = time.monotonic() + limit_s
    campaign = baseline_of(campaign)
    count = cores() if workers is None else workers
    runs = 3 * sum(e.kind == "cut" for e in campaign.experiments)
    # What the fit has computed, others are foreseen from.
    ready = predictor(min(count, runs), kept, Until(due)) if run is None else nullcontext(run)
    with ready as run:
        try:
            fitted, point = _baseline(campaign, run, refine, grid, on_progress)
        except KeyboardInterrupt:
            if _why(due) == LATE:
                late = f"the baseline is not fitted after {limit_s:g} s, the limit given"
                raise ComputationFailed(late) from None
            raise
        point, once = events(point)
        search = _Search(fitted, point, run, refine, seed, on_progress)
        search.all()
        rounds, point, causes = search.rounds, search.point, search.causes
        stopped = _why(due) if search.stopped else ""
        gain = compare(rounds[0].point, point) if causes else None
        clean = clean_gain(rounds[0].point, point, seed) if causes else None
        verdict = _verdict(rounds, stopped)
        proposed: list[Proposal] = []
        text = f"Not asked: {stopped}."
        if not stopped:
            try:
                proposed, text = _next(rounds, verdict, bool(once), run, on_progress)
            except KeyboardInterrupt:
                text = f"Not asked: {_why(due)}."
    how = [f"Ended early ({stopped}): what was found stands, what else there may be was not asked."]
    own = [note for each in rounds for note in each.own]
    timed = ", ".join(name for name, why in rounds[0].left_out.items() if why == CLOCKLESS)
    own += [f"What depends on time is not asked ({timed}): {CLOCKLESS}."] if timed else []
    notes = (*(how if stopped else []), *once, *own, *search.fitted.notes, *rounds[0].point.trouble)
    return Discovery(
        campaign, search.fitted, verdict, tuple(causes), tuple(rounds), point, gain,
        tuple(sections(rounds[0].point)), tuple(sections(point)), search.numerics, tuple(proposed), text,
        time.perf_counter() - began, tuple(dict.fromkeys(notes)), stopped, clean, once,
    )  # fmt: skip


def _baseline(
    campaign: Campaign, run: Predictor, refine: bool, grid: int, on_progress: OnProgress
) -> tuple[Fit, Point]:
    """The fit of the baseline, and the model at its end. Raises as ``discover`` does."""
    on_progress(math.nan, math.nan, "fitting the baseline")
    fitted = fit(
        campaign, run=run, refine=refine, grid=grid,
        on_progress=lambda done, total, text: on_progress(done, total, f"fitting the baseline, {text}"),
    )  # fmt: skip
    if fitted.status == "interrupted":
        raise KeyboardInterrupt
    return fitted, point_of(fitted, run)


def _why(due: float) -> str:
    """Why a computation ends early that was to end when it is ``due``."""
    return LATE if time.monotonic() >= due else INTERRUPTED


class _Search:
    """Round after round, from the baseline's ``point`` on."""

    def __init__(
        self, fitted: Fit, point: Point, run: Predictor, refine: bool, seed: int, on_progress: OnProgress
    ):
        self.fitted, self.point, self._run = fitted, point, run
        self._refine, self._seed, self._on_progress = refine, seed, on_progress
        self.rounds: list[Round] = []
        self.found: list[Candidate] = []
        self.causes: list[Cause] = []
        self.numerics, self.stopped, self._again = NumericalCauses(), False, AGAIN

    def all(self) -> None:
        """Until nothing is gained, or it is ``stopped``. Raises KeyboardInterrupt if nothing was asked."""
        try:
            while self._another():
                pass
            self.stopped = any(each.stopped for each in self.rounds)
            if self.found and not self.stopped:
                self._prune()
        except KeyboardInterrupt:
            if not self.rounds:
                raise
            self.stopped = True
        if self.stopped:
            self.causes = [Cause(c, None) for c in self.found]

    def _another(self) -> bool:
        """A round, and whether there is to be one more."""
        more = self._asked()
        if self.rounds and not _worth_a_name(more[-1], self.rounds[0]):
            more = [replace(more[0], accepted=None)]
        self.rounds += more
        if more[0].accepted is None or len(self.found) >= MOST:
            return False
        for each in more:
            taken = next(t for t in each.tried if t.name == each.accepted)
            self.found.append(taken.score.column.candidate)
            self.point = taken.point
        if any(each.stopped for each in more):
            return False
        after = settled(self.point, self._run, self._refine, self._on_progress)
        self.point = _surer(self.rounds[0].point, self.point, after)
        return True

    def _asked(self) -> list[Round]:
        """What is asked of the model; of a pair both rounds."""
        this = self._round()
        if self.numerics.explains:
            return [replace(this, accepted=None)]
        if this.accepted is None and this.scores.p_residual < CHANCE and not this.stopped:
            this, then = _pair(this, self._run, self._seed, self._on_progress)
            return [this] if then is None else [this, then]
        return [this]

    def _round(self) -> Round:
        """One round, of the model where it is likeliest."""
        while True:
            this = round_of(
                self.point, self._run, self._seed, self._on_progress, self._enough, self._again > 0
            )
            try:
                if this.elsewhere is not None:
                    self._again -= 1
                    self._move(this.elsewhere)
                    if this.accepted is not None:
                        this = against(this, self.point)
                    if this.accepted is None:
                        continue
                if not (self.rounds or this.stopped):
                    self.numerics = numerical_causes(this, self._run, self._seed, self._on_progress)
            except KeyboardInterrupt:
                this = replace(this, stopped=True)
            return this

    @property
    def _enough(self) -> float:
        """What is left so often by chance is not asked what it is: a second cause of what may be chance is
        none, nor of less than a later cause has to take away."""
        if not self.rounds:
            return PROMISING
        first = self.rounds[0]
        left = Yardstick(first.point, first.scores.expected).left(self.point)
        return 0.0 if self.point.meshed and math.sqrt(left) <= NAMED_MESHED else CHANCE

    def _move(self, q: np.ndarray) -> None:
        """The model to ``q`` (k,), where it is likelier, and to the end from there."""
        better = moved(self.point, q, self._run, self._refine, self._on_progress)
        if better is not None:
            self.fitted = self.fitted if self.rounds else better[0]
            self.point = better[1]

    def _prune(self) -> None:
        """Without causes that predict nothing beside the others."""
        first, last = self.rounds[0].point, self.point
        self.point, self.causes = pruned(first, last, self.found, self._run, self._on_progress)
        if self.point is not last and self.rounds[-1].accepted is None:
            # What is left is that of the model that stays.
            this = round_of(self.point, self._run, self._seed, self._on_progress)
            self.rounds[-1] = replace(this, accepted=None)


def _next(
    rounds: list[Round], verdict: str, once: bool, run: Predictor, on_progress: OnProgress
) -> tuple[list[Proposal], str]:
    """The test that would separate the first two of the first group; with cuts, where it costs as much as
    several of them, only if one of the two was accepted. ``once``: whether something happened once."""
    named = [r for r in rounds if r.accepted] or [r for r in rounds[:1] if not r.point.meshed]
    r = next((r for r in named if len(r.group) > 1), None)
    if verdict == "none" and not any(r.accepted for r in rounds):
        again = "Repeat the test in which something happened once: a cause returns, an event does not."
        return [], again if once else "None is needed: the model describes the tests to within their scatter."
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


def _pair(this: Round, run: Predictor, seed: int, on_progress: OnProgress) -> tuple[Round, Round | None]:
    """Where none convinces alone: the two, one after the other, that do together; else ``this`` as it is.

    A cause can hide behind another: what is left of it, taken alone, the other's shape contradicts.
    """
    wrong = Yardstick(this.point, this.scores.expected)
    best: tuple[float, Tried, Round] | None = None
    able = sorted((t for t in this.tried if t.p_any < CHANCE), key=lambda t: -t.gain)
    for t in able[: 1 if this.point.meshed else FIRSTS]:
        on_progress(math.nan, math.nan, f"what convinces beside {t.name}")
        then = round_of(t.point, run, seed, on_progress)
        if then.stopped:
            return replace(this, stopped=True), None
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
    if first.point.meshed and added.point.tests and held.how != TESTS:
        # What a formula leaves of the fitted cuts another one takes up; it need not be so in other cuts.
        return False
    seen = held.how == TESTS and held.better > LIKELY * held.better_se
    if seen and max(held.gain, held.gain_of_shape) > ELSEWHERE:
        return True
    wrong = Yardstick(first.point, first.scores.expected)
    taken = math.sqrt(wrong.left(this.point)) - math.sqrt(wrong.left(added.point))
    named = NAMED_MESHED if this.point.meshed else NAMED
    return held.better > SURELY * held.better_se and taken > named


def _verdict(rounds: list[Round], stopped: str = "") -> str:
    first, last = rounds[0], rounds[-1]
    found = any(r.accepted for r in rounds)
    alone = all(len(e.repetitions) == 1 for e in first.point.campaign.train)
    left = last.scores.p_residual < CHANCE
    most = REST_ALONE if alone else REST
    rest = Yardstick(first.point, first.scores.expected).left(last.point)
    if not left:
        return "mechanism" if found else "none"
    if stopped:
        return "mechanism" if found else "undecided"
    # Nothing is unexplained before it was tried.
    tried = any(r.scores.scores for r in rounds) and not rounds[-1].failed
    if found and (tried or rest <= most):
        return "mechanism"
    return "unexplained" if tried else "undecided"
