"""Cuts that were computed, in a form in which one tells of another.

Without inertia a cut knows no stress and no time but its own: in units of a modulus, and of the time in which
the blade goes a millimetre, cuts at several speeds are samples of one function, and so are those of softer
and tougher gels. What a mechanism that is switched off would be said to be does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.units import powers_of
from cutbench.calibration.registered import SPARE, Registered
from cutbench.case.case import Case
from cutbench.case.model import Model
from cutbench.mechanisms.base import Mechanism

#: Places along the travel at which forces are foreseen.
PLACES = 80
#: Values that differ by less (relative) are the same.
SAME = 1e-9


@lru_cache
def _powers(mechanisms: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Of force and time in what the course of a run depends on, by name: all but rigs', speed and travel."""
    model = Model(mechanisms)
    rig = {q.name for law in model.laws("rig") for q in law.parameters}
    units = {n: q.unit for n, q in model.parameters().items() if n not in rig and n not in ("speed", "depth")}
    return {name: powers_of(unit) for name, unit in units.items()}


@dataclass(frozen=True)
class Scale:
    """Of a model: the name of the ``modulus`` (MPa) that forces are in units of, and powers by name."""

    modulus: str
    powers: Mapping[str, tuple[float, float]]

    @classmethod
    def of(cls, case: Case) -> Scale | None:
        """None where no modulus or speed sets the scale."""
        powers = _powers(case.mechanisms)
        stress = next((n for n, (force, _) in powers.items() if force == 1 and case.values[n] > 0), None)
        return None if stress is None or case.motion or not case.values["speed"] > 0 else cls(stress, powers)

    def reduced(self, values: Mapping[str, float], names: Collection[str] | None = None) -> dict[str, float]:
        """In units of the modulus and the speed, those of ``names`` (default: all)."""
        stress, speed, powers = values[self.modulus], values["speed"], self.powers
        asked = powers if names is None else names
        return {n: values[n] * stress ** -powers[n][0] * speed ** powers[n][1] for n in asked}

    @property
    def loose(self) -> set[str]:
        """What differs between cuts of one specimen at several speeds, or of softer and tougher ones."""
        return {name for name, powers in self.powers.items() if any(powers)}


@dataclass(frozen=True)
class _Run:
    """``x`` (n,) in mm, ``force`` (n,) in N; ``onset_mm``: where the cut begins, nan where it does not."""

    case: Case
    x: np.ndarray
    force: np.ndarray
    onset_mm: float


@dataclass
class Memory:
    """All cuts that were computed in a session."""

    runs: list[_Run] = field(default_factory=list)
    _emulators: dict[tuple, Emulator | None] = field(default_factory=dict)
    _same: dict[tuple, Registered] = field(default_factory=dict)

    def add(self, case: Case, course: np.ndarray, onset_mm: float = math.nan) -> None:
        """A run's ``course`` (3, n): travel in mm, force in N, time; where its cut begins, or nan."""
        if course.shape[1] < 2 or Scale.of(case) is None:
            return
        self.runs.append(_Run(case, course[0], course[1], onset_mm))

    def emulator(self, case: Case, names: Collection[str], end_mm: float) -> Emulator | None:
        """Of cuts like ``case`` up to a travel, whatever values ``names`` have; None if too few are known."""
        asked = case.mechanisms, tuple(case.values.items()), case.numerics, frozenset(names), end_mm
        key = len(self.runs), *asked
        if key not in self._emulators:
            if any(k[0] != key[0] for k in self._emulators):
                self._emulators, self._same = {}, {}
            self._emulators[key] = self._emulator(case, names, end_mm)
        return self._emulators[key]

    def _emulator(self, case: Case, names: Collection[str], end_mm: float) -> Emulator | None:
        if (scale := Scale.of(case)) is None:
            return None
        wanted, known = scale.reduced(case.values), []
        free = (scale.loose | {*names}) & {*wanted}
        for run in (r for r in self.runs if r.x[-1] >= end_mm * (1 - SAME) and _alike(r.case, case)):
            values = _seen_as(run, case.model)
            if values is None:
                continue
            seen = scale.reduced(values)
            if all(_same(seen[n], v) for n, v in wanted.items() if n not in free):
                like = _like(case.model, values)
                known.append((scale.reduced(like), like[scale.modulus], run))
        wanted = scale.reduced(_like(case.model, case.values))
        axes, columns, said = [], [], _said(case.model)
        for name in (n for n in wanted if n in free):
            column = np.array([values[name] for values, _, _ in known])
            has = np.isfinite(column)
            here = np.append(column[has], wanted[name])
            if _same(here.min(), here.max()) or (name in said and has.any() and np.ptp(column[has]) == 0):
                continue
            if has.any() and np.ptp(here[:-1]) == 0:  # nothing tells what it does
                return None
            axes.append(axis := _Axis(name, bool(here.min() > 0)))
            columns.append(axis.of(np.where(has, column, here.mean())))
        if len(known) < len(axes) + 1 + SPARE:
            return None
        X, runs = np.stack(columns, axis=1), [(run.x, run.force / stress) for _, stress, run in known]
        # Tests that differ by their speed alone are foreseen from the same.
        what = end_mm, case.mechanisms, tuple(axis.name for axis in axes), X.tobytes()
        if (same := self._same.get(what)) is None:
            begins = np.array([run.onset_mm for *_, run in known])
            same = Registered(X, runs, begins, np.linspace(0.0, end_mm, PLACES + 1))
            self._same[what] = same
        return Emulator(case.model, scale, axes, same)


