"""What a check is, and the list of them, which the files beside this one fill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cutbench.mechanisms.checks.trial import Trial


@dataclass(frozen=True)
class Check:
    """One requirement on the laws of a slot (any, where it is empty); ``run`` raises AssertionError."""

    name: str
    says: str
    slot: str
    run: Callable[[Trial], None]


CHECKS: list[Check] = []


def check(slot: str = "") -> Callable[[Callable], Callable]:
    """Put a function into the list; its docstring says what it requires."""

    def add(run: Callable[[Trial], None]) -> Callable:
        CHECKS.append(Check(run.__name__, (run.__doc__ or "").strip().rstrip("."), slot, run))
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
