"""What was done to a specimen: abscissa and time of each reading, from rest on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Averaged

#: Duration of a step where nothing is known of time, s: so slow that every rate is zero.
SLOW = 1e9


@dataclass(frozen=True)
class LoadingHistory:
    """A loading history says how a test moves from reading to reading, and how long each way takes.

    The first way starts at ``rest``; between two readings the abscissa moves at a constant rate.

    Attributes
    ----------
    x : ndarray, shape (n,) or (n, m)
        Abscissa at each of n readings: stretch (1), slip or opening (mm). Of stretches and openings it may be
        (n, m) and complex, for m answers at once.
    dt : ndarray, shape (n,), s
        Duration of the way to each reading from the one before.
    rest : float
        The abscissa of the undeformed specimen.
    pressure_MPa : ndarray, shape (n,), MPa
        Contact pressure of a sliding test.
    """

    x: np.ndarray
    dt: np.ndarray
    rest: float
    pressure_MPa: np.ndarray

    @classmethod
    def of(cls, experiment: Experiment, at: Averaged) -> LoadingHistory:
        """Make the history of a test on its grid.

        Without times every step is slow.
        """
        pressure = experiment.pressure_MPa if at.pressure_MPa is None else at.pressure_MPa
        return cls.along(at.x, at.time_s, experiment.rest, pressure)

    @classmethod
    def along(
        cls,
        x: np.ndarray,
        time_s: np.ndarray | None = None,
        rest: float = 0.0,
        pressure_MPa: float | np.ndarray = 0.0,
    ) -> LoadingHistory:
        """Make a history from abscissas and times.

        The clock's zero does not matter: the first reading is reached at the rate from there to the next.
        With ``x`` (n,), ``time_s`` (n,), ``pressure_MPa`` (n,).
        """
        x = np.asarray(x, dtype=float)
        pressure = np.broadcast_to(np.asarray(pressure_MPa, dtype=float), x.shape)
        if time_s is None:
            return cls(x, np.full(x.size, SLOW), rest, pressure)
        dt = np.diff(time_s)
        rate = np.abs(np.diff(x)) / dt
        first = next((r for r in rate if r > 0), 0.0)
        start = abs(x[0] - rest) / first if first > 0 else 0.0
        # At rest from the beginning on: nothing happens on the way there, however long.
        return cls(x, np.append(start if start > 0 else dt[0], dt), rest, pressure)

    @property
    def rate(self) -> np.ndarray:
        """The speed (n,) in 1/s or mm/s at which each reading was reached.

        The first is as the second where it is at rest.
        """
        rate = np.abs(np.diff(np.append(self.rest, self.x))) / self.dt
        if self.x[0] == self.rest and rate.size > 1:
            rate[0] = rate[1]
        return rate

    def steps(self, largest: float, fewest: int, *, log: bool = False) -> Iterator[tuple[float, float, bool]]:
        """Divide the history into steps that are short enough to integrate over."""
        before = self.rest
        for x, dt in zip(self.x, self.dt, strict=True):
            way = np.abs(np.log(np.real(x / before)) if log else np.real(x - before)).max()
            count = max(fewest, int(np.ceil(way / largest)))
            for i in range(1, count + 1):
                yield before + (x - before) * i / count, dt / count, i == count
            before = x
