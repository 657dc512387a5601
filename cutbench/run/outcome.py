"""How a run ended and, where it fell short, what to try; and what it found, in one sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from cutbench.case.case import Case
from cutbench.run.measures import ABRUPT, ABRUPT_DROP, BRIDGED, KNOWN, UNDECIDED, label

#: How a run can end; only ``"done"`` reached what was asked for, its depth or its transition.
OUTCOMES: Final = ("done", "stalled", "interrupted", "failed")


@dataclass(frozen=True)
class Outcome:
    """An outcome says how a run ended and, where it fell short, what to try.

    Attributes
    ----------
    kind : str
        ``done`` (its depth or its transition was reached), ``stalled`` (no smaller step converged),
        ``interrupted`` or ``failed``.
    message : str
        How it ended, in words.
    advice : str
        What to try; empty where nothing needs to be.
    reached_mm : float, mm
        Blade travel at the end.

    Raises
    ------
    ValueError
        For another kind.

    Examples
    --------
    >>> import cutbench
    >>> outcome = cutbench.Outcome("stalled", "no smaller step converges at 3 mm.", "Try a smaller h.", 3.0)
    >>> print(outcome)
    stalled: no smaller step converges at 3 mm. Try a smaller h.
    >>> outcome.done
    False
    """

    kind: str
    message: str
    advice: str = ""
    reached_mm: float = 0.0

    def __post_init__(self):
        if self.kind not in OUTCOMES:
            raise ValueError(f"outcome '{self.kind}' is none of {', '.join(OUTCOMES)}")

    @property
    def done(self) -> bool:
        """Whether the run reached what was asked for, its depth or its transition."""
        return self.kind == "done"

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}" + (f" {self.advice}" if self.advice else "")


def friction_advice(case: Case, onset_mm: float) -> str:
    """What there is to know of a blade that rubs and has not cut; empty for any other."""
    laws = [law for law in case.model.laws("blade") if law.role == "friction"]
    rubs = {name: off for law in laws for name, off in law.off.items() if case.values[name] != off}
    if not rubs or not math.isnan(onset_mm):
        return ""
    without = ", ".join(f"{name} = {off:g}" for name, off in rubs.items())
    return (
        "Friction may hold the surface under the edge, so that it is pressed in and not stretched: a run with"
        f" {without} says whether. Friction that saturates lets an edge enter."
    )


def run_sentence(
    case: Case, outcome: Outcome, measures: Mapping[str, float], band: tuple[float, float] | None = None
) -> str:
    """What a run with these ``measures`` found; ``band``: the least and the largest drop over what the model
    leaves open. One that fell short says where; one that ended within its transition, that it did."""
    if outcome.kind == "failed":
        return str(outcome)
    drop, onset = measures.get("drop_rel", math.nan), measures.get("onset_mm", math.nan)
    window, reached = case.values.get("thickness", math.nan), outcome.reached_mm
    end = "" if outcome.done else f", where it {'stalled' if outcome.kind == 'stalled' else 'was stopped'}"
    if math.isnan(drop):
        return f"not cut {'further ' if case.p.precut else ''}to {reached:.3g} mm{end}"
    bridged = measures.get("front_bridged", 0.0)
    what, known = label(drop, bridged=bridged), reached >= (onset + KNOWN * window) * (1 - 1e-9)
    over = ""
    if band is not None:
        low, high = band
        over = f" ({_percent(low, unit=False)} to {_percent(high)} over what the model leaves open)"
        what = UNDECIDED if label(low) != label(high) else what
    falls = f"does not fall; it is cut from {onset:.3g} mm on"
    if drop or over:
        falls = f"falls by {_percent(drop)}{over} within {window:g} mm at {onset:.3g} mm"
    soon = "" if known or what == ABRUPT else " so far"
    tail = f"; abrupt begins at {_percent(ABRUPT_DROP)}" if what == UNDECIDED else ""
    if what == UNDECIDED and bridged > BRIDGED:
        part = _percent(bridged)
        tail = f"; {part} of the blade has uncut material between cuts, which thinner layers may not have"
    if not known or not outcome.done:
        tail += f"; known to {reached:.3g} mm{end}"
    return f"{what}{soon}: the force {falls}{tail}"


def _percent(part: float, *, unit: bool = True) -> str:
    """In two digits; in three beside the threshold, so that it is seen on which side."""
    digits = 3 if 0 < abs(part - ABRUPT_DROP) < 5e-3 else 2
    return f"{100 * part:.{digits}g}" + " %" * unit
