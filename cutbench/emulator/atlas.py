"""Runs that the package brings along, and what they say of a case that was not computed.

All blunt blades in all neo-Hookean gels are samples of one function of ten dimensionless groups (see
``cutbench.emulator.groups``). The atlas has runs that fill a box of these groups; the emulator says what lies
between them, and how surely. It is an estimate of a run at the default numerics, whatever code computes that.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.handled import Handled
from cutbench.case.case import Case, load_case
from cutbench.case.model import groups
from cutbench.emulator.alignment import AlignedCurves, Course, Curves
from cutbench.emulator.box import BLUNT, Box
from cutbench.emulator.groups import Groups, same
from cutbench.emulator.process import Kernel
from cutbench.run.measures import (
    ABRUPT,
    ABRUPT_DROP,
    BLUR,
    FLOOR,
    KNOWN,
    PROMINENCE,
    SMOOTH,
    TAIL,
    TRANSITION,
    UNCUT,
)

#: Travels beyond the onset, in halves of the blade's thickness, between which curves are straight.
BEYOND = np.array(
    [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1, 1.2, 1.5, 1.8, 2.2, 2.6, 3, 3.5, 4, 4.5, 5, 6, 7, 8, 9, 10,
     12, 14, 17, 20, 25, 30, 38]
)  # fmt: skip
#: Parts of the way to the onset.
RISE = 24
#: Runs reach so far, in halves of the blade's thickness.
REACH = 40.0
#: Where the work is told apart by mechanism: parts of the way to the onset, and travels beyond.
PARTS, LATER = np.array([0.2, 0.5, 0.8, 1.0]), np.array([1.0, 3.0, 6.0, 10.0, 20.0])
#: Curves that are drawn, and the level of intervals.
DRAWS, LEVEL = 200, 0.9
#: The blade's thickness, in its halves: the window of a drop.
WINDOW = 2.0
#: Spacing of the travels at which the fall of the force is looked for.
STEP = 0.1


#: What an estimate has intervals of, and their units.
MEASURES = {"onset_mm": "mm", "peak_N": "N", "drop": "", "steady_N": "N"}


class NotInAtlas(BadInput):
    """A case that lies outside the atlas' box, or whose model has none."""


