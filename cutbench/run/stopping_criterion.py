"""Where a run ends, at the end of the blade's way or where its transition is known, and the words for it."""

from __future__ import annotations

import math

from cutbench.case.case import Case
from cutbench.case.motion import TRANSITION, Motion
from cutbench.run.ledger import Ledger
from cutbench.run.measures import KNOWN, ONSET, first_crossing
from cutbench.run.result import Outcome

#: What to try when a run stalls, by a word of the reason.
_ADVICE = {
    "invert": "Elements under the tip turn inside out: try a smaller h, a blunter tip, or element = 'P1'.",
    "energy": "The cut jumps: try a smaller step_min, or more viscosity (eta_reg).",
    "damage": "The cut jumps: try a larger damage_step, a smaller step_min, or more viscosity (eta_reg).",
    "singular": "The equations lost their solution: try a smaller h, or a larger damping.",
    "residual": "Newton's method does not converge: try a smaller h or penalty, or a larger damping.",
}


class StoppingCriterion:
    """Of one run. What it needs it reads off the ``ledger``, so a run that goes on has the same end."""

    def __init__(self, case: Case, motion: Motion, ledger: Ledger):
        self._ends_early = case.until == TRANSITION
        self._behind, self._begun = KNOWN * case.unit_mm, ONSET * case.unit_mm
        self._motion, self._ledger, self.onset = motion, ledger, math.nan

    def mm(self) -> float:
        """The blade's time × speed at the end, as far as that is known by now."""
        if not self._ends_early:
            return self._motion.end
        if math.isnan(self.onset) and self._ledger.grown_mm >= self._begun:
            columns = self._ledger.columns()
            cut = columns["cut_length_mm"]
            self.onset = first_crossing(columns["displacement_mm"], cut - cut[0], self._begun)
        return min(self._motion.end, self.onset + self._behind)  # nan is not less

    def known(self) -> bool:
        """Whether the transition is, and nothing more was asked for."""
        return self._ends_early and self._motion.end > self.mm() <= self._ledger.last["displacement_mm"]

    def outcome(self, interrupted: bool, stalled: str, step_min_mm: float, caution: str) -> Outcome:
        """How the run ended, ``interrupted`` by the user, ``stalled`` for a reason, or by itself."""
        reached, depth = self._ledger.last["displacement_mm"], self._motion.depth
        if interrupted:
            text = f"stopped by the user at {reached:.3f} mm of {depth:g} mm"
            return Outcome("interrupted", text, "The curve up to there is kept.", reached)
        if stalled:
            text = (
                f"no step above {step_min_mm:g} mm converges at {reached:.3f} mm of {depth:g} mm ({stalled})"
            )
            advice = next((text for word, text in _ADVICE.items() if word in stalled), _ADVICE["residual"])
            return Outcome("stalled", text, advice, reached)
        text = f"reached {depth:g} mm"
        if self.known():
            text = (
                f"ended at {reached:.3g} mm, {KNOWN:g} blade thicknesses after the onset at"
                f" {self.onset:.3g} mm"
            )
        elif self._motion.points:
            deepest = max(travel for _, travel in self._motion.points)
            text = f"went the whole way, {deepest:g} mm deep, to {reached:g} mm at last"
            reached = self._ledger.farthest
        return Outcome("done", text, caution, reached)
