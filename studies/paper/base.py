"""What a claim is: the runs it needs, what is read from them, when that agrees with what was published."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from cutbench.run.result import Result

#: Runs of a claim by the names its ``asks`` give them.
Runs = Mapping[str, Result]

#: The two sets of numerical choices that every claim is held against.
PAPER, CONVERGED = "paper", "converged"
NUMERICS = (PAPER, CONVERGED)

#: A length or a force agrees when it is within this part of what was published.
NEAR = 0.15
#: The same for a largest pressure or stress at a point, which the size of elements moves most.
NEAR_PEAK = 0.3

#: Kinds of test that a claim can ask for.
CUT, TENSION, BLOCK, NOTCHED = "cut", "tension", "block", "notched"
#: Length of the notch of a notched strip, mm.
NOTCH_MM = 2.4


@dataclass(frozen=True)
class Ask:
    """A run that a claim needs: a material, what is changed of it, how far the blade goes.

    ``numerics`` fixes the numerical choices whatever the claim is held against. A ``test`` of kind
    ``"block"`` cuts a block in three dimensions instead of a section; ``"tension"`` pulls a whole strip to
    ``depth_mm``, ``"notched"`` one with a notch until it is torn.
    """

    material: str
    changes: Mapping[str, object] = field(default_factory=dict)
    depth_mm: float = 14.0
    numerics: str | None = None
    test: str = CUT


@dataclass(frozen=True)
class Finding:
    """One statement of a claim under one set of numerical choices.

    ``published`` is the statement's number as a person reads it, ``value`` what the runs say in ``unit``,
    ``holds`` whether they agree; None where the runs do not tell. ``solid``: of runs in three dimensions, for
    which no single change is tried.
    """

    what: str
    unit: str
    published: str
    value: float
    holds: bool | None
    solid: bool = False

    @property
    def text(self) -> str:
        """The value with its unit."""
        if not math.isfinite(self.value):
            return "none"
        return f"{self.value:.3g}" + ("" if self.unit == "1" else f" {self.unit}")


@dataclass(frozen=True)
class Claim:
    """``text`` is what was published; ``read`` makes findings of the runs, always the same ones in the same
    order. ``beyond`` says what only three dimensions can tell. ``note`` is what there is to know besides.
    ``dissect``: change one thing at a time in any case, not only where something differs or fails;
    ``changes`` are those to try, all unless given.
    """

    id: str
    text: str
    asks: Mapping[str, Ask] = field(default_factory=dict)
    read: Callable[[Runs], tuple[Finding, ...]] = lambda runs: ()
    beyond: str = ""
    note: str = ""
    dissect: bool = False
    changes: tuple[str, ...] | None = None


def near(value: float, low: float, high: float | None = None, *, within: float = NEAR) -> bool | None:
    """Whether ``value`` lies between ``low`` and ``high`` (``low`` alone: at it), widened by ``within``."""
    high = low if high is None else high
    if not math.isfinite(value):
        return None
    return low * (1 - within) <= value <= high * (1 + within)


def below(value: float, limit: float) -> bool | None:
    """Whether ``value`` is less than ``limit``; None for nan."""
    return None if math.isnan(value) else bool(value < limit)


def at_least(value: float, limit: float) -> bool | None:
    """Whether ``value`` is ``limit`` or more; None for nan."""
    return None if math.isnan(value) else bool(value >= limit)