@dataclass(frozen=True)
class Interval:
    """A value and the ends of its 90 % interval; nan where it has none."""

    value: float
    low: float
    high: float

    def __format__(self, form: str) -> str:
        if math.isnan(self.value):
            return "-"
        return f"{self.value:{form}} [{self.low:{form}}, {self.high:{form}}]"

    @classmethod
    def of(cls, drawn: np.ndarray) -> Interval:
        """Of draws (s,): their median, and where all but a tenth lie."""
        known = drawn[np.isfinite(drawn)]
        if known.size < drawn.size / 2:
            return cls(math.nan, math.nan, math.nan)
        low, value, high = np.quantile(known, [(1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2])
        return cls(float(value), float(low), float(high))


@dataclass(frozen=True, repr=False)
class Estimate(Handled):
    """What the atlas says of a case.

    Attributes
    ----------
    case : Case
        The case.
    x_mm : ndarray, shape (k,)
        Travel of the blade, mm.
    force_N, low_N, high_N : ndarray, shape (k,)
        Force, and the ends of its 90 % interval, N.
    onset_mm, peak_N, drop, steady_N : Interval
        As ``cutbench.run.measures`` has them.
    chances : mapping
        Of ``abrupt``, ``smooth`` and ``uncut``, in sum 1.
    work : mapping
        By mechanism, the part (k,) that it took of the blade's work until then.
    nearest : tuple of (float, mapping)
        Groups of the nearest runs, with their distances in lengths along which the onset changes.
    """

    handled_in: ClassVar[str] = "cutbench.emulator.display"

    case: Case
    x_mm: np.ndarray
    force_N: np.ndarray
    low_N: np.ndarray
    high_N: np.ndarray
    onset_mm: Interval
    peak_N: Interval
    drop: Interval
    steady_N: Interval
    chances: Mapping[str, float]
    work: Mapping[str, np.ndarray]
    nearest: tuple[tuple[float, Mapping[str, float]], ...]

    @property
    def verdict(self) -> str:
        """The likeliest regime."""
        return max(self.chances, key=lambda name: self.chances[name])

    @property
    def chance(self) -> float:
        """Probability of the verdict."""
        return self.chances[self.verdict]

    def sentence(self) -> str:
        """The verdict in words."""
        chance = "as good as sure" if self.chance > 0.99 else f"{100 * self.chance:.0f} % likely"
        if self.verdict == UNCUT:
            return f"uncut, {chance}: the cut does not begin within {self.x_mm[-1]:.3g} mm"
        begins = f"the cut begins at {self.onset_mm:.3g} mm"
        return f"{self.verdict}, {chance}: {begins}, the force falls by {self.drop:.2f}"

    def lines(self) -> list[tuple[str, str]]:
        """What there is to say, each under its name: the verdict first."""
        found = [("verdict", self.sentence())]
        for name, unit in MEASURES.items():
            found.append((name.removesuffix(f"_{unit}"), f"{getattr(self, name):.3g} {unit}".strip()))
        far, groups = self.nearest[0]
        near = ", ".join(f"{name} {value:.3g}" for name, value in groups.items())
        return [*found, ("nearest run", f"{far:.2g} lengths away: {near}")]


@dataclass(frozen=True)
class Measured:
    """Measures of drawn curves, (p, s) each, in the atlas' units: see ``cutbench.run.measures``."""

    onset: np.ndarray
    peak: np.ndarray
    drop: np.ndarray
    steady: np.ndarray


class Atlas:
    """Runs of one box, and what lies between them.

    Parameters
    ----------
    box : Box
        The box.
    groups : ndarray, shape (n, d)
        Values of its groups.
    courses : sequence of Course
        The runs, in units of half the blade's thickness and of a force.
    works : mapping
        By mechanism, the work (n arrays) that it took up at the travels of each run.
    kernels : sequence of Kernel, optional
        Of its processes; the likeliest unless given, which takes a while.
    about : mapping
        Where it comes from.
    """

    def __init__(
        self,
        box: Box,
        groups: np.ndarray,
        courses: Sequence[Course],
        works: Mapping[str, Sequence[np.ndarray]] | None = None,
        kernels: Sequence[Kernel | None] = (None, None, None),
        about: Mapping[str, Any] | None = None,
    ):
        self.box, self.groups, self.courses, self.works = box, groups, courses, works or {}
        self.about = about or {}
        self.X = self._coordinates(groups)
        rise = np.linspace(0, REACH, RISE + 1)
        self.curves = AlignedCurves(self.X, courses, rise, BEYOND, kernels)

    @classmethod
    def read(cls, file: str | Path | Any, box: Box = BLUNT) -> Atlas:
        """Out of a file that ``write`` made."""
        with np.load(file) as data:
            about = json.loads(str(data["about"]))
            ends = np.cumsum(data["sizes"])[:-1]
            x, force = (np.split(data[name].astype(float), ends) for name in ("x", "force"))
            works = {
                n: np.split(w.astype(float), ends)
                for n, w in zip(about["works"], data["work"].T, strict=True)
            }
            onset = data["onset"].astype(float)
            courses = [Course(*each) for each in zip(x, force, onset, strict=True)]
            kernels = [k and Kernel(tuple(k["lengths"]), k["nugget"]) for k in about["kernels"]]
            return cls(box, data["groups"].astype(float), courses, works, kernels, about)

    def write(self, file: Path, about: Mapping[str, Any]) -> None:
        """Into a file."""
        kernels = [k and {"lengths": k.lengths, "nugget": k.nugget} for k in self.curves.kernels]
        record = {**about, "works": [*self.works], "kernels": kernels}
        np.savez_compressed(
            file, about=json.dumps(record), groups=np.float32(self.groups),
            sizes=np.array([c.x.size for c in self.courses]),
            x=np.float32(np.concatenate([c.x for c in self.courses])),
            force=np.float32(np.concatenate([c.force for c in self.courses])),
            onset=np.float32([c.onset for c in self.courses]),
            work=np.float32([np.concatenate(w) for w in self.works.values()]).T,
        )  # fmt: skip

    def _coordinates(self, values: np.ndarray) -> np.ndarray:
        columns = [side.coordinate(v) for side, v in zip(self.box.sides, values.T, strict=True)]
        return np.stack(columns, axis=1)

    def place(self, case: Case) -> np.ndarray:
        """Coordinates (d,) of a case. Raises NotInAtlas."""
        return self._coordinates(np.array([self.values(case)]))[0]

    def values(self, case: Case) -> list[float]:
        """Values of the groups of a case. Raises NotInAtlas, which says what lies outside."""
        found = values_of(self.box, case)
        for side, value in zip(self.box.sides, found, strict=True):
            if not side.low * (1 - 1e-6) <= value <= side.high * (1 + 1e-6):
                raise NotInAtlas(
                    side.name, f"{value:.3g}", f"{side.low:g} to {side.high:g}, which the atlas has"
                )
        return found

    # -- what it says ---------------------------------------------------------------------------------
    def draws(
        self, places: np.ndarray, count: int = DRAWS, seed: int = 0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Curves that runs may have: see ``AlignedCurves.draws``; half of them mirror the others."""
        known: dict[tuple[int, int], np.ndarray] = {}

        def normal(part: int, r: int) -> np.ndarray:
            if (part, r) not in known:
                half = np.random.default_rng([seed, part, r]).standard_normal((count // 2, r))
                known[part, r] = np.concatenate([half, -half])
            return known[part, r]

        return self.curves.draws(places, normal)

    def measured(self, places: np.ndarray, depths: np.ndarray, count: int = DRAWS) -> Measured:
        """Measures of curves that are drawn at places (p, d), of runs to depths (p,)."""
        parts = []
        for some in np.array_split(np.arange(len(places)), max(1, len(places) * count // 20000)):
            parts.append(_measured(*self.draws(places[some], count), depths[some, None]))
        return Measured(*(np.concatenate([getattr(p, n) for p in parts]) for n in vars(parts[0])))

    def estimate(self, case: Case) -> Estimate:
        """What a run of a case would give.

        Raises
        ------
        NotInAtlas
            If it lies outside.
        """
        units = Groups.of(case)
        assert units is not None, "of the atlas' model"
        place, half, force = self.place(case)[None], units.length(case.values), units.force(case.values)
        depth = min(case.values["depth"] / half, REACH)
        onset, before, after = (each[0] for each in self.draws(place))
        x = np.linspace(0, depth, 161)
        curves = np.stack([_joined(x, *each) for each in zip(onset, before, after, strict=True)])
        low, middle, high = np.quantile(curves, [(1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2], axis=0)
        m = _measured(onset[None], before[None], after[None], np.array([[depth]]))
        uncut = m.onset[0] >= depth
        abrupt = ~uncut & (m.drop[0] >= ABRUPT_DROP)
        chances = {ABRUPT: abrupt.mean(), SMOOTH: (~uncut & ~abrupt).mean(), UNCUT: uncut.mean()}
        measured = {n: np.where(uncut, np.nan, getattr(m, n)[0]) for n in ("onset", "peak", "drop", "steady")}
        return Estimate(
            case, x * half, middle * force, low * force, high * force,
            Interval.of(measured["onset"] * half), Interval.of(measured["peak"] * force),
            Interval.of(measured["drop"]), Interval.of(measured["steady"] * force),
            {name: float(value) for name, value in chances.items()},
            self._shares(place, x, float(np.median(onset))), self._nearest(place),
        )  # fmt: skip

    def _nearest(self, place: np.ndarray, count: int = 3) -> tuple[tuple[float, Mapping[str, float]], ...]:
        kernel = self.curves.kernels[0]
        assert kernel is not None
        far = kernel.apart(place, self.X)[0]
        names = [side.name for side in self.box.sides]
        return tuple(
            (float(far[i]), dict(zip(names, map(float, self.groups[i]), strict=True)))
            for i in np.argsort(far)[:count]
        )

    def _shares(self, place: np.ndarray, x: np.ndarray, onset: float) -> dict[str, np.ndarray]:
        """By mechanism, the part (k,) of the work until travels (k,)."""
        if not self.works:
            return {}
        shares = np.maximum(self._work.mean(place)[0].reshape(-1, len(self.works)), 0.0)
        shares /= shares.sum(axis=1, keepdims=True)
        stations = np.concatenate([onset * PARTS, onset + LATER])
        return {n: np.interp(x, stations, share) for n, share in zip(self.works, shares.T, strict=True)}

    @cached_property
    def _work(self) -> Curves:
        """Of the parts of the work at stations of the way, mechanism by mechanism."""
        rows = []
        for run, course in enumerate(self.courses):
            works = np.stack([each[run] for each in self.works.values()], axis=1)
            onset = course.onset if math.isfinite(course.onset) else course.x[-1]
            at = np.concatenate([onset * PARTS, onset + LATER])
            taken = np.stack([np.interp(at, course.x, w) for w in works.T], axis=1)
            taken /= taken.sum(axis=1, keepdims=True)
            taken[at > course.x[-1] * (1 + 1e-9)] = np.nan
            rows.append(taken.ravel())
        return Curves(self.X, np.array(rows), self.curves.kernels[1])


def values_of(box: Box, case: Case) -> list[float]:
    """Values of a box's groups of a case, of whatever size. Raises NotInAtlas for another model."""
    base = _base(box)
    strange = [m for m in case.mechanisms if m not in base.mechanisms]
    missing = [m for m in base.mechanisms if m not in case.mechanisms and m not in ("adhesion", "coulomb")]
    if strange or missing or case.dim != base.dim or case.motion:
        what = ", ".join(strange or missing) or ("3D" if case.dim != base.dim else "motion")
        raise NotInAtlas("mechanisms", what, "the default model of a section, cut at one speed")
    units, known = Groups.of(case), groups()
    if units is None:
        raise NotInAtlas("speed", f"{case.values['speed']:g} mm/s", "a blade that moves")
    reduced, at_base = units.reduced(case.values), units.reduced(base.values)
    sides = {side.name for side in box.sides}
    solved = {"G_c", "eta_reg", "tau_W", units.modulus}
    for name, value in reduced.items():
        if name not in sides | solved and not same(value, at_base[name]):
            q = base.model.parameters()[name]
            raise NotInAtlas(name, q.show(case.values[name]), f"{q.show(base.values[name])}, as in the atlas")
    full = replace(base, values={**base.values, **case.values})
    off = {"mu": "coulomb", "adhesion": "adhesion"}
    return [
        0.0 if off.get(side.name, "neo_hookean") not in case.mechanisms
        else known[side.name].value(full.p) if side.name in known else reduced[side.name]
        for side in box.sides
    ]  # fmt: skip


@cache
def _base(box: Box) -> Case:
    base = load_case("gelatin")
    return base if box is BLUNT else base.set(with_=box.blade)


@cache
def shipped(blade: str = BLUNT.blade) -> Atlas:
    """The atlas that the package brings along for a kind of blade. Raises NotInAtlas where there is none."""
    if blade != BLUNT.blade:
        raise NotInAtlas("mechanisms", blade, f"{BLUNT.blade}: there is no atlas of other blades")
    return Atlas.read(files("cutbench.emulator") / "blunt.npz")


def estimate(source: Case | str | Path) -> Estimate:
    """What a run would give, from the atlas, at once.

    Parameters
    ----------
    source : Case, str or Path
        A case, a material's name, or a case file.

    Returns
    -------
    Estimate

    Raises
    ------
    NotInAtlas
        If the atlas does not say.
    """
    case = source if isinstance(source, Case) else load_case(source)
    tool = case.model.tool
    return shipped(tool.name if tool else "").estimate(case)


def _joined(x: np.ndarray, onset: float, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Forces at travels (k,) of one drawn curve."""
    rise = np.linspace(0, onset, before.size)
    return np.where(x <= onset, np.interp(x, rise, before), np.interp(x - onset, BEYOND, after))


def _measured(onset: np.ndarray, before: np.ndarray, after: np.ndarray, depth: np.ndarray) -> Measured:
    """Measures (p, s) of drawn curves; ``depth`` (p, 1)."""
    around = np.arange(-1.5 * WINDOW, KNOWN * WINDOW + STEP / 2, STEP)
    back = np.maximum(around, 0)
    later = np.apply_along_axis(lambda f: np.interp(back, BEYOND, f), -1, after)
    parts = 1 + around[around < 0] / onset[..., None]
    rising = _at_parts(before, np.clip(parts, 0, 1))
    force = np.concatenate([rising, later[..., around >= 0]], axis=-1)
    ended = around > (depth - onset)[..., None]
    last = np.maximum((~ended).sum(axis=-1, keepdims=True) - 1, 0)
    force = np.where(ended, np.take_along_axis(force, last, axis=-1), force)
    half = round(BLUR * WINDOW / 2 / STEP)
    sums = np.cumsum(np.pad(force, [(0, 0)] * (force.ndim - 1) + [(1, 0)]), axis=-1)
    mean = (sums[..., 2 * half + 1 :] - sums[..., : -2 * half - 1]) / (2 * half + 1)
    places = around[half:-half]
    ahead = round(WINDOW / STEP)
    padded = np.pad(mean, [(0, 0)] * (mean.ndim - 1) + [(0, ahead)], mode="edge")
    low = np.lib.stride_tricks.sliding_window_view(padded, ahead + 1, axis=-1).min(axis=-1)
    largest = np.maximum(force.max(axis=-1), before.max(axis=-1))
    counts = (places >= -WINDOW) & (places <= TRANSITION * WINDOW) & (mean > FLOOR * largest[..., None])
    drop = np.where(counts, (mean - low) / np.where(counts, mean, 1.0), 0.0).max(axis=-1)
    return Measured(onset, _peak(onset, before, after, depth), drop, _steady(onset, after, depth))


def _peak(onset: np.ndarray, before: np.ndarray, after: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """The first maximum from which the force falls by ``PROMINENCE`` of it; nan without one."""
    rise = onset[..., None] * np.linspace(0, 1, before.shape[-1])
    x = np.concatenate([rise, onset[..., None] + BEYOND], axis=-1)
    force = np.where(x <= depth[..., None], np.concatenate([before, after], axis=-1), np.inf)
    highest = np.maximum.accumulate(force, axis=-1)
    least = FLOOR * np.where(np.isfinite(force), force, 0.0).max(axis=-1, keepdims=True)
    falls = (force < (1 - PROMINENCE) * highest) & (highest > least)
    first = falls.argmax(axis=-1)[..., None]
    found = np.take_along_axis(highest, first, axis=-1)[..., 0]
    return np.where(falls.any(axis=-1), found, np.nan)


def _steady(onset: np.ndarray, after: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Mean force over the last part of the travel that lies behind the transition; nan without one."""
    start = np.maximum((1 - TAIL) * depth, onset + TRANSITION * WINDOW)
    parts = np.linspace(0, 1, 20)
    at = (start + (depth - start) * parts[:, None, None] - onset).transpose(1, 2, 0)
    flat = [
        np.interp(a, BEYOND, f)
        for a, f in zip(at.reshape(-1, 20), after.reshape(-1, BEYOND.size), strict=True)
    ]
    mean = np.mean(flat, axis=1).reshape(onset.shape)
    return np.where(depth - start >= WINDOW, mean, np.nan)


def _at_parts(before: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Values at parts (p, s, j) of the way, of curves (p, s, k) at even parts."""
    place = parts * (before.shape[-1] - 1)
    i = np.clip(place.astype(int), 0, before.shape[-1] - 2)
    low, high = (np.take_along_axis(before, i + k, axis=-1) for k in (0, 1))
    return low + (place - i) * (high - low)
