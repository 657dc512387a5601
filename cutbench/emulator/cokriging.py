"""Runs of one's own beside those of the atlas: an emulator that a handful of runs make exact where they are.

What the atlas gets wrong of cuts like these is smooth, so that few runs tell it (co-kriging: Kennedy &
O'Hagan 2000, 10.1093/biomet/87.1.1). Both are samples of one process whose lengths the atlas knows; a
coordinate tells whose a run is, so that what differs between them on the whole is part of the trend.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cutbench.case.case import Case
from cutbench.case.model import Model
from cutbench.emulator.alignment import AlignedCurves
from cutbench.emulator.atlas import row_of, shipped, space_of
from cutbench.emulator.database import CutEmulator, Run, values_as_model
from cutbench.emulator.gaussian_process import Kernel
from cutbench.emulator.groups import Coordinate, Groups, is_same_value
from cutbench.emulator.settings import SETTINGS


class CokrigedCuts(CutEmulator):
    """An emulator of cuts by the atlas and ``runs``.

    The model of ``cases`` is that of ``plain``, which the atlas has, perhaps with other laws beside it.
    Raises NotInAtlas where it lacks ``plain``, ValueError where no run says what a ``free`` parameter does.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        plain: Case,
        cases: Sequence[Case],
        free: Collection[str],
        curves: dict[tuple, AlignedCurves],
    ):
        first, atlas = cases[0], shipped()
        groups, (self._space, _) = Groups.of(first), space_of(plain)
        assert groups is not None, "of the atlas' model"
        self.groups, self.model = groups, first.model
        self._equal, other_words = self.equal_laws(first)
        held = {*self._space.parameters.values(), groups.modulus, *other_words}
        new = [n for n in groups.powers if n in free and n not in held]
        self._new = [Coordinate.of(self.model.parameters()[n], groups, first.values) for n in new]
        ends = [c.values["depth"] / groups.length(c.values) for c in cases]
        self.x = np.linspace(0.0, max(ends), SETTINGS.points + 1)
        known, asked = [], self._reduced(first.values)
        fixed = [n for n in groups.powers if n not in free and n not in held]
        for run in runs:
            own = _values_in_words_of(run.case, first, plain)
            if own is None or run.x[-1] / groups.length(own) < min(ends) * (1 - 1e-9):
                continue
            seen = self._reduced(own)
            if all(is_same_value(seen[n], asked[n]) or math.isnan(seen[n]) for n in fixed):
                known.append((run, own))
        own_X = self._columns([own for _, own in known])
        for c, column in zip(self._new, own_X.T[own_X.shape[1] - len(self._new) :], strict=True):
            if np.unique(column[np.isfinite(column)]).size < 2:
                raise ValueError(f"no run tells what {c.name} does")
        same_blade = np.isfinite(atlas.groups) == np.isfinite(self._rows([first.values]))[0]
        like = np.flatnonzero(same_blade.all(axis=1))
        # The atlas has what is new as the plain model has it, or where it does nothing.
        there = self.groups.reduced({**_without_effect(self.model), **plain.values})
        off = [float(c.of_values(np.array(there[c.name]))) for c in self._new]
        X = np.vstack([np.hstack([atlas.X[like], np.tile([0.0, *off], (like.size, 1))]), own_X])
        for column in X.T:  # what a law that is off does not feel
            column[np.isnan(column)] = np.nanmean(column)
        courses = [*(atlas.courses[i] for i in like.tolist()), *(self._in_units(*each) for each in known)]
        self._source = atlas.X.shape[1]
        key = tuple(c.name for c in self._new), X.tobytes(), float(self.x[-1])
        if key not in curves:
            # Whose a run is makes but a trend, and so, nearly, does what the atlas has not.
            lengths = 1e3, *(3.0 * np.ptp(X[:, self._source + 1 :], axis=0))
            kernels = {
                name: k and Kernel((*k.lengths, *lengths), k.nugget)
                for name, k in atlas.curves.kernels.items()
            }
            near = SETTINGS.travels
            beyond = np.append(near, np.arange(near[-1] + 1, max(self.x[-1], near[-1] + 2)))
            curves[key] = AlignedCurves(X, courses, self.x, beyond, kernels)
        self.curves = curves[key]
        self._own_count = len(known)

    @property
    def count(self) -> int:
        """The number of runs of one's own that it knows."""
        return self._own_count

    def _rows(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Groups (p, d) of the atlas."""
        plain = [self._with_equal_laws_replaced(values) for values in each]
        stacked = {n: np.array([values[n] for values in plain], dtype=float) for n in plain[0]}
        found = row_of(self._space, self._space.of_values(self.groups, self.model, stacked))
        return np.stack(np.broadcast_arrays(*found), axis=-1)

    def _columns(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Places (p, d) of cuts of one's own."""
        if not each:
            return np.zeros((0, shipped().X.shape[1] + 1 + len(self._new)))
        reduced = [self._reduced(values) for values in each] if self._new else []
        new = [c.of_values(np.array([r[c.name] for r in reduced], dtype=float)) for c in self._new]
        return np.column_stack([shipped().coordinates(self._rows(each)), np.ones(len(each)), *new])

    def _places(self, each: Sequence[Mapping[str, float]]) -> np.ndarray:
        found = self._columns(each)
        found[:, self._source] = min(self.count, 1)
        return self._within_range(found, [*["a group"] * (self._source + 1), *(c.name for c in self._new)])


def _values_in_words_of(run: Case, wanted: Case, plain: Case) -> Mapping[str, float] | None:
    """The values of a run as one of the model ``wanted``, also where a law in it does what another value of
    the ``plain`` model does; None where it is none."""
    own = values_as_model(run, wanted)
    equal = {law.name: same for law in run.model.all if (same := law.like(run.p))}
    strange = {*run.mechanisms} - {*plain.mechanisms} - equal.keys()
    if own is not None or not equal or strange:
        return own
    values = dict(run.values)
    for same in equal.values():
        values |= same
    kept = {name: values[name] for name in plain.values}
    return values_as_model(replace(run, mechanisms=plain.mechanisms, values=kept), wanted)


def _without_effect(model: Model) -> dict[str, float]:
    """Values of all parameters with which laws do nothing; nan where none does so."""
    parameters = model.parameters()
    return {n: math.nan if q.off is None else q.off_value for n, q in parameters.items()}
