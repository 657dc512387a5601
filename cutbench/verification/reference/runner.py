"""Run reference problems one after the other; what one of them raises is its verdict, not the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cutbench.verification.reference.base import Check, Reference


@dataclass(frozen=True)
class Verified:
    """A reference problem and what came of it; ``failure`` says what stopped it, where something did."""

    reference: Reference
    checks: tuple[Check, ...]
    seconds: float
    failure: str | None = None

    @property
    def passed(self) -> bool:
        return self.failure is None and bool(self.checks) and all(check.passed for check in self.checks)


def verify(
    references: Iterable[Reference],
    *,
    on_start: Callable[[Reference], None] = lambda reference: None,
    on_done: Callable[[Verified], None] = lambda verified: None,
) -> None:
    """Compute the problems in turn and hand each to ``on_done``. KeyboardInterrupt passes through."""
    for reference in references:
        on_start(reference)
        on_done(_verify(reference))


def _verify(reference: Reference) -> Verified:
    began = time.perf_counter()
    checks: list[Check] = []
    failure = None
    try:
        for check in reference.compute():
            checks.append(check)
    except Exception as error:  # a solver that fails on a reference problem is what one wants to be told
        failure = f"{type(error).__name__}: {error}"
    return Verified(reference, tuple(checks), time.perf_counter() - began, failure)
