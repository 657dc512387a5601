"""How a run ended and, where it fell short, what to try."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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
