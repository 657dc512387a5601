"""What candidates that were fitted say together: their order, and which of them is accepted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cutbench.discovery.candidates import ORDER
from cutbench.discovery.causes import PRICE
from cutbench.discovery.columns import Sensed
from cutbench.discovery.heldout import TESTS, better_than, decide
from cutbench.discovery.outcome import CHANCE, OWN, SHARE, SHARE_WEAK, Round, Tried
from cutbench.discovery.point import Point
from cutbench.discovery.score import Scores
from cutbench.discovery.yardstick import Yardstick

#: Fits are told apart by so many standard errors of their difference; more if known to first order only.
APART, APART_MESHED = 2.0, 3.0


def together(made: Sequence[Round]) -> Round:
    """What was asked at one place after the other, at the same point, as one round."""
    first, *others = made
    if not others:
        return first
    asked = {s.name for each in made for s in each.scores.scores}
    columns = [column for each in made for column in each.sensed.columns]
    scores = replace(
        first.scores,
        scores=[s for each in made for s in each.scores.scores],
        others={name: more for each in made for name, more in each.scores.others.items()},
        scale={name: size for each in made for name, size in each.scores.scale.items()},
    )
    tried = [t for each in made for t in each.tried]
    return judged(
        first.point, replace(first.sensed, columns=columns), scores, tried,
        {n: why for each in made for n, why in each.left_out.items() if n not in asked},
        {n: why for each in made for n, why in each.failed.items()},
    )  # fmt: skip


def against(this: Round, point: Point) -> Round:
    """What was tried in ``this`` round, held against the same model at another ``point``."""
    wrong = Yardstick(point, this.scores.expected)
    tried = []
    for t in this.tried:
        gain = max(t.point.likelihood - point.likelihood, 0.0)
        share, chance = max(1 - wrong.left(t.point), 0.0), this.scores.p_any(t.name, gain)
        tried.append(replace(t, gain=gain, share=share, p_any=chance, heldout=decide(point, t.point)))
    found = judged(point, this.sensed, this.scores, tried, this.left_out, this.failed)
    return replace(found, own=this.own)


def judged(
    point: Point,
    sensed: Sensed,
    scores: Scores,
    tried: list[Tried],
    left_out: Mapping[str, str],
    failed: Mapping[str, str],
) -> Round:
    """The round in which so much was ``tried``, with what is accepted of it."""
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


def _ordered(tried: list[Tried], scores: Scores, meshed: bool) -> tuple[list[Tried], list[str]]:
    """By χ² with the price of parameters; those that cannot be told from the first by what they predict."""
    if not tried:
        return [], []

    def cost(t: Tried) -> float:
        predicted = t.heldout.better if t.heldout.how == TESTS else 0.0
        return PRICE * len(t.score.column.candidate.parameters) - t.point.likelihood - predicted

    # What leaves nothing of the specimen explains nothing. Of cuts, in which jags are fitted too, what does
    # not convince comes after what does, however well it fits.
    tried = sorted(tried, key=lambda t: (t.own < OWN, meshed and not t.convincing, cost(t), t.name))
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
