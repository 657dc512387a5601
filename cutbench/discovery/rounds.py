"""A round of questions: what each candidate would change, fits of those that explain most, their order."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress
from cutbench.calibration.prediction import Predictor
from cutbench.discovery.anywhere import Looked, looked
from cutbench.discovery.apart import alike, apart, by_rate, resembles, resembling, told
from cutbench.discovery.candidates import Candidate, candidates
from cutbench.discovery.causes import PRICE
from cutbench.discovery.columns import Sensed, sense
from cutbench.discovery.extending import Place, extend
from cutbench.discovery.foreseen import Foreseen
from cutbench.discovery.heldout import Heldout, decide
from cutbench.discovery.judging import judged, together
from cutbench.discovery.outcome import Round, Tried
from cutbench.discovery.point import Point, own_part, undetermined
from cutbench.discovery.score import Score, Scores, deviations, score
from cutbench.discovery.sounder import MOST, Elsewhere, does_nothing, without
from cutbench.discovery.yardstick import Yardstick

#: A candidate on its own is worth a fit if it gains more than chance does this often.
PROMISING = 0.1
#: Chances below this are all alike: the draws do not reach so far.
TOLD = 1e-4
#: So many are fitted in a round, without a mesh and with one.
FITS, FITS_MESHED = 6, 3
#: Where cuts have values of their own, those that are alike to these by this part of the most alike; beside
#: a law that explains all, those that are foreseen to gain this part as much.
LIKE = 0.7
#: So many are computed with at a finite strength, with a mesh.
PROBED = 8
#: With a mesh, where one that was fitted convinces, only those whose score is this part of its.
NEAR = 0.5
#: A rig or reading that is foreseen to leave no more than the first is fitted first, so many at the most;
#: one that is foreseen to leave more than the last is not fitted.
LEFT, FIRST, ALL = 0.6, 2, 0.9
#: Values of shapes tried where the data leave them open; how far scores may lie behind, in prices.
SHAPES, OPEN = 3, 5


def round_of(
    point: Point,
    run: Predictor,
    seed: int,
    on_progress: OnProgress,
    enough: float = PROMISING,
    again: bool = False,
) -> Round:
    """What is asked of the model at ``point``. With a mesh nothing where chance leaves as much with a
    probability of ``enough``, and first what knows of speed where each cut would have a value of its own.
    A KeyboardInterrupt ends it with what was tried until then; so does a candidate that has led to where the
    model is likelier without it, if it can be asked ``again``.

    Raises ComputationFailed if no candidate's run can be computed.
    """
    chosen, left_out = candidates(point.inverse, point.case)
    asking = _Asking(point, run, seed, on_progress, again)
    try:
        made = asking.all(chosen, left_out, enough)
        return replace(made, elsewhere=asking.elsewhere if made.accepted else None)
    except (KeyboardInterrupt, Elsewhere) as end:
        made = together(asking.made) if asking.made else asking.none(left_out)
        if isinstance(end, Elsewhere):
            return replace(made, accepted=None, elsewhere=asking.elsewhere)
        return replace(made, stopped=True)


def _explained(this: Round) -> bool:
    """Whether what was accepted explains all."""
    return any(t.whole for t in this.tried if t.name == this.accepted)


def _likelier(before: Round | None, this: Round) -> Round:
    """Of two rounds at the same point the one whose cause makes its data likelier."""
    if before is None or before.accepted is None:
        return this
    gains = [
        t.gain - PRICE * len(t.score.column.candidate.parameters)
        for r in (before, this) for t in r.tried if t.name == r.accepted
    ]  # fmt: skip
    return this if len(gains) > 1 and gains[1] > gains[0] else before


@dataclass
class _Asking:
    """Of the model at ``point``. ``elsewhere``: where (k,) it is likelier, if a candidate has led there."""

    point: Point
    run: Predictor
    seed: int
    on_progress: OnProgress
    again: bool = False
    #: What was asked until now.
    made: list[Round] = field(default_factory=list)
    elsewhere: np.ndarray | None = None

    @cached_property
    def plain(self) -> Scores:
        """What chance says of the residual at the point."""
        return score(self.nothing, self.point.w.noise, self.point.residual, seed=self.seed)

    @cached_property
    def left(self) -> dict[str, float]:
        """The part of what is wrong that each rig and reading is foreseen to leave, the least first."""
        foreseen = Foreseen(self.point)
        if not foreseen.able:
            return {}
        chosen, _ = candidates(self.point.inverse, self.point.case)
        return dict(sorted(foreseen.rigs(chosen).items(), key=lambda each: each[1]))

    @property
    def nothing(self) -> Sensed:
        """No candidate at all."""
        return Sensed(dict(self.point.y), dict(self.point.J), [])

    def none(self, left_out: Mapping[str, str]) -> Round:
        """Where no candidate was asked."""
        return Round(self.point, self.nothing, self.plain, (), (), None, left_out, {})

    def all(self, chosen: Sequence[Candidate], left_out: Mapping[str, str], enough: float) -> Round:
        """All that is to be asked, unless chance leaves as much with a probability of ``enough``."""
        point = self.point
        if not point.meshed:
            return self.at(Place.of(point), chosen, left_out)
        if self.plain.p_residual >= enough:
            return self.none(left_out)
        before = self.foreseen(chosen, left_out, self.plain)
        if before is not None and _explained(before):
            return before
        some, idle = by_rate(point, chosen)
        if places := apart(point, self.on_progress, some if idle else ()):
            every, _ = candidates(point.inverse, point.case, one_a_class=False)
            this = self.beside(places, some, every, {**left_out, **idle}, self.plain)
            if this.accepted is None and idle:
                this = self.anywhere(chosen, idle, left_out)
            return replace(_likelier(before, this), own=tuple(map(told, places)))
        return _likelier(before, self.anywhere(chosen, idle, left_out))

    def foreseen(
        self, chosen: Sequence[Candidate], left_out: Mapping[str, str], plain: Scores
    ) -> Round | None:
        """The rigs and readings alone, of which those are fitted that are foreseen to explain much; None
        where none is."""
        left = [name for name, part in [*self.left.items()][:FIRST] if part <= LEFT]
        if not left:
            return None
        rigs = [c for c in chosen if c.slot == "rig"]
        others = {c.name: "not asked: a rig or a reading explains it" for c in chosen if c.slot != "rig"}
        return self.at(Place.of(self.point), rigs, {**left_out, **others}, plain, left)

    def anywhere(
        self, chosen: Sequence[Candidate], idle: Collection[str], left_out: Mapping[str, str]
    ) -> Round:
        """Of the ``chosen`` those laws that are ``idle``, no time occurring in them, which are foreseen to
        gain most, wherever the model itself has ended; by their scores at the point, if there are none."""
        laws = [c for c in chosen if c.name in idle and c.slot != "rig"]
        every, _ = candidates(self.point.inverse, self.point.case, one_a_class=False)
        paying, vain = looked(self.point, laws, every, self.on_progress)
        found = {one.candidate.name: one for one in paying}
        if not found:
            vain = [*vain, *(name for name, part in self.left.items() if part > ALL)]
        why = {**left_out, **dict.fromkeys(vain, "not asked: it is foreseen to explain nothing")}
        if not found:
            fitted = {t.name for each in self.made for t in each.tried}
            rest = [c for c in chosen if c.name not in {*vain, *fitted}]
            if not rest:
                return together(self.made) if self.made else self.none(why)
            return self.at(Place.of(self.point), rest, why)
        more = [c for c in every if c.name in found and c not in chosen]
        why = {name: reason for name, reason in left_out.items() if name not in found}
        return self.at(Place.of(self.point), [*chosen, *more], why, None, [*found], found)

    def beside(
        self,
        places: Sequence[Place],
        chosen: Sequence[Candidate],
        every: Sequence[Candidate],
        left_out: Mapping[str, str],
        plain: Scores,
    ) -> Round:
        """What cuts have of their own at each of ``places``, as one round: ``every`` formula that resembles
        it, else those that are ``chosen``. None more once a cause explains all of what is wrong."""
        made: list[Round] = []
        for place in places:
            if made and _explained(made[-1]):
                break
            alike, unlike = resembling(place, chosen, every)
            made.append(self.at(place, alike, {**left_out, **unlike}, plain))
        return together(made)

    def at(
        self,
        place: Place,
        chosen: Sequence[Candidate],
        left_out: Mapping[str, str],
        plain: Scores | None = None,
        named: Sequence[str] | None = None,
        found: Mapping[str, Looked] | None = None,
    ) -> Round:
        """``plain``: what chance says of the residual at the point, where the place is another. ``named``:
        those that are fitted, in that order, where it is not by their scores; ``found``: where these were
        looked at."""
        point, names = self.point, ", ".join(self.point.case.mechanisms)
        self.on_progress(math.nan, math.nan, f"{len(chosen)} candidates beside {names}")

        def scored_at(sensed: Sensed) -> tuple[Sensed, Scores]:
            sensed = replace(sensed, J={id: J @ place.S for id, J in sensed.J.items()})
            return sensed, score(sensed, point.w.noise, place.residual, seed=self.seed)

        def likely(exact: Sensed) -> list[str]:
            if named is not None:
                return [*named]
            by_gain = sorted(scored_at(exact)[1].scores, key=lambda s: -s.gain)
            return [s.name for s in by_gain[:PROBED]]

        sensed, scores = scored_at(sense(place.inverse, place.q, chosen, self.run, likely))
        if plain is not None:
            scores = replace(scores, chi2=plain.chi2, p_residual=plain.p_residual)
        scored = {s.name for s in scores.scores}
        failed = {c.name: "no run could take it up beside the others" for c in chosen if c.name not in scored}
        tried: list[Tried] = []
        try:
            for each in self._trying(place, scores, failed, named, found or {}):
                tried.append(each)
        finally:
            self.made.append(made := judged(point, sensed, scores, tried, left_out, failed))
        return made

    def _look_elsewhere(self, after: Point) -> None:
        """Raises Elsewhere where the model alone has most of what a candidate gains, ``after``."""
        if self.again and (found := without(self.point, after)) is not None:
            self.elsewhere, part = found
            if part >= MOST:
                raise Elsewhere

    def _trying(
        self,
        place: Place,
        scores: Scores,
        failed: dict[str, str],
        named: Sequence[str] | None,
        found: Mapping[str, Looked],
    ) -> Iterator[Tried]:
        """Those worth it, fitted one after the other; why others could not be goes into ``failed``."""
        point, wrong = self.point, Yardstick(self.point, scores.expected)
        worth = [s for s in scores.scores if s.p < PROMISING and s.gain > 1]
        order = _simplest(worth)
        if place.apart:
            order = _alike(point, place, scores)
        if named is not None:
            scored = {s.name: s for s in scores.scores}
            order = [scored[name] for name in named if name in scored]
        # What is asked before physics costs little without a mesh.
        cheap = [s for s in worth[FITS:] if s.column.candidate.cause != "mechanism"]
        tried: list[Tried] = []
        for s in order[:FITS_MESHED] if point.meshed else [*worth[:FITS], *cheap]:
            convincing = [t for t in tried if point.meshed and t.convincing]
            enough = max((t.score.gain for t in convincing), default=0.0)
            if s.gain < NEAR * enough and not place.apart and named is None:
                continue
            like = s.name in found and found[s.name].paid >= LIKE * found[order[0].name].paid
            if any(t.whole for t in convincing) and not like:
                break
            self.on_progress(math.nan, math.nan, f"fitting {s.name}: score {s.z:.1f}")
            try:
                after = extend(point, s, place=place, looked=found.get(s.name))
                self._look_elsewhere(after)
            except (ComputationFailed, BadInput) as error:
                failed[s.name] = str(error)
                continue
            after, held, kept = _shaped(point, s, after, scores)
            # Where chance made the residual as small as noise, what gains anything gains all of it.
            gain, share = max(after.likelihood - point.likelihood, 0.0), max(1 - wrong.left(after), 0.0)
            if does_nothing(point, after):
                gain = share = 0.0
            own = own_part(after, s.column.candidate)
            chance = scores.p_any(s.name, gain)
            tried.append(Tried(s, after, held, gain, chance, share, shapes_open=kept, own=own))
            yield tried[-1]


def _alike(point: Point, place: Place, scores: Scores) -> list[Score]:
    """Those that resemble what cuts have of their own, and whose changes are like it."""
    ranked = [alike(point, place, s) for s in scores.scores]
    ranked.sort(key=lambda each: -each[0])
    most = ranked[0][0] if ranked else 0.0
    return [s for part, s in ranked if resembles(s.name, place) or part >= LIKE * most > 0]


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