def _same(a: float, b: float) -> bool:
    return abs(a - b) <= SAME * max(abs(a), abs(b))


def _alike(one: Case, other: Case) -> bool:
    return all(getattr(one, name) == getattr(other, name) for name in ("dim", "numerics", "outline"))


@lru_cache
def _grows(mechanisms: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
    """Whether the model of ``mechanisms`` is the one that is ``wanted`` with some of its laws switched off,
    or in place of what is a special case of them; whatever their rigs."""
    mine, other = (Model(names).unrigged for names in (mechanisms, wanted))
    try:
        grown, _ = mine.extended(*(name for name in other.mechanisms if name not in mine.mechanisms))
    except BadInput:
        return False
    return {*grown.mechanisms} == {*other.mechanisms}


def _seen_as(run: _Run, model: Model) -> dict[str, float] | None:
    """The values of a ``run`` as one of ``model``, nan where they have no effect; None if it is none."""
    if not _grows(run.case.mechanisms, model.mechanisms):
        return None
    mine = run.case.values
    new = {n: q for n, q in model.parameters().items() if n not in mine}
    return {**mine, **{n: np.nan if q.off is None else q.off_value for n, q in new.items()}}


def _like(model: Model, values: Mapping[str, float]) -> Mapping[str, float]:
    """``values`` as a model without what does the same has them."""
    for law in (law for law in model.all if law.resembles):
        on = any(q.off is not None and values.get(q.name, q.off_value) != q.off_value for q in law.parameters)
        if on:
            values = {**values, **law.like(SimpleNamespace(**values))}
    return values


def _said(model: Model) -> set[str]:
    """Parameters whose effect is that of another's value, in the words of their law."""
    laws = [law for law in model.all if type(law).like is not Mechanism.like]
    return {q.name for law in laws for q in law.parameters}


@dataclass(frozen=True)
class _Axis:
    """A coordinate of the places: a value, or its logarithm."""

    name: str
    logarithmic: bool

    def of(self, value: np.ndarray) -> np.ndarray:
        return np.log(np.maximum(value, 1e-300)) if self.logarithmic else value


class Emulator:
    """Forces along ``x`` (n,) in mm from those that are ``known`` in units of their moduli."""

    def __init__(self, model: Model, scale: Scale, axes: Sequence[_Axis], known: Registered):
        self.model, self.scale, self.axes, self.known, self.x = model, scale, axes, known, known.x

    def forces(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        """(p, n) in N for ``each`` of p sets of values."""
        like, places = self._places(each)
        return self.known(places) * np.array([values[self.scale.modulus] for values in like])[:, None]

    def error(self, values: Mapping[str, float]) -> np.ndarray:
        """Root (n, k) of the covariance, in N, of what a run with ``values`` has and is not foreseen."""
        (like,), (place,) = self._places([values])
        return self.known.error(place) * like[self.scale.modulus]

    def _places(self, each: Sequence[Mapping[str, float]]) -> tuple[list[Mapping[str, float]], np.ndarray]:
        """``each`` as a model without what does the same has it, and the places (p, d) of these."""
        like, names = [_like(self.model, values) for values in each], [axis.name for axis in self.axes]
        reduced = np.array([[*self.scale.reduced(values, names).values()] for values in like])
        places = np.stack([axis.of(c) for axis, c in zip(self.axes, reduced.T, strict=True)], axis=1)
        return like, places
