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
    """Abscissa ``x`` (n,) and duration ``dt`` (n,) in s of the way to each from the one before.

    The first way starts at ``rest``; between two readings the abscissa moves at a constant rate.
    ``pressure_MPa`` (n,) of a sliding test. Of stretches and openings ``x`` may be (n, m) and complex, for m
    answers at once.
    """

    x: np.ndarray
    dt: np.ndarray
    rest: float
    pressure_MPa: np.ndarray

    @classmethod
    def of(cls, experiment: Experiment, at: Averaged) -> LoadingHistory:
        """The history of a test on its grid. Without times every step is slow."""
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
        """From abscissas and times (n,). The clock's zero does not matter: the first reading is reached
        at the rate from there to the next."""
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
        """Speed (n,) in 1/s or mm/s at which each reading was reached; the first as the second where it
        is at rest."""
        rate = np.abs(np.diff(np.append(self.rest, self.x))) / self.dt
        if self.x[0] == self.rest and rate.size > 1:
            rate[0] = rate[1]
        return rate

    def steps(self, largest: float, fewest: int, *, log: bool = False) -> Iterator[tuple[float, float, bool]]:
        """Abscissa, duration and whether a reading is reached, in steps of at most ``largest``.

        ``fewest`` steps to each reading; ``log``: the size is that of the logarithm.
        """
        before = self.rest
        for x, dt in zip(self.x, self.dt, strict=True):
            way = np.abs(np.log(np.real(x / before)) if log else np.real(x - before)).max()
            count = max(fewest, int(np.ceil(way / largest)))
            for i in range(1, count + 1):
                yield before + (x - before) * i / count, dt / count, i == count
            before = x
