"""The one way in which a long computation says how far it is; what to make of it is the caller's matter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

#: Said while a run waits for machine code that this machine does not have yet.
COMPILING = "compiling, once on this machine"


class OnProgress(Protocol):
    """Called with what is ``done`` of a ``total`` (mm of travel, runs, problems; nan where it is not known
    beforehand) and a short ``text`` on how it stands: a force, a stage, what failed.

    It is called at the beginning, after each part and at the end, in the process that asked. A
    KeyboardInterrupt that it raises ends the computation as Ctrl-C does.
    """

    def __call__(self, done: float, total: float, text: str) -> None: ...


def silent(done: float, total: float, text: str) -> None:
    """Says nothing."""


def at_most(seconds: float, on_progress: OnProgress) -> OnProgress:
    """``on_progress`` that ends the computation, as Ctrl-C does, so many seconds from now."""
    check = Until(time.monotonic() + seconds)

    def stopping(done: float, total: float, text: str) -> None:
        on_progress(done, total, text)
        if not done >= total:
            check()

    return stopping


@dataclass(frozen=True)
class Until:
    """What raises KeyboardInterrupt from the time ``due`` (``time.monotonic``) on."""

    due: float

    def __call__(self) -> None:
        if time.monotonic() >= self.due:
            raise KeyboardInterrupt


#: That there is no end.
ALWAYS = Until(math.inf)


@dataclass(frozen=True)
class Pace:
    """How much ``effort``, in any unit, what is done has taken, and what all of it is ``expected_s`` to take
    (nan: not known)."""

    effort: Callable[[float], float] = float
    expected_s: float = math.nan


class Clock:
    """The time left, by what was done since the first call: what was there before took no time, and what was
    compiled meanwhile is not compiled again. What was expected counts as if so much had been done."""

    #: Part of the whole.
    WEIGHT = 0.05

    def __init__(self, pace: Pace | None = None) -> None:
        self._pace = pace or Pace()
        self._first: tuple[float, float] | None = None

    def left(self, done: float, total: float, text: str = "") -> str:
        """As a person says it; empty where it is not known."""
        now = time.monotonic()
        if text == COMPILING:
            self._first = None
            return ""
        if not math.isfinite(done + total):
            return ""
        if self._first is None or done < self._first[1]:  # another part has begun
            self._first = now, done
        since, before = self._first
        effort, expected = self._pace.effort, self._pace.expected_s
        spent, gone, whole = now - since, effort(done) - effort(before), effort(total)
        if math.isfinite(expected):
            spent, gone = spent + self.WEIGHT * expected, gone + self.WEIGHT * whole
        if gone <= 0:
            return ""
        return duration(spent / gone * max(whole - effort(done), 0.0))


def count(done: float, total: float, unit: str) -> str:
    """``0.42 of 18.2 mm``; empty where the total is not known."""
    if not math.isfinite(total):
        return ""
    number = f"{done:g}" if done == int(done) else f"{done:.2f}"
    return f"{number} of {round(total, 2):g} {unit}".rstrip()


def line(title: str, done: float, total: float, unit: str, text: str, left: str) -> str:
    """``gelatin: 0.42 of 18.2 mm, 0.11 N, 12 s left``."""
    parts = [count(done, total, unit), text, left and f"{left} left"]
    return f"{title}: {', '.join(filter(None, parts))}"


def duration(seconds: float) -> str:
    """As a person says it."""
    seconds = round(seconds)
    if seconds < 60:
        return f"{seconds} s"
    if seconds < 3600:
        return f"{seconds // 60} min {seconds % 60:02d} s"
    return f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"
