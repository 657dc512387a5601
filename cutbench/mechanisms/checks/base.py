"""What a check is, and the list of them, which the files beside this one fill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutbench.mechanisms.checks.trial import Trial


@dataclass(frozen=True)
class Check:
    """One requirement on the laws of a slot (any, where it is empty) that it ``applies`` to; ``run`` raises
    AssertionError, or NotTested."""

    name: str
    says: str
    slot: str
    applies: Callable[[Any], bool]
    run: Callable[[Trial], None]


class NotTested(Exception):
    """A law does not tell what a check needs to know; the text says what."""


CHECKS: list[Check] = []

#: Relative difference of what is the same but for the order of operations, which rounds otherwise by some
#: 1e-15; an effect that stays on where it should be off is felt far above.
ROUNDING = 1e-12


def check(
    slot: str = "", applies: Callable[[Any], bool] = lambda law: True
) -> Callable[[Callable], Callable]:
    """Put a function into the list; its docstring says what it requires."""

    def add(run: Callable[[Trial], None]) -> Callable:
        CHECKS.append(Check(run.__name__, (run.__doc__ or "").strip().rstrip("."), slot, applies, run))
        return run

    return add


def close(a, b, rtol: float, atol: float = 0.0, *, what: str = "two numbers") -> None:
    """Equality relative to the largest entry: components that vanish have no relative error.

    Raises AssertionError, which says ``what`` should be equal to what, and by how much it is not.
    """
    a, b = np.broadcast_arrays(np.asarray(a), np.asarray(b))
    assert np.isfinite(a).all() and np.isfinite(b).all(), f"{what}: some are not finite"
    scale = float(max(np.max(np.abs(a), initial=0), np.max(np.abs(b), initial=0)))
    off, allowed = float(np.max(np.abs(a - b), initial=0)), rtol * scale + atol
    assert off <= allowed, (
        f"{what}: they differ by {off:.2g}, of {scale:.2g} at the most; {allowed:.1g} is allowed"
    )
