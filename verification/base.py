"""What a reference problem is, a claim, its source, and one function that computes what the product says; and
how problems are run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from cutbench.base.progress import OnProgress, silent


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
    ``python -m verification --quick`` has it.
    """

    name: str
    title: str
    source: str
    compute: Callable[[], Iterable[Check]]
    laws: tuple[str, ...] = ()
    quick: bool = True
    seconds: float = 1.0


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
        The problems, from ``references``.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with the seconds that they take on one core, roughly.

    Returns
    -------
    iterator of Verified
        A problem each, as it is computed, with its checks and whether it passed.

    Examples
    --------
    >>> from verification import references, verify
    >>> for found in verify([references()["objectivity"]]):
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
