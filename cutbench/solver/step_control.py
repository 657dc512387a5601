"""How long the next step is, and how much damping it has, after one that was taken or refused.

To a jump of the cut a smaller step is what more damping is. But the blade drags what it moves against raised
damping, a force of the method's own. So damping is raised where the blade goes a short way only, and then the
blade rests until it is back: states on the way there belong to no blade position, and no curve shows them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cutbench.case.tuning import StepTuning
from cutbench.solver.newton import NoConvergence


@dataclass(frozen=True)
class StepRules(StepTuning):
    """The tuned numbers with what a user chooses: blade travel per step in mm, largest and smallest."""

    largest: float = 0.1
    smallest: float = 1e-4
    #: Growth of damage that makes the next step smaller; twice as much refuses a step.
    damage: float = 0.2
    #: Largest part of the blade's work in a step that the ledger may leave open.
    defect: float = 0.05
    augmentations: int = 0
    #: Damage is held during Newton's method and updated until it stands still (the paper's scheme).
    staggered: bool = False
    #: A tenth of the step when damage grew by more than ``damage``, else five times (the paper's rule).
    paper: bool = False

    @property
    def second_order(self) -> bool:
        """Whether rates are of second order: the paper's are not, and where damage is held they have no mean
        over the step."""
        return not (self.paper or self.staggered)


class EnergyError(NoConvergence):
    """A step that converged, but whose energy does not close."""


#: What the blade does: it goes on; goes on against raised damping, where resting was in vain; rests until
#: raised damping is back; rests for forces to balance on a new mesh.
GOES, DRAGS, RESTS, SETTLES = "goes", "drags", "rests", "settles"


@dataclass(frozen=True)
class StepState:
    """What decides the next step: its ``size`` in mm, and how many times its value the damping is."""

    size: float
    damping_factor: float = 1.0
    blade: str = GOES
    #: Steps since the last one that was refused; refused ones since the last as long as ``StepRules.gentle``;
    #: and since the blade rests.
    easy: int = 0
    refused: int = 0
    vain: int = 0
    #: Growth of damage in the last step, per mm, where the cut has not begun.
    rate: float = 0.0

    @property
    def rests(self) -> bool:
        return self.blade in (RESTS, SETTLES)

    @property
    def advance(self) -> float:
        """Blade travel of the next step, mm."""
        return 0.0 if self.rests else self.size

    @property
    def between(self) -> bool:
        """Whether a step taken now ends between two points of the curve."""
        return (self.damping_factor > 1 or self.blade == SETTLES) and self.blade != DRAGS

    def settled(self) -> StepState:
        """The same on a new mesh: the blade rests until forces balance there."""
        if self.damping_factor > 1 or self.rests:
            return self
        return replace(self, blade=SETTLES, vain=0)

    def with_next_step(self, advance: float, damping_factor: float) -> StepState:
        """The same with the next step given."""
        blade = GOES if advance else SETTLES if self.blade == SETTLES else RESTS
        return replace(self, size=advance or self.size, damping_factor=damping_factor, blade=blade)


@dataclass(frozen=True)
class StepControl:
    """From one step to the next: ``accepts`` it or raises; what comes after is ``after`` it, or ``shorter``.

    ``damped``: whether there is a damping to raise.
    """

    rules: StepRules
    damped: bool = True

    def duration(self, now: StepState) -> float:
        """Time of the next step times the speed: short where the blade rests, so that nothing creeps."""
        return self.rules.smallest if now.rests else now.size

    def allowed(
        self, size: float, spent: float, left: float, spent_before: float, left_before: float
    ) -> float:
        """Part of the blade's work over the largest step that one of this ``size`` may leave open: less where
        it adds to what the ledger has left open so far, and that is too much already. At rest, size 0, it is
        as for the largest step: no shorter one closes better there, and damping worse."""
        rules = self.rules
        drifts = left * left_before > 0 and abs(left_before + left) > rules.drift * (spent_before + spent)
        own = max(size or rules.largest, rules.finest) / rules.largest
        return min(rules.defect / 4, 2 * rules.drift * own) if drifts else rules.defect

    def check(
        self, now: StepState, growth: float, defect: float, allowed: float, nascent: float = 0.0
    ) -> None:
        """Raises NoConvergence where damage grew by too much, or too much of the energy is left open.

        ``growth`` of damage where the cut has begun, ``nascent`` where it has not.
        """
        rules, size = self.rules, now.size
        if rules.paper:
            return
        # A jump of the front breaks as much in a step of any length: shorter ones would end in damping.
        if self._strained(growth, nascent, 2) and size > rules.finest:
            raise NoConvergence(f"damage grew by {max(growth, nascent):.2f}")
        able = self.damped and now.damping_factor < rules.jump_damping
        # Where errors add up, it is their mean over some steps that has to be small.
        shortens = size > rules.finest and now.blade != SETTLES
        if defect > min(2 * allowed, rules.defect) and (shortens or able):
            raise EnergyError(f"the energy of the step closes only to {defect:.0%}")

    def shorter(self, now: StepState, error: NoConvergence, moves: bool) -> StepState | None:
        """After a refused step; None if nothing is left to try. ``moves``: the blade has gone some way."""
        rules = self.rules
        now = replace(now, easy=0, refused=now.refused + 1)
        leaky, crawls = isinstance(error, EnergyError), now.refused > rules.patience
        if now.rests and self.damped:
            now = replace(now, vain=now.vain + 1)
            if now.vain > rules.tries:
                most = max(10.0, now.damping_factor * now.size / rules.smallest)
                return replace(now, blade=DRAGS, damping_factor=most)
        slowest = rules.finest if leaky else rules.gentle
        if not now.rests and now.size > (slowest if crawls else rules.smallest):
            snaps = moves and now.size <= rules.gentle and not leaky
            size = max(now.size * (rules.snap if snaps else rules.shrink), rules.smallest)
            return replace(now, size=size)
        if not self.damped:
            return None
        if not now.rests and crawls and now.size < rules.finest and now.damping_factor == 1:
            # Once: near the end of its way a step stays as short, and only damping is left to try.
            return replace(now, size=rules.finest, damping_factor=10.0)
        if now.damping_factor < rules.largest_damping:
            return replace(now, damping_factor=max(10.0, now.damping_factor * 10))
        return None

    def _strained(self, growth: float, nascent: float, times: float = 1.0) -> bool:
        """Whether damage grew by more than so many times what a step is made for."""
        most = self.rules.damage
        return growth > times * most or nascent > times * (most * self.rules.nascent)

    def after(
        self,
        now: StepState,
        hardest: int,
        growth: float,
        defect: float,
        allowed: float,
        nascent: float = 0.0,
    ) -> StepState:
        """After a step that needed ``hardest`` iterations at the most; growths of damage as in ``check``."""
        rules, size = self.rules, now.size
        now = replace(now, easy=now.easy + 1)
        if now.rests:
            return self._rested(now, hardest <= rules.iterations and defect < 0.35 * allowed)
        if now.blade == DRAGS:
            less = max(1.0, now.damping_factor * 0.6)
            now = replace(now, damping_factor=less, blade=DRAGS if less > 1 else GOES)
        elif now.damping_factor > 1:
            # What the damping is over a step, a force per displacement, stays the same.
            less = max(1.0, now.damping_factor * rules.smallest / size)
            now = replace(now, blade=RESTS, vain=0, damping_factor=less)
        return replace(
            now,
            size=self._size(now, hardest, growth, defect, allowed, nascent),
            rate=nascent / size,
            refused=0 if size >= rules.gentle else now.refused,
        )

    def _size(
        self, now: StepState, hardest: int, growth: float, defect: float, allowed: float, nascent: float
    ) -> float:
        rules, size, most = self.rules, now.size, self.rules.damage
        if rules.paper:
            much = max(growth, nascent) > most
            return max(size / 10, rules.smallest) if much else min(5 * size, rules.largest)
        by_rate = np.inf
        if nascent > rules.noticed * most and 0 < now.rate < nascent / size:
            by_rate = rules.resolved / np.log(nascent / size / now.rate)
        if by_rate < 1:
            return max(max(by_rate, rules.shrink) * size, rules.smallest)
        hard = hardest > rules.iterations + 3 or self._strained(growth, nascent)
        if hard or defect > rules.shorter * allowed:
            return max(rules.shorter * size, min(size, rules.smallest))
        if hardest <= rules.iterations and now.easy > 1:
            # Damage grows with the step, and what the ledger leaves open with its square.
            by_energy = np.sqrt(rules.target * rules.shorter * allowed / max(defect, 1e-9))
            by_damage = rules.target * most / max(growth, nascent / rules.nascent, 1e-9)
            room = min(by_damage, by_energy, by_rate)
            if room > 1:
                return min(size * min(room, rules.grow), rules.largest)
        return size

    def _rested(self, now: StepState, easily: bool) -> StepState:
        """After a step at rest: damping goes back, and once it has been at its value the blade goes on."""
        if now.damping_factor == 1:
            return replace(now, blade=GOES)
        less = now.damping_factor * (self.rules.calm if easily else self.rules.shrink)
        return replace(now, damping_factor=max(1.0, less))
