"""Where a run ends: at the end of the blade's way, or where its transition is known."""

from __future__ import annotations

import math

from cutbench.case.case import Case
from cutbench.case.motion import TRANSITION, Motion
from cutbench.run.ledger import Ledger
from cutbench.run.measures import KNOWN, ONSET_MM, first_crossing


class StoppingCriterion:
    """Of one run. What it needs it reads off the ``ledger``, so a run that goes on has the same end."""

    def __init__(self, case: Case, motion: Motion, ledger: Ledger):
        self._ends_early = case.until == TRANSITION
        self._behind = KNOWN * case.values.get("thickness", math.inf)
        self._end, self._ledger, self.onset = motion.end, ledger, math.nan

    def mm(self) -> float:
        """The blade's time × speed at the end, as far as that is known by now."""
        if not self._ends_early:
            return self._end
        if math.isnan(self.onset) and self._ledger.grown_mm >= ONSET_MM:
            columns = self._ledger.columns()
            cut = columns["cut_length_mm"]
            self.onset = first_crossing(columns["displacement_mm"], cut - cut[0], ONSET_MM)
        return min(self._end, self.onset + self._behind)  # nan is not less

    def known(self) -> bool:
        """Whether the transition is, and nothing more was asked for."""
        return self._ends_early and self._end > self.mm() <= self._ledger.last["displacement_mm"]

    def __str__(self) -> str:
        reached = self._ledger.last["displacement_mm"]
        return (
            f"ended at {reached:.3g} mm, {KNOWN:g} blade thicknesses after the onset at {self.onset:.3g} mm"
        )
