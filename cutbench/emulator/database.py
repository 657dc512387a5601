"""The cuts that were computed, and the emulator that they make."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.case.model import Model
from cutbench.emulator.alignment import AlignedCurves, Course
from cutbench.emulator.groups import Coordinate, Groups, is_same_value
from cutbench.emulator.settings import SETTINGS
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import Mechanism


class OutOfRange(Exception):
    """This error says that a cut was asked for that lies too far from all that are known."""


@dataclass(frozen=True)
class Run:
    """A run of the database is a computed cut: its case and its force.

    Attributes
    ----------
    case : Case
        What was computed.
    x : ndarray, shape (n,), mm
        Blade travel; of a blade that holds or returns, the time times its speed.
    force : ndarray, shape (n,), N
        Force on the blade.
    onset_mm : float, mm
        Where the cut begins; nan where it does not.
    """

    case: Case
    x: np.ndarray
    force: np.ndarray
    onset_mm: float = math.nan


@dataclass
class RunDatabase:
    """A database holds all cuts that are known, in whatever order they were computed.

    Attributes
    ----------
    runs : list of Run
        The cuts.
    curves : dict
        What emulators made of them, by their coordinates.
    """

    runs: list[Run] = field(default_factory=list)
    curves: dict[tuple, AlignedCurves] = field(default_factory=dict, repr=False)

    def add(self, case: Case, course: np.ndarray, onset_mm: float = math.nan) -> None:
        """Take up a run, where its case has units and ``course`` (3, n) more than one point."""
        if course.shape[1] > 1 and Groups.of(case) is not None:
            x = course[2] * case.values["speed"] if case.motion else course[0]
            # Where the blade goes back, curves are laid over each other by the time alone.
            self.runs.append(Run(case, x, course[1], math.nan if case.motion else onset_mm))

    def emulator(self, cases: Sequence[Case], free: Collection[str]) -> CutEmulator | None:
        """Make an emulator of cuts like given ones, with any values of some parameters."""
        try:
            return CutEmulator(self.runs, cases, free, self.curves)
        except ValueError:
            return None


class Emulator:
    """The base of what predicts the forces of cuts at travels ``x`` (k,), in units of ``groups``."""

    groups: Groups
    model: Model
    x: np.ndarray
    _equal: list[Mechanism]

    def travel(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the travels at which the forces of a cut are predicted. Gives (k,)."""
        return self.x * self.groups.length(values)

    def forces(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Predict the forces of cuts, which are smooth in the values. Gives (p, k). Raises OutOfRange."""
        raise NotImplementedError

    @staticmethod
    def equal_laws(case: Case) -> tuple[list[Mechanism], set[str]]:
        """The laws that do what another value does, which are that value and no coordinate; and the names of
        what they alone have."""
        equal = [law for law in case.model.all if law.like(case.p)]
        others = {q.name for law in registry().values() if law not in equal for q in law.parameters}
        return equal, {q.name for law in equal for q in law.parameters} - others

    def _with_equal_laws_replaced(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """``values`` as a model without the laws that do what another value does has them."""
        for law in self._equal:
            strengths = (q for q in law.parameters if q.off is not None)
            if any(values.get(q.name, q.off_value) != q.off_value for q in strengths):
                values = {**values, **law.like(self.model.namespace(values))}
        return values

    def _units(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        return np.array([self.groups.force(self._with_equal_laws_replaced(values)) for values in each])

    def slopes(self, values: Mapping[str, float], names: Sequence[str]) -> np.ndarray:
        """Compute derivatives of the predicted forces by parameters.

        They are differences over a step that is short beside the distance of runs. Gives (k, len(names)).
        Raises OutOfRange.
        """
        known, moved, changes = self.model.parameters(), [], []
        for name in names:
            q = known[name]
            size = max(abs(values[name]), 1e-3 * abs(q.typical * q.factor)) or 1.0
            low, high = (float(np.clip(values[name] + s * 1e-3 * size, *q.bounds)) for s in (-1, 1))
            moved += [{**values, name: low}, {**values, name: high}]
            changes.append(high - low)
        if not names:
            return np.zeros((self.x.size, 0))
        forces = self.forces(moved)
        return ((forces[1::2] - forces[::2]) / np.array(changes)[:, None]).T


class CutEmulator(Emulator):
    """An emulator predicts the forces of cuts that were not computed, from those that were.

    ``RunDatabase.emulator`` makes one. Models that differ in what is no part of a cut have the same
    ``curves``. Raises ValueError.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        cases: Sequence[Case],
        free: Collection[str],
        curves: dict[tuple, AlignedCurves],
    ):
        first, groups = cases[0], Groups.of(cases[0])
        alike = all((c.mechanisms, c.motion) == (first.mechanisms, first.motion) for c in cases)
        if groups is None or not alike:
            raise ValueError("no units")
        self.groups, self.model = groups, first.model
        self._equal, other_words = self.equal_laws(first)
        free = {*free, *(name for law in self._equal for name in law.like(first.p))}
        # Where each ends: its depth, or its duration times its speed.
        ways = [c.motion[-1][0] * c.values["speed"] if c.motion else c.values["depth"] for c in cases]
        ends = [way / groups.length(c.values) for way, c in zip(ways, cases, strict=True)]
        asked = [self._reduced(c.values) for c in cases]
        # Runs that differ in anything else, as those of other candidates do, say little of these.
        may_differ = {
            n for n, (force, *_) in groups.powers.items()
            if n in free or (force and groups.modulus in free)
            or any(not is_same_value(a[n], asked[0][n]) for a in asked)
        } - other_words  # fmt: skip
        known: list[tuple[Run, dict[str, float], Mapping[str, float]]] = []
        for run in runs:
            own = values_as_model(run.case, first)
            if own is None or run.x[-1] / groups.length(own) < min(ends) * (1 - 1e-9):
                continue
            seen = self._reduced(own)
            fixed = (n for n in seen if n not in may_differ | other_words)
            if all(any(is_same_value(seen[n], a[n]) for a in asked) for n in fixed):
                known.append((run, seen, own))
        along = [
            Coordinate.of(first.model.parameters()[n], groups, first.values)
            for n in asked[0]
            if n in may_differ
        ]
        told = free - other_words - {groups.modulus, "thickness"}
        self.coordinates, columns = _independent(along, told, asked, [seen for _, seen, _ in known])
        if len(known) < len(self.coordinates) + 1 + SETTINGS.spare:
            raise ValueError("too few runs")
        courses = [self._in_units(run, values) for run, _, values in known]
        self.x = np.linspace(0.0, max(ends), SETTINGS.points + 1)
        X = np.stack(columns, axis=1)
        key = tuple(c.name for c in self.coordinates), X.tobytes(), float(self.x[-1])
        if key not in curves:
            curves[key] = AlignedCurves(X, courses, self.x)
        self.curves = curves[key]

    def _in_units(self, run: Run, values: Mapping[str, float]) -> Course:
        """The curve of a run, which has these values in the words of the model."""
        unit, of_force = self.groups.length(values), self._units([values])[0]
        return Course(run.x / unit, run.force / of_force, run.onset_mm / unit)

    def _reduced(self, values: Mapping[str, float]) -> dict[str, float]:
        return self.groups.reduced(self._with_equal_laws_replaced(values))

    @property
    def count(self) -> int:
        """The number of runs that it knows."""
        return len(self.curves.courses)

    def forces(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        return self.curves.mean(self._places(each)) * self._units(each)[:, None]

    def computed(self, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the computed run with these values, where there is one. Gives (n,). Raises OutOfRange."""
        found = self.curves.computed(self._places([values])[0])
        if found is None:
            return None
        return found.x * self.groups.length(values), found.force * self._units([values])[0]

    def root(self, values: Mapping[str, float]) -> np.ndarray:
        """Compute a root of the covariance of the error of predicted forces.

        The error is what a run would have and is not predicted. Gives (k, r). Raises OutOfRange.
        """
        return self.curves.root(self._places([values])[0]) * self._units([values])[0]

    def onset_mm(self, values: Mapping[str, float]) -> float:
        """Where the cut begins, as it was computed or else predicted. Raises OutOfRange."""
        places = self._places([values])
        run = self.curves.computed(places[0])
        onset = self.curves.onset(places)[0] if run is None or math.isnan(run.onset) else run.onset
        return float(onset * self.groups.length(values))

    def _places(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        reduced = [self._reduced(values) for values in each]
        columns = [c.of_values(np.array([r[c.name] for r in reduced])) for c in self.coordinates]
        found = np.stack(columns, axis=1) if columns else np.zeros((len(each), 0))
        return self._within_range(found, [c.name for c in self.coordinates])

    def _within_range(self, found: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Places (p, d) as they are. Raises OutOfRange for one beyond the known runs."""
        low, high = self.curves.X.min(axis=0), self.curves.X.max(axis=0)
        far = np.maximum(low - found, found - high) > SETTINGS.extrapolation * (high - low)
        if far.any():
            beyond = [name for name, is_far in zip(names, far.any(axis=0), strict=True) if is_far]
            raise OutOfRange(f"no cut near enough is known: {', '.join(beyond)}")
        return found


def _independent(
    along: Sequence[Coordinate],
    told: Collection[str],
    asked: Sequence[Mapping[str, float]],
    known: Sequence[Mapping[str, float]],
) -> tuple[list[Coordinate], list[np.ndarray]]:
    """The coordinates along which cuts differ, of those along which they may, and those of the known runs
    (n,) along each; runs must have told what some do."""
    coordinates, columns = list[Coordinate](), list[np.ndarray]()
    for coordinate in along:
        column, there = (
            coordinate.of_values(np.array([a[coordinate.name] for a in rows])) for rows in (known, asked)
        )
        has = np.isfinite(column)
        column = np.where(has, column, np.mean(column[has]) if has.any() else there[0])
        every = np.append(column, there)
        alike = np.ptp(every) <= 1e-9 * max(np.abs(every).max(), 1.0)
        if np.ptp(column) == 0 and (coordinate.name in told or not alike):
            raise ValueError(f"no run tells what {coordinate.name} does")
        if not alike and not any(_collinear(column, other) for other in columns):
            coordinates.append(coordinate)
            columns.append(column)
    return coordinates, columns


def _collinear(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two columns (n,) change together in proportion, so that one says all of the other."""
    a, b = one - one.mean(), other - other.mean()
    return bool(abs(a @ b) >= (1 - 1e-9) * np.linalg.norm(a) * np.linalg.norm(b))


@lru_cache
def _is_nested_in(mechanisms: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
    """Whether the model of ``mechanisms`` is the one that is ``wanted`` with some of its laws switched off,
    or in place of what is a special case of them; whatever their rigs."""
    mine, other = (Model(names).unrigged for names in (mechanisms, wanted))
    try:
        grown, _ = mine.extended(*(name for name in other.mechanisms if name not in mine.mechanisms))
    except BadInput:
        return False
    return {*grown.mechanisms} == {*other.mechanisms}


def values_as_model(run: Case, wanted: Case) -> dict[str, float] | None:
    """The values of a run as one of the model of ``wanted``, nan where they have no effect; None if it is
    none, or was computed otherwise."""
    fixed = ("dim", "numerics", "outline", "motion")
    alike = all(getattr(run, name) == getattr(wanted, name) for name in fixed)
    if not alike or not _is_nested_in(run.mechanisms, wanted.mechanisms):
        return None
    new = {n: q for n, q in wanted.model.parameters().items() if n not in run.values}
    return {**run.values, **{n: math.nan if q.off is None else q.off_value for n, q in new.items()}}
