"""The readings of one specimen, the average of several, and how their history runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutbench.base.errors import BadInput

#: A step back of more than this part of the range is no jitter but a return.
JITTER = 0.005


@dataclass(frozen=True, eq=False)
class Repetition:
    """The readings of one specimen: ``x``, ``y`` (n,) as the module says, ``time_s`` (n,) or None.

    ``pressure_MPa`` (n,): contact pressure of a sliding test where it was measured. ``lines`` (n,)
    and ``file`` say where each reading stands; they are for messages alone.
    """

    x: np.ndarray
    y: np.ndarray
    time_s: np.ndarray | None = None
    name: str = "1"
    pressure_MPa: np.ndarray | None = None
    file: str | None = None
    lines: np.ndarray | None = None

    def __post_init__(self) -> None:
        for key in ("x", "y", "time_s", "pressure_MPa", "lines"):
            values = getattr(self, key)
            if values is not None:
                values = np.array(values, dtype=int if key == "lines" else float)
                values.flags.writeable = False
                object.__setattr__(self, key, values)

    @property
    def duration_s(self) -> float:
        """From the first reading to the last; nan where times are not known."""
        return math.nan if self.time_s is None else float(self.time_s[-1] - self.time_s[0])

    def wrong(self, key: str, value: object, expected: str, at: int | None = None) -> BadInput:
        """The error about reading ``at`` (or all of them), where it stands in the file."""
        line = None if at is None or self.lines is None else int(self.lines[at])
        place = "" if self.name == "1" else f" in repetition '{self.name}'"
        if at is not None and line is None:
            place += f", reading {at + 1}"
        return BadInput(file=self.file, line=line, key=key + place, value=value, expected=expected)


@dataclass(frozen=True, eq=False)
class Averaged:
    """The repetitions of a test on one grid of n values.

    ``x`` (n,) abscissa and ``time_s`` (n,) or None; ``pressure_MPa`` (n,) or None; ``mean`` (n,) of the
    ordinate; ``scatter`` (n,) and ``reading`` (n,): standard deviations between specimens and of one
    repetition's reading noise on the grid; ``covariance`` (n, n) of the mean; ``curves`` (R, n) the
    repetitions. ``estimated`` is true where there was nothing to repeat: the noise is then taken from
    the roughness of one curve, and nothing is known of the scatter; ``note`` says so in words.
    """

    x: np.ndarray
    mean: np.ndarray
    scatter: np.ndarray
    reading: np.ndarray
    covariance: np.ndarray
    curves: np.ndarray
    time_s: np.ndarray | None = None
    pressure_MPa: np.ndarray | None = None
    estimated: bool = False
    note: str = ""

    @property
    def repetitions(self) -> int:
        return self.curves.shape[0]

    @property
    def dof(self) -> int:
        """Degrees of freedom of the scatter: repetitions less one."""
        return self.repetitions - 1

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation (n,) of the mean."""
        return np.sqrt(np.diag(self.covariance))


def turning_points(x: np.ndarray, part: float = 0.02) -> np.ndarray:
    """Indices where ``x`` (n,) turns or comes to rest, against a threshold of ``part`` of its range."""
    limit = part * np.ptp(x)
    kept, open_ = [], [(0, x.size - 1)]
    # The farthest point from each chord (Ramer, Douglas & Peucker), on x over the reading's number.
    while open_:
        a, b = open_.pop()
        if b - a < 2:
            continue
        chord = np.linspace(x[a], x[b], b - a + 1)
        off = np.abs(x[a : b + 1] - chord)
        k = int(off.argmax())
        if off[k] > limit:
            kept.append(a + k)
            open_ += [(a, a + k), (a + k, b)]
    return np.array(sorted(kept), dtype=int)


def order(r: Repetition) -> np.ndarray:
    return np.argsort(r.x if r.x[-1] > r.x[0] else -r.x, kind="stable")


def first_return(x: np.ndarray) -> int | None:
    """First reading that lies behind the farthest before it by more than jitter."""
    back = np.flatnonzero(np.maximum.accumulate(x) - x > JITTER * np.ptp(x))
    return int(back[0]) if back.size else None


def is_monotone(r: Repetition) -> bool:
    x = r.x if r.x[-1] > r.x[0] else -r.x
    if first_return(x) is not None:
        return False
    if r.time_s is None:
        return True
    # A hold: in one of twenty equal times the way is less than a twentieth of the mean.
    at = np.interp(np.linspace(r.time_s[0], r.time_s[-1], 21), r.time_s, x)
    return bool(np.diff(at).min() > 0.05 * np.ptp(x) / 20)
