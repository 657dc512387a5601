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


def close(a, b, rtol: float, atol: float = 0.0) -> None:
    """Equality relative to the largest entry: components that vanish have no relative error."""
    scale = max(float(np.max(np.abs(a), initial=0)), float(np.max(np.abs(b), initial=0)))
    np.testing.assert_allclose(a, b, rtol=0, atol=rtol * scale + atol)
