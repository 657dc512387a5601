"""Run reference problems one after the other; what one of them raises is its verdict, not the end."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cutbench.base.progress import OnProgress, silent
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


def verify(references: Sequence[Reference], *, on_progress: OnProgress = silent) -> Iterator[Verified]:
    """Compute reference problems in turn, and hold the numbers against what is known.

    What a problem raises is its verdict, and does not end the others.

    Parameters
    ----------
    references : sequence of Reference
        The problems, from ``cutbench.references``.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with the seconds that they take on one core, roughly.

    Returns
    -------
    iterator of Verified
        A problem each, as it is computed, with its checks and whether it passed.

    Examples
    --------
    >>> import cutbench
    >>> for found in cutbench.verify([cutbench.references()["objectivity"]]):
    ...     print(found.reference.name, found.passed)
    objectivity True
    """
    total = sum(reference.seconds for reference in references)
    done = 0.0
    for i, reference in enumerate(references):
        on_progress(done, total, f"{reference.name}, {i + 1} of {len(references)}")
        yield _verify(reference)
        done += reference.seconds
    on_progress(total, total, "")


def _verify(reference: Reference) -> Verified:
    began, failure = time.perf_counter(), None
    checks: list[Check] = []
    try:
        # One by one: those before a failure are kept.
        for check in reference.compute():
            checks.append(check)
    except Exception as error:  # a solver that fails on a reference problem is what one wants to be told
        failure = f"{type(error).__name__}: {error}"
    return Verified(reference, tuple(checks), time.perf_counter() - began, failure)
