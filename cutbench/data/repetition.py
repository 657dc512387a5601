"""The readings of one specimen, the average of several, and how their history runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.case.motion import corners

if TYPE_CHECKING:
    from cutbench.data.contact import Contact

#: A step back of more than this part of the range is no jitter but a return.
JITTER = 0.005
#: Specimens of one test go at speeds within this factor.
SAME_SPEED = 1.5


@dataclass(frozen=True)
class Channel:
    """A column as it was recorded, for messages alone: its ``title``, the ``unit`` and the ``factor`` that
    somebody wrote (None: nobody did), and how much of it one of the abscissa or the ordinate is."""

    title: str
    unit: str | None = None
    factor: float | None = None
    scale: float = 1.0

    @property
    def recorded(self) -> float:
        """What one of the abscissa or the ordinate is in the file's column."""
        return self.scale / (self.factor or 1.0)


@dataclass(frozen=True, eq=False)
class Repetition:
    """A repetition holds the readings of one specimen.

    Abscissa and ordinate are those of the experiment's kind (see ``Experiment``).

    Attributes
    ----------
    x : ndarray, shape (n,)
        Abscissa, in mm or 1.
    y : ndarray, shape (n,)
        Ordinate, in N or MPa.
    time_s : ndarray, shape (n,), s, or None
        Times of the readings; None where they are not known.
    name : str
        What the specimen is called.
    pressure_MPa : ndarray, shape (n,), MPa, or None
        Contact pressure of a sliding test where it was measured.
    file : str, tuple of str or None
        The file of the readings, one for all or one for each, for messages alone.
    lines : ndarray of int, shape (n,), or None
        Where in the file each reading stands, for messages alone.
    contact : Contact or None
        Where the machine met the specimen, in recorded values, where that was asked for.
    channels : mapping of str to Channel
        The columns by role, as they were recorded, for messages alone.
    """

    x: np.ndarray
    y: np.ndarray
    time_s: np.ndarray | None = None
    name: str = "1"
    pressure_MPa: np.ndarray | None = None
    file: str | tuple[str, ...] | None = None
    lines: np.ndarray | None = None
    contact: Contact | None = None
    channels: Mapping[str, Channel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key in ("x", "y", "time_s", "pressure_MPa", "lines"):
            values = getattr(self, key)
            if values is not None:
                values = np.array(values, dtype=int if key == "lines" else float)
                values.flags.writeable = False
                object.__setattr__(self, key, values)

    @property
    def speed(self) -> float:
        """The mean speed of what moves (mm/s, or 1/s of stretch), nan where times are not known."""
        if self.time_s is None or not np.diff(self.time_s).min(initial=0.0) >= 0 < self.x.size - 1:
            return math.nan
        steps = np.abs(np.diff(self.x))
        moving = steps > 0.1 * steps.mean()
        return float(steps[moving].sum() / np.diff(self.time_s)[moving].sum())

    @property
    def duration_s(self) -> float:
        """The time in s from the first reading to the last; nan where times are not known."""
        return math.nan if self.time_s is None else float(self.time_s[-1] - self.time_s[0])

    def wrong(self, key: str, value: object, expected: str, at: int | None = None) -> BadInput:
        """Make the error about one reading, or about all of them, with its place in the file."""
        line = None if at is None or self.lines is None else int(self.lines[at])
        place = "" if self.name == "1" else f" in repetition '{self.name}'"
        if at is not None and line is None:
            place += f", reading {at + 1}"
        file = self.file[at or 0] if isinstance(self.file, tuple) else self.file
        return BadInput(file=file, line=line, key=key + place, value=value, expected=expected)


@dataclass(frozen=True, eq=False)
class Averaged:
    """An averaged test has its repetitions on one grid of n values.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Abscissa, in mm or 1.
    mean : ndarray, shape (n,)
        Mean ordinate, in N or MPa.
    scatter : ndarray, shape (n,)
        Standard deviation between specimens, in the unit of the mean.
    reading : ndarray, shape (n,)
        Standard deviation of one repetition's reading noise on the grid, in the same unit.
    curves : ndarray, shape (R, n)
        The ordinates of the R repetitions.
    time_s : ndarray, shape (n,), s, or None
        Times; None where they are not known.
    pressure_MPa : ndarray, shape (n,), MPa, or None
        Contact pressure of a sliding test where it was measured.
    independent : bool
        Whether the values are of no curve but measures, each known by itself.
    """

    x: np.ndarray
    mean: np.ndarray
    scatter: np.ndarray
    reading: np.ndarray
    curves: np.ndarray
    time_s: np.ndarray | None = None
    pressure_MPa: np.ndarray | None = None
    independent: bool = False

    @property
    def estimated(self) -> bool:
        """Whether there was nothing to repeat.

        The noise is then taken from the roughness of one curve, and nothing is known of the scatter.
        """
        return self.repetitions == 1 and not self.independent

    @property
    def repetitions(self) -> int:
        """The number of repetitions."""
        return self.curves.shape[0]

    @property
    def dof(self) -> int:
        """Degrees of freedom of the scatter: repetitions less one."""
        return self.repetitions - 1

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation (n,) of the mean."""
        return np.sqrt((self.scatter**2 + self.reading**2) / self.repetitions)

    @property
    def factors(self) -> np.ndarray:
        """The slopes (R,) of the repetitions' least-squares lines on the mean, 1 on average."""
        return self.curves @ self.mean / (self.mean @ self.mean)

    @property
    def course(self) -> np.ndarray:
        """How far the test has come (n,), from 0 to 1: half by the way, half by ``along``."""
        way = np.append(0.0, np.cumsum(np.abs(np.diff(self.x))))
        along = self.along - self.along[0]
        return (way / way[-1] + along / along[-1]) / 2

    @property
    def along(self) -> np.ndarray:
        """The coordinate (n,) along which the curve is smooth.

        It is x if that only grows, else the time, else the path.
        """
        if np.all(np.diff(self.x) > 0):
            return self.x
        if self.time_s is not None:
            return self.time_s
        return np.append(0.0, np.cumsum(np.abs(np.diff(self.x)) + 1e-9 * np.ptp(self.x)))


def note_on_single_repetition(id: str) -> str:
    """What to know of a test in which nothing was repeated."""
    return (
        f"'{id}' has one repetition: its noise is estimated from the roughness of the curve, and its scatter"
        " between specimens is not known"
    )


def averaging_matrix(s: np.ndarray, grid: np.ndarray, sharp: np.ndarray | None = None) -> np.ndarray:
    """Matrix A (m, n) that brings readings at ``s`` (n,), ascending, to ``grid`` (m,), ascending.

    A local line through the readings between the midpoints to the neighbouring grid values, where
    four or more lie there on both sides; else, and where ``sharp`` (m,) is true (a turning point),
    linear interpolation.
    """
    A = np.zeros((grid.size, s.size))
    edges = np.concatenate([grid[:1], (grid[1:] + grid[:-1]) / 2, grid[-1:]])
    first = np.searchsorted(s, edges[:-1], side="left")
    last = np.searchsorted(s, edges[1:], side="right")
    for i, g in enumerate(grid):
        near = slice(first[i], last[i])
        x = s[near]
        if x.size >= 4 and x[0] <= g <= x[-1] and not (sharp is not None and sharp[i]):
            spread = ((x - x.mean()) ** 2).sum()
            if spread > 0:
                A[i, near] = 1 / x.size + (g - x.mean()) * (x - x.mean()) / spread
                continue
        j = int(np.clip(np.searchsorted(s, g), 1, s.size - 1))
        width = s[j] - s[j - 1]
        part = float(np.clip((g - s[j - 1]) / width, 0, 1)) if width > 0 else 1.0
        A[i, j - 1], A[i, j] = 1 - part, part
    return A


def turning_points(x: np.ndarray, part: float = 0.02) -> np.ndarray:
    """Indices where ``x`` (n,) turns or comes to rest, against a threshold of ``part`` of its range."""
    return np.array(corners(np.arange(float(x.size)), x, part * np.ptp(x)), dtype=int)


def ascending_order(r: Repetition) -> np.ndarray:
    return np.argsort(r.x if r.x[-1] > r.x[0] else -r.x, kind="stable")


def by_speed(repetitions: Sequence[Repetition]) -> list[list[Repetition]]:
    """The repetitions in groups whose speeds, by their times, follow one another within ``SAME_SPEED``."""
    order = sorted(repetitions, key=attrgetter("speed"))
    groups = [order[:1]]
    for before, r in pairwise(order):
        if r.speed > SAME_SPEED * before.speed:
            groups.append([])
        groups[-1].append(r)
    return [[r for r in repetitions if r in group] for group in groups]


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
