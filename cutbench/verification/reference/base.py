"""What a reference problem is: a claim, its source, and one function that computes what the product says."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One number against its reference.

    ``tolerance`` is relative to the reference, or absolute in ``unit`` where the reference is 0. ``source``
    says where the reference comes from if not from where its problem's do.
    """

    what: str
    unit: str
    reference: float
    obtained: float
    tolerance: float
    source: str = ""

    @property
    def error(self) -> float:
        """Relative error, signed; absolute where the reference is 0."""
        difference = float(self.obtained - self.reference)
        return difference / abs(self.reference) if self.reference else difference

    @property
    def passed(self) -> bool:
        return bool(math.isfinite(self.error) and abs(self.error) <= self.tolerance)


@dataclass(frozen=True)
class Reference:
    """A reference problem. ``compute`` returns its checks, obtained through the product's own forms and laws.

    ``laws``: registered mechanisms whose flux the numbers depend on, so that a wrong one must show.
    ``seconds``: what it takes on one core, roughly, for the progress shown. ``quick``: whether
    ``cutbench verify --quick`` has it.
    """

    name: str
    title: str
    source: str
    compute: Callable[[], Iterable[Check]]
    laws: tuple[str, ...] = ()
    quick: bool = True
    seconds: float = 1.0
