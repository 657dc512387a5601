"""Runs that the package brings along, and what they say of a case that was not computed.

All blades in all neo-Hookean gels are samples of one function of some dozen dimensionless groups (see
``cutbench.emulator.groups``). The atlas has runs that fill boxes of these groups, one for ellipses, one for
wedges, one for wires; the emulator says what lies between them, and how surely. It is an estimate of a run at
the default numerics, whatever code computes that.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.special import ndtr

from cutbench.base.display import Displayed
from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.case.motion import TRANSITION as UNTIL
from cutbench.case.values import CLAMP
from cutbench.emulator.alignment import AlignedCurves, Course, Curves
from cutbench.emulator.design_space import BLADES, COMMON, MAX_DEPTH, SIDES, DesignSpace
from cutbench.emulator.gaussian_process import GaussianProcess, Kernel
from cutbench.emulator.groups import Groups, is_same_value
from cutbench.emulator.settings import SETTINGS
from cutbench.run.measures import (
    ABRUPT,
    ABRUPT_DROP,
    BLUR,
    KNOWN,
    PROMINENCE,
    SETTLED,
    SMOOTH,
    TAIL,
    TRANSITION,
    UNCUT,
)

#: The blade's thickness, in halves of it: the window of a drop.
DROP_WINDOW = 2.0
#: What an estimate has intervals of, and their units.
MEASURES = {"onset_mm": "mm", "peak_N": "N", "drop": "", "steady_N": "N"}
#: The measures that have a process of their own beside those of the curves.
MEASURES_WITH_PROCESS = ("peak", "drop", "steady", "slope")


class NotInAtlas(BadInput):
    """This error says that a case lies outside the ranges of an atlas, or that its model has none."""


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


@dataclass(frozen=True, repr=False)
class Estimate(Displayed):
    """An estimate says what a run of a case would give, interpolated between earlier runs.

    Attributes
    ----------
    case : Case
        The case.
    x_mm : ndarray, shape (k,), mm
        Travel of the blade.
    force_N : ndarray, shape (k,), N
        Force on the blade.
    low_N : ndarray, shape (k,), N
        The low end of its 90 % interval.
    high_N : ndarray, shape (k,), N
        The high end.
    onset_mm : Interval, mm
        Travel at which the cut begins, as ``cutbench.run.measures`` has it and all that follow.
    peak_N : Interval, N
        The first prominent force maximum.
    drop : Interval
        The relative fall of the force at the transition.
    steady_N : Interval, N
        The force of steady cutting.
    chances : mapping of str to float
        Probabilities of ``abrupt``, ``smooth`` and ``uncut``, in sum 1.
    work : mapping of str to ndarray, shape (k,)
        By mechanism, the part that it took of the blade's work until then.
    nearest : tuple of (float, mapping)
        Groups of the nearest runs, with their distances in lengths along which the onset changes.

    Examples
    --------
    >>> import cutbench
    >>> found = cutbench.estimate("gelatin")
    >>> found.verdict, found.chance > 0.5
    ('abrupt', True)
    >>> found.onset_mm.low < found.onset_mm.value < found.onset_mm.high
    True
    """

    display_module: ClassVar[str] = "cutbench.emulator.display"

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
        """Say the verdict in words.

        Returns
        -------
        str
            One sentence without a full stop.
        """
        chance = "as good as sure" if self.chance > 0.99 else f"{100 * self.chance:.0f} % likely"
        if self.verdict == UNCUT:
            return f"uncut, {chance}: the cut does not begin within {self.x_mm[-1]:.3g} mm"
        begins = f"the cut begins at {self.onset_mm:.3g} mm"
        return f"{self.verdict}, {chance}: {begins}, the force falls by {self.drop:.2f}"

    def lines(self) -> list[tuple[str, str]]:
        """Say all there is to say, each under its name, the verdict first.

        Returns
        -------
        list of (str, str)
            Name and text.
        """
        measures = [(name.removesuffix(f"_{unit}"), f"{getattr(self, name):.3g} {unit}".strip())
                    for name, unit in MEASURES.items()]  # fmt: skip
        found = [("verdict", self.sentence()), *measures]
        if self.verdict == UNCUT and (held := held_by_friction(self.case)):
            found.append(("friction", held))
        far, groups = self.nearest[0]
        near = ", ".join(f"{name} {value:.3g}" for name, value in groups.items())
        return [*found, ("nearest run", f"{far:.2g} lengths away: {near}")]


@dataclass(frozen=True)
class Measures:
    """Measures at p places, in the atlas' units, each as the mean and the standard deviation (p, 2) of what
    is normal: the logarithms of onset, peak and steady force, the root of the drop, and the slope of the
    steady force; ``middle`` (p,) of the travel over which that is steady."""

    onset: np.ndarray
    peak: np.ndarray
    drop: np.ndarray
    steady: np.ndarray
    slope: np.ndarray
    middle: np.ndarray

    def uncut(self, depths: np.ndarray) -> np.ndarray:
        """Probability (p,) that the cut does not begin within depths (p,)."""
        mean, sd = self.onset.T
        return ndtr((mean - np.log(depths)) / sd)

    def falls(self, drop: float) -> np.ndarray:
        """How many standard deviations (p,) the drop lies above one."""
        mean, sd = self.drop.T
        return (mean - math.sqrt(drop)) / sd

    def chances(self, depths: np.ndarray) -> dict[str, np.ndarray]:
        """Probabilities (p,) of the regimes of cuts to depths (p,), in sum 1."""
        uncut = self.uncut(depths)
        abrupt = (1 - uncut) * ndtr(self.falls(ABRUPT_DROP))
        return {ABRUPT: abrupt, SMOOTH: 1 - uncut - abrupt, UNCUT: uncut}

    def intervals(self, ends: np.ndarray, half: Any, force: Any, precut: Any) -> dict[str, np.ndarray]:
        """What ``MEASURES`` names, each as value, low and high end (3, p), nan where a cut has none of it.
        With the ends (p,) of the runs; numbers or (p,): units of length and force, slits before the cut."""
        onset = self.onset[:, 0]
        cut, long = np.exp(onset) < ends, ends - np.exp(onset) > (SETTLED + 1) * DROP_WINDOW
        falls = (self.drop[:, 0] ** 2 > PROMINENCE) & (np.asarray(precut) == 0)
        found = {}
        for name, unit, there in (
            ("onset_mm", half, cut), ("peak_N", force, cut & falls), ("drop", 1.0, cut),
            ("steady_N", force, cut & long),
        ):  # fmt: skip
            mean, sd = getattr(self, name.partition("_")[0]).T
            normal = mean + SETTINGS.quantile * np.array([[0], [-1], [1]]) * sd
            value = np.clip(normal, 0, 1) ** 2 if name == "drop" else np.exp(normal) * unit
            found[name] = np.where(there, value, np.nan)
        return found


class Atlas:
    """An atlas holds runs over ranges of dimensionless groups, and says what lies between them. With
    ``groups`` (n, d), nan where a blade has none of ``SIDES``, ``measured`` (n,)."""

    def __init__(
        self,
        groups: np.ndarray,
        courses: Sequence[Course],
        measured: Mapping[str, np.ndarray],
        cumulative_work: Mapping[str, Sequence[np.ndarray]] | None = None,
        kernels: Mapping[str, Kernel | None] | None = None,
        wider: Mapping[str, float] | None = None,
        about: Mapping[str, Any] | None = None,
    ):
        self.groups, self.courses, self.measured = groups, courses, measured
        self.cumulative_work, self.wider, self.about = cumulative_work or {}, wider or {}, about or {}
        self.X, known = self.coordinates(groups), kernels or {}
        rise = np.linspace(0, MAX_DEPTH, SETTINGS.intervals + 1)
        self.curves = AlignedCurves(self.X, courses, rise, np.array(SETTINGS.travels), known)
        onsets, ends = (np.array([getattr(c, n) for c in courses]) for n in ("onset", "end"))
        self._own = {}
        for name in MEASURES_WITH_PROCESS:
            usual, values = self._usual(name, groups, onsets, ends), measured[name]
            with np.errstate(invalid="ignore", divide="ignore"):
                logarithm = np.log(np.where(values > 0, values, np.nan)) - np.log(usual)
            # What is normal of a measure: see Measures.
            values = np.sqrt(values) if name == "drop" else values / usual if name == "slope" else logarithm
            there = np.isfinite(values)
            self._own[name] = GaussianProcess(self.X[there], values[there], kernel=known.get(name))

    @property
    def kernels(self) -> dict[str, Kernel | None]:
        """The kernels of all processes, by name."""
        return self.curves.kernels | {name: made.kernel for name, made in self._own.items()}

    @classmethod
    def read(cls, file: Any, *, fitted: bool = True) -> Atlas:
        """Read an atlas from a file that ``write`` made, with its kernels or with new ones."""
        with np.load(file) as data:
            about = json.loads(str(data["about"]))
            ends = np.cumsum(data["sizes"])[:-1]
            x, force = (np.split(data[name].astype(float), ends) for name in ("x", "force"))
            work = [np.split(each.astype(float), ends) for each in data["work"].T]
            cumulative_work = dict(zip(about["works"], work, strict=True))
            onset = data["onset"].astype(float).tolist()
            courses = [Course(a, b, at) for a, b, at in zip(x, force, onset, strict=True)]
            measured = {name: data[name].astype(float) for name in MEASURES_WITH_PROCESS}
            kernels = {n: k and Kernel(tuple(k["lengths"]), k["nugget"])
                       for n, k in about["kernels"].items() if fitted}  # fmt: skip
            groups = data["groups"].astype(float)
            return cls(groups, courses, measured, cumulative_work, kernels, about["wider"], about)

    def write(self, file: Path, about: Mapping[str, Any]) -> None:
        """Write the atlas into a file."""
        kernels = {n: k and {"lengths": k.lengths, "nugget": k.nugget} for n, k in self.kernels.items()}
        record = {**about, "works": [*self.cumulative_work], "kernels": kernels, "wider": {**self.wider}}
        arrays = {
            "groups": self.groups, "x": np.concatenate([c.x for c in self.courses]),
            "force": np.concatenate([c.force for c in self.courses]),
            "onset": np.array([c.onset for c in self.courses]),
            "work": np.stack([np.concatenate(each) for each in self.cumulative_work.values()], axis=1),
            **self.measured,
        }  # fmt: skip
        small: dict[str, Any] = {name: each.astype(np.float32) for name, each in arrays.items()}
        small["sizes"] = np.array([c.x.size for c in self.courses])
        np.savez_compressed(file, about=np.array(json.dumps(record)), **small)

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Places (n, d) of rows of groups."""
        by_name = self._by_name(values)
        columns = {side.name: side.coordinate(by_name[side.name]) for side in COMMON}
        # How fast a blade opens the cut is a matter of its own width: η v/a is smoother than η v/δ_c, and
        # hardly matters below a twentieth.
        columns["viscosity"] = np.arcsinh(by_name["viscosity"] * by_name["delta_c"] / 0.05)
        # What adheres deforms the gel: τ_W/G, hardly below a fifth.
        columns["adhesion"] = np.arcsinh(by_name["adhesion"] * by_name["cohesion"] / 0.2)
        # Blades of all kinds are told apart by what they share, a radius of the edge and a length over which
        # they widen, and by which kind they are; a slit, which they fall into, is of a kind, too.
        ellipse, wedge = np.isfinite(by_name["tip"]), np.isfinite(by_name["angle"])
        with np.errstate(invalid="ignore"):
            edge = np.where(ellipse, 1 / by_name["tip"], by_name["edge_radius"])
            taper = np.where(ellipse, by_name["tip"], 1 / np.tan(by_name["angle"] / 2))
        shape = [np.where(ellipse | wedge, each, 1.0) for each in (edge, taper)]
        shape.append(np.where(wedge, by_name["shoulder"], 1.0))
        kinds = [each.astype(float) for each in (wedge, ~ellipse & ~wedge, by_name["precut"] > 0)]
        return np.stack([*columns.values(), *np.log(shape), *kinds], axis=1)

    def _by_name(self, values: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip([side.name for side in SIDES], values.T, strict=True))

    def _usual(self, name: str, groups: np.ndarray, onset: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """About what (n,) a measure is: of the peak, the force that rises with the travel to the onset; of
        what is steady, the force that cutting at a steady pace takes (Atkins 2009, The Science and
        Engineering of Cutting): the toughness with its viscous part, and adhesion along both faces, at the
        middle of the travel where it is measured."""
        if name in ("peak", "drop"):
            return onset if name == "peak" else np.ones(len(onset))
        g = self._by_name(groups)
        toughness = g["cohesion"] * g["delta_c"] * (1 + g["viscosity"])
        return toughness + g["adhesion"] * g["cohesion"] * self._middle(groups, onset, depth)

    def _middle(self, groups: np.ndarray, onset: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The middle (n,) of the travel over which a force counts as steady."""
        end = np.minimum(depth, self._by_name(groups)["height"] - CLAMP * DROP_WINDOW)
        start = np.maximum((1 - TAIL) * end, onset + SETTLED * DROP_WINDOW)
        return (start + np.maximum(end, start)) / 2

    def _widening(self, name: str, groups: np.ndarray) -> np.ndarray:
        """By what intervals (n,) are wider than the processes say, for each kind of blade."""
        ellipse, wedge = (np.isfinite(self._by_name(groups)[side]) for side in ("tip", "angle"))
        factors = [self.wider.get(f"{blade} {name}", 1.0) for blade in ("contact", "wedge", "wire")]
        return np.where(ellipse, factors[0], np.where(wedge, factors[1], factors[2]))

    # -- what it says ---------------------------------------------------------------------------------
    def measures(self, groups: np.ndarray, depths: np.ndarray, spread: bool = True) -> Measures:
        """Estimate the measures of runs that were not computed, with their ``spread`` or without. With
        ``groups`` (p, d), ``depths`` (p,)."""
        places = self.coordinates(groups)
        onset = np.stack(self.curves.log_onset(places, spread), axis=1)
        onset[:, 1] *= self._widening("onset", groups)
        at, found = np.exp(onset[:, 0]), {"onset": onset}
        for name in MEASURES_WITH_PROCESS:
            made = self._own[name]
            mean = made.mean(places)
            sd = self._widening(name, groups) * (made.spread(places, runs=True) if spread else 0.0)
            usual = self._usual(name, groups, at, depths)
            mean, sd = (mean * usual, sd * usual) if name == "slope" else (mean + np.log(usual), sd)
            if name == "peak":
                sd = np.hypot(sd, onset[:, 1])  # the force rises with the travel to the onset
            found[name] = np.stack([mean, sd], axis=1)
        return Measures(**found, middle=self._middle(groups, at, depths))

    def estimate(self, case: Case) -> Estimate:
        """Estimate what a run of a case would give. Raises NotInAtlas."""
        groups, (_, units) = np.array([values_of(case)]), space_of(case)
        half, force, depth = units.length(case.values), units.force(case.values), depth_of(case)
        m, place = self.measures(groups, np.array([depth])), self.coordinates(groups)
        onset = float(np.exp(m.onset[0, 0]))
        end = min(depth, onset + (KNOWN if case.until == UNTIL else math.inf) * DROP_WINDOW)
        x = np.linspace(0, end, 161)
        low, middle, high = force * self.band(groups, m, x)
        found = m.intervals(np.array([end]), half, force, case.values["precut"]).items()
        kernel = self.curves.kernels["onset"]
        assert kernel is not None, "enough cuts begin"
        far = kernel.distances(place, self.X)[0]
        return Estimate(
            case, x * half, middle, low, high, **{n: Interval(*each[:, 0].tolist()) for n, each in found},
            chances={n: float(each[0]) for n, each in m.chances(np.array([depth])).items()},
            work=self._shares(place, x, onset),
            nearest=tuple((float(far[i]), named(self.groups[i])) for i in np.argsort(far)[:3]),
        )  # fmt: skip

    def drawn(self, groups: np.ndarray, m: Measures, x: np.ndarray) -> np.ndarray:
        """Draw curves (s, k) at the travels ``x`` that runs may have; the first is the one that has the
        measures ``m``. With ``groups`` (1, d)."""

        def normal(part: int, r: int) -> np.ndarray:
            half = np.random.default_rng(part).standard_normal((SETTINGS.draws // 2, r))
            drawn = self._widening("curve", groups)[0] * np.concatenate([half, -half])
            return np.concatenate([np.zeros((1, r)), drawn])  # the first is the mean

        drawn = self.curves.draws(self.coordinates(groups), normal)
        onset, before, after = (each[0] for each in drawn)
        # Curves have the first numbers of random draws.
        levels, slopes = (getattr(m, n)[0] @ [np.ones(len(onset)), normal(part, 1)[:, 0]]
                          for part, n in ((100, "steady"), (101, "slope")))  # fmt: skip
        # All are bent as the mean is.
        after = after * (_falling(onset[:1], before[:1], after[:1], m.drop[:, 0]) / after[0])
        middle = np.broadcast_to(m.middle, onset.shape)
        return joined(np.tile(x, (len(onset), 1)), onset, before, after, levels, slopes, middle)

    def band(self, groups: np.ndarray, m: Measures, x: np.ndarray) -> np.ndarray:
        """Compute the force along the travel that has the measures ``m``, and its 90 % interval. With
        ``groups`` (1, d), ``x`` (k,); gives low, middle and high (3, k)."""
        curves = self.drawn(groups, m, x)
        ends = np.quantile(curves[1:], [(1 - SETTINGS.level) / 2, (1 + SETTINGS.level) / 2], axis=0)
        return np.array([np.minimum(ends[0], curves[0]), curves[0], np.maximum(ends[1], curves[0])])

    def forces(self, groups: np.ndarray, m: Measures, x: np.ndarray) -> np.ndarray:
        """Compute the forces (p, k) that have the measures ``m``, at travels of their own. With ``groups``
        (p, d), ``x`` (p, k)."""
        onset, before, after = self.curves.parts(self.coordinates(groups))
        falling = _falling(onset, before, after, m.drop[:, 0])
        return joined(x, onset, before, falling, m.steady[:, 0], m.slope[:, 0], m.middle)

    def _shares(self, place: np.ndarray, x: np.ndarray, onset: float) -> dict[str, np.ndarray]:
        """By mechanism, the part (k,) of the work until travels (k,)."""
        shares = np.maximum(self._work.mean(place)[0].reshape(-1, len(self.cumulative_work)), 0.0)
        shares /= shares.sum(axis=1, keepdims=True)
        at = stations(onset)
        return {n: np.interp(x, at, share) for n, share in zip(self.cumulative_work, shares.T, strict=True)}

    @cached_property
    def _work(self) -> Curves:
        """Of the parts of the work at stations of the way, mechanism by mechanism."""
        rows = []
        for run, course in enumerate(self.courses):
            works = np.stack([each[run] for each in self.cumulative_work.values()], axis=1)
            onset = course.onset if math.isfinite(course.onset) else course.x[-1]
            at = stations(onset)
            taken = np.stack([np.interp(at, course.x, w) for w in works.T], axis=1)
            taken /= taken.sum(axis=1, keepdims=True)
            taken[at > course.x[-1] * (1 + 1e-9)] = np.nan
            rows.append(taken.ravel())
        return Curves(self.X, np.array(rows), self.curves.kernels["before"])


def stations(onset: float) -> np.ndarray:
    """The travels at which the work is told apart by mechanism: parts of the way to the onset, and beyond."""
    return np.append(onset * np.array([0.2, 0.5, 0.8, 1.0]), onset + np.array([1.0, 3.0, 6.0, 10.0, 20.0]))


def depth_of(case: Case) -> float:
    """How deep a case cuts, in halves of the blade's thickness, as far as the atlas goes."""
    return min(case.values["depth"] / (case.values["thickness"] / 2), MAX_DEPTH)


def named(row: np.ndarray) -> dict[str, float]:
    """By name what a row of groups has, without the sides of other blades."""
    return {s.name: float(v) for s, v in zip(SIDES, row, strict=True) if math.isfinite(v)}


def row_of(space: DesignSpace, values: Sequence[Any]) -> list[Any]:
    """A row of all sides, of values of those of a space."""
    known = dict(zip([side.name for side in space.ranges], values, strict=True))
    return [known.get(side.name, math.nan) for side in SIDES]


def space_of(case: Case) -> tuple[DesignSpace, Groups]:
    """The design space of a case's blade and model, and its units. Raises NotInAtlas where there is none."""
    tool = case.model.tool
    if tool is None or tool.name not in BLADES:
        raise NotInAtlas("mechanisms", tool.name if tool else "none", f"a blade of {', '.join(BLADES)}")
    space = BLADES[tool.name]
    base, of = space.base, space.parameters
    # A side that begins at 0 does so where a law has no effect: a case may lack it.
    switched = {of[s.name] for s in space.ranges if s.low == 0}
    strange = [law.name for law in case.model.all if law.name not in base.mechanisms]
    missing = [
        law.name
        for law in base.model.all
        if law.name not in case.mechanisms and not switched & {q.name for q in law.parameters}
    ]
    if strange or missing or case.dim != base.dim or case.motion:
        what = ", ".join(strange or missing) or ("3D" if case.dim != base.dim else "motion")
        raise NotInAtlas("mechanisms", what, "the default model of a section, cut at one speed")
    units = Groups.of(case)
    if units is None:
        raise NotInAtlas("speed", f"{case.values['speed']:g} mm/s", "a blade that moves")
    reduced, at_base = units.reduced(case.values), units.reduced(base.values)
    for name, value in reduced.items():
        if name not in {*of.values(), units.modulus} and not is_same_value(value, at_base[name]):
            q = base.model.parameters()[name]
            raise NotInAtlas(name, q.show(case.values[name]), f"{q.show(base.values[name])}, as in the atlas")
    return space, units


def values_of(case: Case, *, checked: bool = True) -> list[float]:
    """The row of a case, of whatever size. Raises NotInAtlas where a ``checked`` one lies outside."""
    space, units = space_of(case)
    found = [float(v) for v in space.of_values(units, case.model, case.values)]
    for side, value in space.beyond(found) if checked else ():
        raise NotInAtlas(*space.outside(side, value, case))
    return row_of(space, found)


@cache
def shipped() -> Atlas:
    """Return the atlas that the package brings along."""
    return Atlas.read(files("cutbench.emulator") / "atlas.npz")


def held_by_friction(case: Case) -> str:
    """Of a blade that does not cut: what it would do without friction, in a sentence; empty where that is the
    same, or not known."""
    names = [law.name for law in case.model.laws("blade") if law.role == "friction"]
    if not names:
        return ""
    with suppress(BadInput):
        free = shipped().estimate(case.set(without=names))
        if free.verdict != UNCUT:
            onset = f"{free.onset_mm:.3g} mm, as the atlas has it"
            return f"Held by friction: without {' and '.join(names)} the cut begins at {onset}."
    return ""


def _at(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """What lies between rows of values (p, n), at fractions of their numbers (p, k)."""
    first = np.clip(index.astype(int), 0, values.shape[1] - 2)
    low, high = (np.take_along_axis(values, first + step, axis=1) for step in (0, 1))
    return low + (index - first) * (high - low)


def _through(beyond: np.ndarray, onset: np.ndarray, rising: np.ndarray, later: np.ndarray) -> np.ndarray:
    """The force at travels ``beyond`` the onset (p, k), up to it and through the transition; 0 before the
    blade touches. With ``onset`` (p,), ``rising`` (p, n), ``later`` (p, m)."""
    onset = onset[:, None]
    part = np.clip(1 + beyond / onset, 0.0, 1.0) * (rising.shape[1] - 1)
    knots = np.interp(beyond, SETTINGS.travels, np.arange(len(SETTINGS.travels)))
    return np.where(beyond <= 0, _at(rising, part), _at(later, knots))


def joined(
    x: np.ndarray, onset: np.ndarray, rising: np.ndarray, later: np.ndarray, level: np.ndarray,
    slope: np.ndarray, middle: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """The forces (p, k) at travels ``x`` (p, k): up to the onset, through the transition, and from there over
    into the line of steady cutting, whose logarithm is ``level`` (p,) in the ``middle`` (p,)."""
    beyond = x - onset[:, None]
    force = _through(beyond, onset, rising, later)
    part = np.clip((beyond / DROP_WINDOW - KNOWN) / (SETTLED - KNOWN), 0.0, 1.0)
    line = np.exp(level)[:, None] + slope[:, None] * (x - middle[:, None])
    return force + part * (np.maximum(line, 0.0) - force)


def _falling(onset: np.ndarray, rising: np.ndarray, later: np.ndarray, root_drop: np.ndarray) -> np.ndarray:
    """Curves (p, m) beyond their onsets, whose falls are made larger or smaller until they fall by a drop,
    ``root_drop`` (p,), much as ``cutbench.run.measures`` has it."""
    spacing = BLUR * DROP_WINDOW / SETTINGS.blurs
    window, half = round(DROP_WINDOW / spacing), SETTINGS.blurs // 2
    beyond = spacing * np.arange(-window - half, round(KNOWN * window) + 1)
    counts = (beyond <= TRANSITION * DROP_WINDOW)[half:-half]
    there = np.broadcast_to(beyond, (len(onset), beyond.size))
    highest, part, found = np.maximum.accumulate(later, axis=1), np.ones((len(onset), 1)), later
    for _ in range(SETTINGS.bendings):
        force = _through(there, onset, rising, found)
        total = np.cumsum(force[:, 1:] + force[:, :-1], axis=1) / (2 * SETTINGS.blurs)
        total = np.pad(total, ((0, 0), (1, 0)))
        mean = total[:, 2 * half :] - total[:, : -2 * half]
        low = minimum_filter1d(mean, window + 1, axis=1, mode="nearest", origin=-(window // 2))
        seen = counts & (mean > 0)
        falls = np.max(np.divide(mean - low, mean, out=np.zeros_like(mean), where=seen), axis=1)[:, None]
        wanted = np.maximum(root_drop[:, None], 0.0) ** 2
        part = part * np.divide(wanted, falls, out=np.ones_like(falls), where=falls > 0)
        found = np.maximum(highest + part * (later - highest), 0.0)
    return found
