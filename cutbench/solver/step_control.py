"""How long the next step is, and how much damping it has, after one that was taken or refused.

To a jump of the cut a smaller step is what more damping is. But the blade drags what it moves against raised
damping, a force of the method's own. So damping is raised where the blade goes a short way only, and then the
blade rests until it is back: states on the way there belong to no blade position, and no curve shows them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cutbench.forms.damping import DampingForm
from cutbench.solver.newton import NoConvergence

#: The damping is raised to this many times its value before a run gives up.
LARGEST_DAMPING_FACTOR = 1e7
#: And to this before a step is taken whose energy does not close: within a jump it then spreads over several.
LARGEST_FACTOR_IN_A_JUMP = 1e4
#: Where the ledger has left more than this part of the blade's whole work open, steps that add to it are held
#: to a quarter of what they may leave open otherwise: errors of one sign must not add up.
DRIFT = 0.005


@dataclass(frozen=True)
class StepRules:
    """Blade travel per step in mm: largest, smallest, first; targets that change it."""

    largest: float = 0.1
    smallest: float = 1e-4
    first: float = 0.02
    damage: float = 0.2
    iterations: int = 6
    grow: float = 1.5
    #: By less than this it does not grow at all.
    least: float = 1.0
    shrink: float = 0.5
    tenth: float = 0.1
    augmentations: int = 0
    #: Largest part of the blade's work in a step that the ledger may leave open.
    defect: float = 0.05
    #: Below this step, in mm, where Newton's method fails the next one is a tenth: a snap has begun.
    gentle: float = 0.03
    #: After so many refused steps since the last one as long as that it is no snap, and damping is raised at
    #: any step below it until one is as long again.
    patience: int = 40
    #: Below this step, in mm, one whose energy does not close is taken where damping has been raised in vain.
    finest: float = 5e-3
    #: Steps at rest that may be refused before the blade goes on against raised damping.
    tries: int = 30
    #: What is left of raised damping after a step at rest that was easy.
    calm: float = 0.2
    #: Damage is held during Newton's method and updated until it stands still (the paper's scheme).
    staggered: bool = False
    #: Where the cut grows faster than the blade goes, steps are made for less damage by as much, and so many
    #: times less at the most: the cut then gathers speed, and rates are differences over a step.
    cut_speed_factor: float = 1.0
    #: A tenth of the step when damage grew by more than ``damage``, else five times (the paper's rule).
    paper: bool = False


#: What a pace is between two steps.
_STATE = ("size", "easy", "refused", "rests", "drags", "vain", "settles", "damping_factor")


#: Part of what damage and the ledger may do in a step that the next one is made for.
TARGET = 0.9


class EnergyError(NoConvergence):
    """A step that converged, but whose energy does not close."""


def drifts(spent: float, left: float, spent_before: float, left_before: float) -> bool:
    """Whether a step adds to what the ledger has left open so far, and that is too much already."""
    return left * left_before > 0 and abs(left_before + left) > DRIFT * (spent_before + spent)


@dataclass
class StepControl:
    """``size`` of the next step in mm; ``easy`` steps since the last one that was refused; ``refused`` ones
    since the last as long as ``StepRules.gentle``. ``damping``: the form whose boost it sets, or None."""

    rules: StepRules
    damping: DampingForm | None
    size: float
    easy: int = 0
    refused: int = 0
    #: Whether the blade rests until raised damping is back; or goes on against it, where that was in vain.
    rests: bool = False
    drags: bool = False
    #: Refused steps since the blade rests.
    vain: int = 0
    #: Whether it rests for forces to balance on a new mesh.
    settles: bool = False

    def state(self) -> dict[str, float]:
        """What ``restore`` needs."""
        return {name: getattr(self, name) for name in _STATE}

    def restore(self, state: Mapping[str, float]) -> None:
        """Go on as the pace whose ``state`` this was."""
        for name in _STATE:
            setattr(self, name, state[name])

    @property
    def advance(self) -> float:
        """Blade travel of the next step, mm."""
        return 0.0 if self.rests else self.size

    @property
    def duration(self) -> float:
        """Its time times the speed: short where the blade rests, so that nothing creeps."""
        return self.rules.smallest if self.rests else self.size

    @property
    def between(self) -> bool:
        """Whether a step taken now ends between two points of the curve."""
        return (self.damping_factor > 1 or self.settles) and not self.drags

    @property
    def damping_factor(self) -> float:
        return 1.0 if self.damping is None else self.damping.damping_factor

    @damping_factor.setter
    def damping_factor(self, value: float) -> None:
        if self.damping is not None:
            self.damping.damping_factor = value

    def allowed(self, drifting: bool) -> float:
        """Part of the blade's work over the largest step that a step may leave open."""
        return self.rules.defect / 4 if drifting else self.rules.defect

    def check(self, growth: float, defect: float, allowed: float) -> None:
        """Raises NoConvergence where damage grew by too much, or too much of the energy is left open."""
        rules, size = self.rules, self.size
        if rules.paper or self.settles:
            return
        if growth > 2 * rules.damage and size > 4 * rules.smallest:
            raise NoConvergence(f"damage grew by {growth:.2f}")
        able = self.damping is not None and self.damping_factor < LARGEST_FACTOR_IN_A_JUMP
        # Where errors add up, it is their mean over some steps that has to be small.
        if defect > min(2 * allowed, rules.defect) and (size > rules.finest or able):
            raise EnergyError(f"the energy of the step closes only to {defect:.0%}")

    def shorten(self, error: NoConvergence, moves: bool) -> bool:
        """After a refused step; False if nothing is left to try. ``moves``: the blade has gone some way."""
        rules = self.rules
        self.easy, self.refused = 0, self.refused + 1
        leaky, crawls = isinstance(error, EnergyError), self.refused > rules.patience
        if self.rests:
            self.vain += 1
            if self.vain > rules.tries:
                self.rests, self.drags, self.settles = False, True, False
                self.damping.damping_factor = max(10.0, self.damping_factor * self.size / rules.smallest)
                return True
        slowest = rules.finest if leaky else rules.gentle
        if not self.rests and self.size > (slowest if crawls else rules.smallest):
            snaps = moves and self.size <= rules.gentle and not leaky
            self.size = max(self.size * (rules.tenth if snaps else rules.shrink), rules.smallest)
        elif self.damping is None:
            return False
        elif not self.rests and crawls and self.size < rules.finest and self.damping_factor == 1:
            # Once: near the end of its way a step stays as short, and only damping is left to try.
            self.size, self.damping.damping_factor = rules.finest, 10.0
        elif self.damping_factor < LARGEST_DAMPING_FACTOR:
            self.damping.damping_factor = max(10.0, self.damping_factor * 10)
        else:
            return False
        return True

    def taken(self, hardest: int, growth: float, defect: float, allowed: float) -> None:
        """After a step of ``size`` that needed ``hardest`` iterations at the most."""
        rules, size = self.rules, self.size
        self.easy += 1
        if self.rests:
            self._calm(hardest <= rules.iterations and defect < 0.35 * allowed)
            return
        if self.drags:
            self.damping.damping_factor = max(1.0, self.damping_factor * 0.6)
            self.drags = self.damping_factor > 1
        elif self.damping_factor > 1:
            # What the damping is over a step, a force per displacement, stays the same.
            self.rests, self.vain = True, 0
            self.damping.damping_factor = max(1.0, self.damping_factor * rules.smallest / size)
        if rules.paper:
            less = max(size / 10, rules.smallest)
            self.size = less if growth > rules.damage else min(5 * size, rules.largest)
        elif hardest > rules.iterations + 3 or growth > rules.damage or defect > 0.7 * allowed:
            self.size = max(0.7 * size, min(size, rules.smallest))
        elif hardest <= rules.iterations and self.easy > 1:
            # Damage grows with the step, and what the ledger leaves open with its square.
            room = min(
                TARGET * rules.damage / max(growth, 1e-9), np.sqrt(TARGET * 0.7 * allowed / max(defect, 1e-9))
            )
            if room > rules.least:
                self.size = min(size * min(room, rules.grow), rules.largest)
        if size >= rules.gentle:
            self.refused = 0

    def _calm(self, easily: bool) -> None:
        """After a step at rest: damping goes back, and once it has been at its value the blade goes on."""
        if self.damping_factor == 1:
            self.rests = self.settles = False
        else:
            self.damping.damping_factor = max(
                1.0, self.damping_factor * (self.rules.calm if easily else self.rules.shrink)
            )
