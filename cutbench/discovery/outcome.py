"""What a discovery is made of: candidates that were fitted, rounds, numerical causes, and all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from cutbench.base.handled import Handled
from cutbench.calibration.fitted import Fit
from cutbench.data.campaign import Campaign
from cutbench.discovery.causes import Cause
from cutbench.discovery.clean import CleanGain
from cutbench.discovery.columns import Sensed
from cutbench.discovery.heldout import TESTS, Heldout
from cutbench.discovery.point import Point
from cutbench.discovery.protocol import Proposal
from cutbench.discovery.score import Score, Scores
from cutbench.discovery.where import Section
from cutbench.discovery.yardstick import Yardstick

#: Chance of naming something where there is nothing, of all candidates together.
CHANCE = 0.005
#: A mechanism is named only if it explains this part of what is wrong.
SHARE, SHARE_WEAK = 0.3, 0.6
#: What explains so much of it leaves nothing for another to explain better.
WHOLE = 0.9
#: By so many standard errors tests that were not fitted must be predicted better, with this part of their
#: error gone, where they tell of a cause what the fitted ones leave to a chance of ``DOUBTED``.
SURELY, ELSEWHERE, DOUBTED = 4.0, 0.25, 0.1
#: Why a discovery ends early.
INTERRUPTED, LATE = "interrupted", "out of time"
#: An error of the reading makes no more of what was read than the specimen does.
OWN = 0.5


@dataclass(frozen=True)
class Tried:
    """A candidate fitted for real. ``gain`` in χ²; ``p_any``: so much by chance for any candidate; ``share``
    of what was wrong; ``behind``: χ² (with the price of its parameters) above the best of the round, and the
    standard error of that. ``shapes_open``: the train data do not determine its shapes. ``own``: the part of
    the curves that the specimen makes."""

    score: Score
    point: Point
    heldout: Heldout
    gain: float
    p_any: float
    share: float
    behind: float = 0.0
    behind_se: float = 0.0
    shapes_open: bool = False
    own: float = 1.0

    @property
    def name(self) -> str:
        return self.score.name

    @property
    def whole(self) -> bool:
        """Whether it leaves nothing for another to explain better."""
        return self.share >= WHOLE

    @property
    def convincing(self) -> bool:
        explains = (self.p_any < CHANCE or self._told) and self.share >= SHARE and self.own >= OWN
        return explains and self.heldout.accepted

    @property
    def _told(self) -> bool:
        """Whether tests that were not fitted leave no doubt of it. Of cuts, a drop that comes early or late
        outweighs all else there."""
        held = self.heldout
        better = held.how == TESTS and held.better > SURELY * held.better_se
        gained = max(held.gain, held.gain_of_shape) > ELSEWHERE
        return better and gained and self.p_any < DOUBTED and not self.point.meshed


@dataclass(frozen=True)
class Round:
    """``point``: the model at its beginning; ``tried`` in the order of what they explain; ``group``: names
    that these data cannot tell from the first of them; ``accepted``: name or None. ``left_out``: candidates
    that do not apply, ``failed``: those that could not be tried, each with the reason. ``own``: what cuts
    say each on its own, in sentences. ``stopped``: whether it ended before all was asked; ``elsewhere``:
    where (k,) the model is likelier, if it is to be asked there or something was accepted."""

    point: Point
    sensed: Sensed
    scores: Scores
    tried: tuple[Tried, ...]
    group: tuple[str, ...]
    accepted: str | None
    left_out: Mapping[str, str]
    failed: Mapping[str, str]
    own: tuple[str, ...] = ()
    stopped: bool = False
    elsewhere: np.ndarray | None = None

    @property
    def candidates(self) -> list[tuple[Score, Tried | None]]:
        """What was fitted in the order of ``tried``, then the others by their score."""
        names = {t.name for t in self.tried}
        rest = [(s, None) for s in self.scores.scores if s.name not in names]
        return [*((t.score, t) for t in self.tried), *rest]


@dataclass(frozen=True)
class NumericalCauses:
    """Scores of numerical causes; ``explains``: name of one that explains the residual as well as the best
    mechanism does, None otherwise; ``missing``: what could not be computed, and why."""

    scores: tuple[Score, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)
    explains: str | None = None
    missing: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class Discovery(Handled):
    """All that was found out. ``causes``: what the baseline lacks or gets wrong. ``final``: the extended
    model; the last of ``rounds`` has its residual.

    ``gain``: on held-out readings; ``clean``: on what test experiments would read without noise and scatter.
    ``stopped``: why it ended before all was asked; empty where all was. ``once``: what happened once in a
    cut, in sentences; no cause of it was looked for.
    ``wrong``: sections of the baseline's curves; ``left``: of the final model's, the most significant first.
    """

    handled_in: ClassVar[str] = "cutbench.discovery.handled"

    campaign: Campaign
    fit: Fit
    verdict: str
    causes: tuple[Cause, ...]
    rounds: tuple[Round, ...]
    final: Point
    gain: Heldout | None
    wrong: tuple[Section, ...]
    left: tuple[Section, ...]
    numerics: NumericalCauses
    proposed: tuple[Proposal, ...]
    next_experiment: str
    seconds: float
    notes: tuple[str, ...]
    stopped: str = ""
    clean: CleanGain | None = None
    once: tuple[str, ...] = ()

    @property
    def found(self) -> tuple[str, ...]:
        """Names of the causes, in the order in which they were found."""
        return tuple(c.name for c in self.causes)

    @property
    def rest(self) -> float:
        """The part of what the baseline gets wrong that the final model does."""
        return Yardstick(self.first, self.rounds[0].scores.expected).left(self.final)

    @property
    def first(self) -> Point:
        return self.rounds[0].point

    @property
    def telling(self) -> Round:
        """The round that found, else the first."""
        return next((r for r in self.rounds if r.accepted), self.rounds[0])

    @property
    def not_tried(self) -> dict[str, str]:
        """Candidates that could not be tried at last, each with the reason; where none was, also those that
        do not apply."""
        last = self.rounds[-1]
        return {**({} if last.scores.scores else last.left_out), **last.failed}

    @property
    def groups(self) -> list[tuple[str, ...]]:
        """Of mechanisms that cannot be told apart, for each that was found (or would have been first)."""
        if self.verdict == "none":
            return []
        return [r.group for r in self.rounds if len(r.group) > 1 and (r.accepted or not self.found)]
