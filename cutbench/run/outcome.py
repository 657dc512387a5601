"""How a run ended and, where it fell short, what to try."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

#: How a run can end; only ``"done"`` reached what was asked for, its depth or its transition.
OUTCOMES: Final = ("done", "stalled", "interrupted", "failed")


@dataclass(frozen=True)
class Outcome:
    """How a run ended and, where it fell short, what to try."""

    kind: str
    message: str
    advice: str = ""
    reached_mm: float = 0.0

    def __post_init__(self):
        if self.kind not in OUTCOMES:
            raise ValueError(f"outcome '{self.kind}' is none of {', '.join(OUTCOMES)}")

    @property
    def done(self) -> bool:
        return self.kind == "done"

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}" + (f" {self.advice}" if self.advice else "")
