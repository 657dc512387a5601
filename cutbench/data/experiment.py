"""One measured test: what was done, its repetitions, and what they say on a common grid.

Inside, every kind has one abscissa ``x`` and one ordinate ``y``: blade travel (mm) and force (N) for
``cut``; stretch (1) and nominal stress (MPa) for ``uniaxial``, ``equibiaxial`` and ``pure_shear``; slip
or opening (mm) and traction (MPa) for ``sliding`` and ``separation``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from cutbench.base.errors import require
from cutbench.base.toml import among, written
from cutbench.data import plausible
from cutbench.data.covariance import roughness, sawtooth_variance, scatter_covariance
from cutbench.data.fields import Field
from cutbench.data.repetition import (
    Averaged,
    Repetition,
    ascending_order,
    averaging_matrix,
    first_return,
    is_monotone,
    turning_points,
)

HOMOGENEOUS = ("uniaxial", "equibiaxial", "pure_shear")
KINDS = ("cut", *HOMOGENEOUS, "sliding", "separation")
ROLES = ("train", "test")
#: Slots of mechanisms that a kind of test sees.
SLOTS = {
    "cut": ("bulk", "cut", "blade", "skin", "support", "rig"),
    **dict.fromkeys(HOMOGENEOUS, ("bulk", "rig")),
    "sliding": ("blade",),
    "separation": ("cut", "rig"),
}
#: Fewest readings of a repetition.
FEWEST = 5


def area_of(kind: str, specimen: Mapping[str, float]) -> float | None:
    """Area over which the force acts, mm²; where it is not written, that of the ``diameter``, or the product
    of two sides."""
    sides = ("width", "thickness") if kind in HOMOGENEOUS else ("width", "length")
    if "area" in specimen:
        return specimen["area"]
    if "diameter" in specimen:
        return math.pi / 4 * specimen["diameter"] ** 2
    return specimen[sides[0]] * specimen[sides[1]] if all(s in specimen for s in sides) else None


@dataclass(frozen=True, eq=False)
class Experiment:
    """An experiment is a measured test of one kind with its repetitions, in internal units (mm, N, s, MPa).

    Every kind has one abscissa x and one ordinate y: blade travel (mm) and force (N) for ``cut``; stretch (1)
    and nominal stress (MPa) for ``uniaxial``, ``equibiaxial`` and ``pure_shear``; slip or opening (mm) and
    traction (MPa) for ``sliding`` and ``separation``.

    Attributes
    ----------
    id : str
        What it is called.
    kind : str
        One of those above.
    repetitions : tuple of Repetition
        The readings of each specimen.
    role : str
        ``train``: it is fitted. ``test``: it is never fitted, only predicted.
    specimen : mapping of str to float
        Sizes in mm (``width``, ``length``, ``height``) and ``area`` in mm².
    blade : mapping of str to float
        Sizes in mm (``thickness``, ``tip``).
    speed : float or None
        In mm/s, or 1/s of stretch; None where it is not known.
    pressure_MPa : float, MPa
        Contact pressure of a sliding test.
    direction : str
        ``opening`` or ``sliding`` of a separation test.
    notes : tuple of str
        What was assumed.
    fields : tuple of Field
        Displacements on one specimen of a cut.
    field_noise_mm : float, mm
        To how much these are known.
    angle : float, rad
        Of its axis, along which it is pulled or pressed, or across the cut plane, to the direction in the
        body from which ``fibre_angle`` counts.
    slice_push : float or None
        Speed of a cut's blade along its edge over its speed down; None: that of the material.

    Raises
    ------
    BadInput
        For what no test can be.
    """

    id: str
    kind: str
    repetitions: tuple[Repetition, ...]
    role: str = "train"
    specimen: Mapping[str, float] = field(default_factory=dict)
    blade: Mapping[str, float] = field(default_factory=dict)
    speed: float | None = None
    pressure_MPa: float = 0.0
    direction: str = "opening"
    notes: tuple[str, ...] = ()
    fields: tuple[Field, ...] = ()
    field_noise_mm: float = 0.0
    angle: float = 0.0
    slice_push: float | None = None
    #: Whether its readings are those of a curve.
    curve: ClassVar[bool] = True

    def __post_init__(self) -> None:
        written("id", self.id, "a name, such as 'slow'")
        for key, known in (("kind", KINDS), ("role", ROLES), ("direction", ("opening", "sliding"))):
            among(key, getattr(self, key), known)
        moves = self.speed is None or (np.isfinite(self.speed) and self.speed > 0)
        require(moves, "speed", self.speed, "a speed above 0, such as '0.02 mm/s'")
        turned = abs(self.angle) <= math.pi * (1 + 1e-9)
        require(turned, "angle", self.angle, "an angle in rad, of half a turn either way at most")
        for key in ("specimen", "blade"):
            object.__setattr__(self, key, MappingProxyType(dict(getattr(self, key))))
        object.__setattr__(self, "repetitions", tuple(self.repetitions))
        require(self.repetitions, "data", f"no reading in '{self.id}'", "one repetition or more")
        for r in self.repetitions:
            for fault in self._faults(r):
                raise r.wrong(*fault)
        paced = self.kind != "cut" or self.speed is not None or self.timed
        expected = "the blade's speed, such as speed = '0.021 mm/s', or a time column"
        require(paced, "speed", None, expected)
        alike = len({r.time_s is None for r in self.repetitions}) == 1
        require(alike, "time", "in some repetitions only", "a time in all or in none")
        self._common_range()
        for travel in (pictured.travel_mm for pictured in self.fields):
            expected = f"blade travels above 0 that the readings reach, {self.reach:g} mm"
            require(0 < travel <= self.reach + 1e-9, "fields.travel", f"{travel:g} mm", expected)

    def __reduce__(self):
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        # A MappingProxyType has no pickle.
        return partial(type(self), **values | {key: dict(values[key]) for key in ("specimen", "blade")}), ()

    # -- what it is ------------------------------------------------------------------------------
    @property
    def x_name(self) -> str:
        """``displacement``, ``stretch``, ``slip`` or ``opening``."""
        names = {"cut": "displacement", "sliding": "slip", "separation": "opening"}
        return names.get(self.kind, "stretch")

    @property
    def y_name(self) -> str:
        """``force``, ``stress`` or ``traction``."""
        return "force" if self.kind == "cut" else "stress" if self.kind in HOMOGENEOUS else "traction"

    @property
    def x_unit(self) -> str:
        """The unit of the abscissa, ``mm`` or ``1``."""
        return "1" if self.kind in HOMOGENEOUS else "mm"

    @property
    def y_unit(self) -> str:
        """The unit of the ordinate, ``N`` or ``MPa``."""
        return "N" if self.kind == "cut" else "MPa"

    @property
    def shown(self) -> tuple[float, str]:
        """The factor and the unit with which people read the ordinate."""
        return {"MPa": (1e3, "kPa")}.get(self.y_unit, (1.0, self.y_unit))

    @property
    def rest(self) -> float:
        """The abscissa of the undeformed specimen: stretch 1, or 0 mm."""
        return 1.0 if self.kind in HOMOGENEOUS else 0.0

    @property
    def area_mm2(self) -> float | None:
        """The area in mm² over which the force acts, None where it is not known."""
        return area_of(self.kind, self.specimen)

    @property
    def mounted(self) -> bool:
        """Whether it is known what the testing machine moved and felt, in mm and N."""
        if self.kind in HOMOGENEOUS and "length" not in self.specimen:
            return False
        return self.kind == "cut" or self.area_mm2 is not None

    @property
    def timed(self) -> bool:
        """Whether the times of the readings are known, measured or by the speed."""
        return self.repetitions[0].time_s is not None

    @cached_property
    def monotone(self) -> bool:
        """Whether the abscissa only grows (or only falls) and never rests: no hold, return or cycle."""
        return all(is_monotone(r) for r in self.repetitions)

    @property
    def reach(self) -> float:
        """The largest abscissa of all repetitions."""
        return max(float(r.x.max()) for r in self.repetitions)

    @property
    def readings(self) -> int:
        """The number of readings of all repetitions."""
        return sum(r.x.size for r in self.repetitions)

    @property
    def travel_speed(self) -> float:
        """The mean speed of what moves (mm/s, or 1/s of stretch), nan where it is not known.

        It comes from the time where there is one.
        """
        if not self.timed:
            return math.nan if self.speed is None else self.speed
        return float(np.mean([r.speed for r in self.repetitions]))

    # -- checks ----------------------------------------------------------------------------------
    def _faults(self, r: Repetition) -> Iterator[tuple[str, str, str, int | None]]:
        """What is wrong: the key, its value, what would be right, and the reading where it shows."""
        arrays = {self.x_name: r.x, self.y_name: r.y, "time": r.time_s, "pressure": r.pressure_MPa}
        for key, values in ((key, values) for key, values in arrays.items() if values is not None):
            if values.shape != r.x.shape or values.ndim != 1:
                many = f"as many as of {self.x_name}, which has {r.x.size}"
                yield key, f"{values.size} readings", many, None
            for i in np.flatnonzero(~np.isfinite(values))[:1]:
                yield key, f"{values[i]}", "a number in every reading", i
        if r.x.size < FEWEST:
            yield "readings", f"{r.x.size}", f"{FEWEST} readings or more", None if r.x.size == 0 else 0
        if r.time_s is not None:
            for i in np.flatnonzero(np.diff(r.time_s) <= 0)[:1] + 1:
                before = f"a time after that of the reading before, {r.time_s[i - 1]:.10g} s"
                yield "time", f"{r.time_s[i]:.10g} s", before, i
        if np.ptp(r.x) <= 0:
            yield self.x_name, f"{r.x[0]:g} in all readings", "a test in which it changes", None
        i = int(r.x.argmin())
        if self.kind in HOMOGENEOUS and r.x[i] <= 0:
            yield "stretch", f"{r.x[i]:g}", "stretches above 0 (1 is undeformed)", i
        if self.kind == "cut" and r.time_s is None and (k := first_return(r.x)) is not None:
            reached = f"at least {r.x[:k].max():g} mm, where the blade had been: a test with holds or returns"
            yield "displacement", f"{r.x[k]:g} mm", f"{reached} needs a time column, or until = 'return'", k
        if r.pressure_MPa is not None and r.pressure_MPa.min() < 0:
            i = int(r.pressure_MPa.argmin())
            yield "pressure", f"{r.pressure_MPa[i]:g} MPa", "a pressure of 0 or more", i
        if not np.any(r.y):
            yield self.y_name, "0 in all readings", "a test in which something was measured", None
        if fault := plausible.way_fault(self.kind, r):
            yield fault

    def _common_range(self) -> None:
        """Repetitions must share at least half of the shortest way of the longest."""
        spans = [self._along(r) for r in self.repetitions]
        ways = [s[-1] - s[0] for s in spans]
        longest = max(ways)
        if min(s[-1] for s in spans) - max(s[0] for s in spans) < 0.5 * longest:
            r = self.repetitions[ways.index(min(ways))]
            expected = (
                f"repetitions that share at least half of their range ({longest:g} long); give others as"
                " an experiment of their own"
            )
            raise r.wrong(self.x_name, f"{r.x.min():g} to {r.x.max():g}", expected)

    # -- on a grid -------------------------------------------------------------------------------
    def _along(self, r: Repetition) -> np.ndarray:
        """The coordinate along which repetitions are compared: x if it only grows, else time or path."""
        if self.monotone:
            return np.sort(r.x if r.x[-1] > r.x[0] else -r.x)
        if r.time_s is not None:
            return r.time_s - r.time_s[0]
        return np.append(0.0, np.cumsum(np.abs(np.diff(r.x)))) / np.abs(np.diff(r.x)).sum()

    def on_grid(self, n: int = 80) -> Averaged:
        """Bring the repetitions to one grid: their mean, scatter and reading noise.

        The grid is even along x, or, in a test with holds or returns, half by the way and half by time,
        with the turning points added. One repetition of no more than ``n`` readings stays as it is. See
        ``cutbench.data.covariance``.
        """
        reps = self.repetitions
        orders = [ascending_order(r) if self.monotone else np.arange(r.x.size) for r in reps]
        grid, along, matrices = self.averaging(n)

        def brought(key: str) -> np.ndarray:
            return np.stack([A @ getattr(r, key)[o] for A, r, o in zip(matrices, reps, orders, strict=True)])

        curves, x = brought("y"), brought("x").mean(axis=0)
        sigmas = [roughness(s, r.y[o]) for s, r, o in zip(along, reps, orders, strict=True)]
        noises = [(A * sigma**2) @ A.T for A, sigma in zip(matrices, sigmas, strict=True)]
        mean, reading = curves.mean(axis=0), np.mean(noises, axis=0)
        if self.kind == "cut" and self.monotone:
            # A grid with turning points is not even, and they are no teeth.
            reading += len(reps) * np.diag(sawtooth_variance(grid, mean, np.diag(reading) / len(reps)))
        several = len(reps) > 1
        scatter = scatter_covariance(grid, curves - mean, reading) if several else np.zeros_like(reading)
        return Averaged(
            x=x,
            mean=mean,
            scatter=np.sqrt(np.diag(scatter)),
            reading=np.sqrt(np.diag(reading)),
            curves=curves,
            time_s=brought("time_s").mean(axis=0) if self.timed else None,
            pressure_MPa=None if reps[0].pressure_MPa is None else brought("pressure_MPa").mean(axis=0),
        )

    def averaging(self, n: int) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Return the grid along which repetitions are compared, and the matrices that bring readings to it.

        r is the number of a repetition's readings. Of a test with holds or returns places count in
        seconds from its first reading. Gives ``grid`` (m,), ``places`` (r,), ``matrices`` (m, r).
        """
        reps = self.repetitions
        along = [self._along(r) for r in reps]
        grid, sharp = self._grid(along, n)
        if len(reps) == 1 and reps[0].x.size <= n and np.all(np.diff(along[0]) > 0):
            return along[0], along, [np.eye(along[0].size)]
        return grid, along, [averaging_matrix(s, grid, sharp) for s in along]

    def _grid(self, along: list[np.ndarray], n: int) -> tuple[np.ndarray, np.ndarray]:
        """Grid (m,) and where on it the way turns, or its speed changes (m,)."""
        low, high = max(s[0] for s in along), min(s[-1] for s in along)
        count = max(FEWEST, min(n, int(np.median([s.size for s in along]))))
        grid = np.linspace(low, high, count)
        first, corners = self.repetitions[0], np.zeros(0)
        if not self.monotone:
            turns = turning_points(first.x)
            corners = along[0][turns]
            grid = _spaced_grid(along[0], first.x, turns, grid)
        elif first.time_s is not None:
            corners = along[0][turning_points(first.time_s[ascending_order(first)])]
        corners = corners[(corners > low) & (corners < high)]
        # The nearest grid value moves onto each corner, so that peaks are met exactly, and no mean is taken
        # of readings at two speeds.
        sharp = np.zeros(count, dtype=bool)
        for corner in corners:
            i = int(np.argmin(np.abs(grid - corner)))
            if 0 < i < count - 1 and not sharp[i]:
                grid[i], sharp[i] = corner, True
        return grid, sharp


def _spaced_grid(along: np.ndarray, x: np.ndarray, turns: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """``grid`` (n,) from first to last value, spaced evenly half by the way and half by ``along``: a ramp
    before a long hold bends within a small part of its time, and has as many values as the hold."""
    ends = np.unique(np.concatenate([[0], turns, [x.size - 1]]).astype(int))
    # From turn to turn, as jitter in a hold is no way.
    way = np.append(0.0, np.cumsum(np.abs(np.diff(x[ends]))))
    at = along[ends]
    if way[-1] <= 0 or np.any(np.diff(at) <= 0):
        return grid
    course = way / way[-1] + (at - at[0]) / (at[-1] - at[0])
    low, high = np.interp(grid[[0, -1]], at, course)
    return np.append(
        np.append(grid[0], np.interp(np.linspace(low, high, grid.size), course, at)[1:-1]), grid[-1]
    )
