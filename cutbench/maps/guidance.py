"""From a map to a decision: a material's regime, how far the other is, and which change gets it there.

The margins of a map's runs are put through the same Gaussian process that seeks boundaries
(``cutbench.emulator``); a change of a material is a path over the map's axes, followed until the
process says that it has crossed. Without a map the runs that the package brings along serve as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.case.case import Case, load_case
from cutbench.case.model import levers
from cutbench.emulator import Atlas, NotInAtlas, shipped
from cutbench.emulator.atlas import depth_of, named, values_of
from cutbench.emulator.design_space import SIDES
from cutbench.maps.axes import Axis, places, values_on
from cutbench.maps.boundary import (
    NORMAL_QUANTILE,
    limited_slope,
    margin,
    margins_between,
    margins_by_atlas,
    spread_of,
)
from cutbench.maps.dataset import (
    LABELS,
    MapRow,
    axes_of,
    axis_of,
    case_on,
    physics_by_place,
    places_of,
    regime_of,
    row_of,
)
from cutbench.maps.marked_materials import differences
from cutbench.maps.uncertainty import MODEL, NUMERICS, log_ratio, total_change, uncertainty_strips, undecided
from cutbench.run.measures import ABRUPT, ABRUPT_DROP, SMOOTH, UNCUT, UNDECIDED
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

#: Largest factor that is tried, either way, and how many steps it is reached in.
_MAX_FACTOR, _STEPS = 100.0, 120
#: Most runs that the process is put through; of a larger map those nearest to the boundary.
_MAX_RUNS = 500


@dataclass(frozen=True)
class LeverChange:
    """One lever moved one way. Values in ``unit``; ``to`` is where the boundary is met, with 95 % between
    ``near`` and ``far`` (None: not sure before the map ends). ``at`` is a place beyond it on the map."""

    lever: str
    parameter: str
    unit: str
    now: float
    to: float
    near: float
    far: float | None
    at: dict[str, float]

    @property
    def factor(self) -> float:
        """``to`` over ``now``; inf from zero."""
        return self.to / self.now if self.now else math.inf

    @property
    def effort(self) -> float:
        """What changes are ranked by: the logarithm of the factor, either way."""
        return abs(math.log(self.factor)) if self.now else math.inf

    def text(self) -> str:
        """``speed 0.021 -> 0.0504 mm/s (x 2.4; 95 %: 0.045 to 0.058 mm/s)``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        far = "beyond what is known" if self.far is None else f"{self.far:.3g}{unit}"
        factor = f"x {self.factor:.3g}; " if self.now else ""
        return (
            f"{self.lever} ({self.parameter}) {self.now:.3g} -> {self.to:.3g}{unit}"
            f" ({factor}95 %: {self.near:.3g}{'' if self.far is not None else unit} to {far})"
        )


@dataclass(frozen=True)
class Guide:
    """Where a material is on a map and what moves it; ``changes`` soonest first, ``still`` the levers that
    do not cross within the map, with the reason."""

    material: str
    at: dict[str, float]
    regime: str
    sure: bool
    margin: float
    margin_sd: float
    changes: tuple[LeverChange, ...]
    still: dict[str, str]
    #: Why the regime is undecided, in words; empty if it is not.
    doubt: str = ""

    def text(self) -> str:
        """All of it in plain words."""
        places = ", ".join(f"{name} {value:.3g}" for name, value in self.at.items())
        sure = "sure at 95 %" if self.sure else "not sure at 95 %"
        lines = [
            f"{self.material} lies at {places}.",
            f"There cutting is {self.regime} ({sure}; margin {self.margin:.2f} +- {self.margin_sd:.2f}"
            " on a scale from -1, smooth, to 1, abrupt).",
        ]
        if self.doubt:
            lines.append(f"It is undecided: {self.doubt}.")
        other = SMOOTH if self.margin >= 0 else ABRUPT
        if self.changes:
            lines.append(f"What makes it {other}, soonest first:")
            lines += [f"  {n}. {change.text()}" for n, change in enumerate(self.changes, start=1)]
        else:
            lines.append(f"Nothing tried makes it {other} within what is known.")
        lines += [f"  {lever}: {reason}" for lever, reason in self.still.items()]
        return "\n".join(lines)


class AtlasReader:
    """The runs that the package brings along as a function of place, by group."""

    def __init__(self, atlas: Atlas, case: Case):
        """Of cuts as deep as ``case``, which lies ``at``. Raises NotInAtlas."""
        self._atlas, self._depth = atlas, depth_of(case)
        self.at = self.of(case)

    def of(self, case: Case) -> dict[str, float]:
        """Where a case is. Raises NotInAtlas."""
        return named(np.array(values_of(case)))

    def place(self, case: Case) -> dict[str, float] | None:
        """Where a case is; None where nothing is known of it."""
        try:
            return self.of(case)
        except NotInAtlas:
            return None

    def margin(self, at: list[dict[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Margin and its standard deviation (n,) at places; nan where nothing is cut."""
        depths = np.full(len(at), self._depth)
        estimates = self._atlas.measures(
            np.array([[place.get(s.name, math.nan) for s in SIDES] for place in at]), depths
        )
        mean, score, _ = margins_by_atlas(estimates, ABRUPT_DROP)
        return np.where(estimates.uncut(depths) > 0.5, np.nan, mean), spread_of(mean, score)


class MapReader:
    """A map as a function of place: margin and standard deviation between its runs."""

    def __init__(self, data: xr.Dataset, switched: dict[str, float] | None = None):
        """``switched``: the state of each axis that is a mechanism's switch. Raises BadInput if the map has
        too few runs there."""
        self.axes = [axis_of(data, name) for name in axes_of(data)]
        self.free = [axis for axis in self.axes if not axis.mechanism]
        at, values = places_of(data), margins_of(data)
        keep = np.isfinite(values)
        for name, state in (switched or {}).items():
            keep &= at[name] == state
        if keep.sum() < 4:
            raise BadInput("map", data.attrs["title"], "at least 4 runs that reached their depth")
        self._of = {axis.name: _unit_coordinate(axis) for axis in self.free}
        x, y = self._coordinates({name: along[keep] for name, along in at.items()}), values[keep]
        if y.size > _MAX_RUNS:
            nearest = np.argsort(np.abs(y), kind="stable")
            chosen = np.sort(
                np.concatenate([nearest[: _MAX_RUNS // 2], nearest[_MAX_RUNS // 2 :: 7][: _MAX_RUNS // 2]])
            )
            x, y = x[chosen], y[chosen]
        self._between = margins_between(x, limited_slope(x, y))

    def place(self, case: Case) -> dict[str, float] | None:
        """Where a case is; None off the map."""
        at, _ = values_on(self.axes, case)
        return at if self.inside(at) else None

    def inside(self, at: dict[str, float]) -> bool:
        """Whether a place is on the map."""
        return all(-1e-3 <= self._of[a.name](np.array(at[a.name])) <= 1 + 1e-3 for a in self.free)

    def _coordinates(self, at: Mapping[str, np.ndarray]) -> np.ndarray:
        """Places, by axis, in the unit box (n, d)."""
        return np.stack([self._of[axis.name](at[axis.name]) for axis in self.free], axis=1)

    def margin(self, at: list[dict[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Margin and its standard deviation (n,) at places."""
        x = self._coordinates({axis.name: np.array([p[axis.name] for p in at]) for axis in self.free})
        return self._between.mean(x), self._between.spread(x)


Reader = AtlasReader | MapReader


def margins_of(data: xr.Dataset) -> np.ndarray:
    """The margin of each point of a map; nan where no run reached its depth."""
    uncut = data["label"].values == LABELS.index(UNCUT)
    margins = margin(
        data["drop_rel"].values, data["surge"].values, uncut,
        drop=data.attrs["drop_threshold"], surge_min=data.attrs["surge_threshold"],
    )  # fmt: skip
    return np.where(data["label"].values == 0, np.nan, margins)


def guide(data: xr.Dataset, material: str) -> Guide:
    """Find what would move a material, a known name or a case file, across the boundary that a map has.
    Raises BadInput if it has no place on the map, or the map too few runs."""
    case = load_case(material)
    axes = [axis_of(data, name) for name in axes_of(data)]
    at, missing = values_on(axes, case)
    if missing:
        raise BadInput("--material", material, f"a material that has a value of {', '.join(missing)}")
    reader = MapReader(data, {a.name: at[a.name] for a in axes if a.mechanism})
    if not reader.inside(at):
        ranges = ", ".join(
            f"{a.name} {a.values[0]:.3g} to {a.values[-1]:.3g} (it has {at[a.name]:.3g})" for a in reader.free
        )
        raise BadInput("--material", material, f"a material within the map: {ranges}")
    by_map, differs = _guide(reader, case, at), differences(physics_by_place(data)(at), case)
    doubt = _undecided_reason(data, by_map.margin)
    if differs:
        doubt = f"what the map does not vary is another for this material, {differs}"
    return replace(
        by_map, regime=UNDECIDED if doubt else by_map.regime, sure=by_map.sure and not doubt, doubt=doubt
    )


def guide_by_atlas(material: str | Case) -> Guide:
    """Find what would move a material, a known name, a case file or a case, across the boundary by the runs
    that the package brings along. Raises NotInAtlas if they say nothing of it, BadInput if it is not cut at
    its depth."""
    case = material if isinstance(material, Case) else load_case(material)
    reader = AtlasReader(shipped(), case)
    if np.isnan(reader.margin([reader.at])[0][0]):
        raise BadInput("depth", f"{case.values['depth']:g} mm", "a depth at which the material is cut")
    return _guide(reader, case, reader.at)


def _guide(reader: Reader, case: Case, at: dict[str, float]) -> Guide:
    (mean,), (spread,) = reader.margin([at])
    changes, still = [], {}
    for lever, parameter in levers().items():
        if parameter not in case.values:
            still[lever] = f"its model has no {parameter}"
            continue
        ways = [_change_along_lever(reader, case, lever, parameter, way, mean >= 0) for way in (1, -1)]
        moved = [change for change in ways if isinstance(change, LeverChange)]
        changes += moved
        if not moved:
            still[lever] = str(max(ways, key=lambda reason: len(str(reason))))
    changes.sort(key=lambda change: (change.effort, change.to))
    sure = bool(abs(mean) > NORMAL_QUANTILE * spread)
    side = ABRUPT if mean >= 0 else SMOOTH
    return Guide(case.name, at, side, sure, float(mean), float(spread), tuple(changes), still)


def _undecided_reason(data: xr.Dataset, margin: float) -> str:
    """Which of a map's strips a margin lies in, and what that means; empty if in none."""
    strips, r = uncertainty_strips(data), log_ratio(margin)
    low, high = total_change(strips.values())
    if not undecided(r, low, high):
        return ""
    words = {NUMERICS: "the numerics", MODEL: "what the model leaves open"}
    alone = [words[cause] for cause, strip in strips.items() if undecided(r, strip.low, strip.high)]
    threshold = data.attrs["drop_threshold"]
    drops = [100 * threshold * math.exp(r + change) for change in (low, 0.0, high)]
    return (
        f"{' or '.join(alone) or ' and '.join(words.values())} may turn it (a drop of {drops[1]:.2g} %,"
        f" {drops[0]:.2g} to {drops[2]:.2g} % with all that; abrupt begins at {100 * threshold:g} %)"
    )


def _change_along_lever(
    reader: Reader, case: Case, lever: str, parameter: str, way: int, abrupt: bool
) -> LeverChange | str:
    """Move one parameter until the regime changes; or why it does not."""
    quantity = case.model.parameters()[parameter]
    now = case.values[parameter] / quantity.factor
    if now:
        values = now * np.geomspace(1, _MAX_FACTOR, _STEPS) ** way
    elif way > 0:
        values = np.concatenate([[0.0], quantity.typical * np.geomspace(1e-3, 1e4, _STEPS)])
    else:
        return "it is 0 already"
    path: list[dict[str, float]] = []
    for value in map(float, values):
        try:
            # Bounds, and what one value rules out in another: no such material.
            moved = case.set(**{parameter: value if quantity.unit == "1" else f"{value!r} {quantity.unit}"})
        except BadInput:
            break
        place = reader.place(moved)
        if place is None:
            break
        path.append(place)
    if len(path) < 2:
        return "what is known ends here"
    if all(math.isclose(path[0][name], path[-1][name], rel_tol=1e-9, abs_tol=1e-12) for name in path[0]):
        return "nothing that is varied depends on it"
    mean, spread = reader.margin(path)
    if not np.isfinite(mean).all():
        path = path[: int(np.isnan(mean).argmax())]
        mean, spread = mean[: len(path)], spread[: len(path)]
    side = mean if abrupt else -mean
    crossed = np.flatnonzero(side < 0)
    if crossed.size == 0:
        end = f"{'up' if way > 0 else 'down'} to {values[len(path) - 1]:.3g} {quantity.unit}"
        return f"{end}, the end of what is known, it does not cross"
    k = int(crossed[0])
    j = max(k - 1, 0)
    part = side[j] / (side[j] - side[k]) if k > j else 0.0
    to = float(values[j] + part * (values[k] - values[j]))
    doubtful = np.flatnonzero(np.abs(mean) < NORMAL_QUANTILE * spread)
    near = min(doubtful[0], k) if doubtful.size else k
    sure = np.flatnonzero((side < -NORMAL_QUANTILE * spread) & (np.arange(side.size) >= k))
    far = int(sure[0]) if sure.size else None
    beyond = min((far if far is not None else len(path) - 1) + 2, len(path) - 1)
    return LeverChange(
        lever, parameter, quantity.unit, float(now), to, float(values[max(near - 1, 0)]),
        None if far is None else float(values[far]), path[beyond],
    )  # fmt: skip


@dataclass(frozen=True)
class CheckedChange:
    """A change tried by runs: the material's own place on the map, and the place beyond the boundary."""

    before: MapRow
    after: MapRow
    #: Where, and what is changed from what to what.
    tried: str = ""

    @property
    def crosses(self) -> bool:
        """Whether the two runs are of different regimes."""
        return {self.before.label, self.after.label} == {ABRUPT, SMOOTH}

    def text(self) -> str:
        """In words, with the two drops."""
        drops = [f"{row.label} (drop {row.measures['drop_rel']:.3g})" for row in (self.before, self.after)]
        verdict = "it crosses" if self.crosses else "it does NOT cross"
        tried = f" {self.tried}" if self.tried else ""
        runs = f"checked by two runs of the map's own case{tried}"
        return f"{runs}: {drops[0]} before, {drops[1]} after: {verdict}"


def check(
    data: xr.Dataset, guided: Guide, runs: str | Path, run: Callable[[Case], Result] | None = None
) -> CheckedChange:
    """Run the map's case at the material's place and after the first change; they go into the store ``runs``.

    Raises BadInput if there is no change to check, or the map is of numerics that are no longer there.
    """
    from cutbench.run.pool.worker import computed

    if not guided.changes:
        raise BadInput("--check", guided.material, "a material that a change moves across")
    at = guided.at, guided.changes[0].at
    cases = [case_on(data, each) for each in at]
    store, rows = Store(runs), []
    for case in cases:
        result = store.get(case.id)
        if result is None:
            result = computed(run, case)
            store.put(result)
        rows.append(row_of(result, regime_of(data)))
    first, then = (", ".join(f"{name} {value:.4g}" for name, value in each.items()) for each in at)
    (a, b), parameters = (case.values for case in cases), cases[0].model.parameters()
    changed = [(n, parameters[n]) for n in a if n in parameters and a[n] != b[n]]
    moved = [f"{n} {q.show(a[n])} and {q.show(b[n])}" for n, q in changed]
    before, after = rows
    return CheckedChange(before, after, f"at {first} and at {then} ({', '.join(moved)})")


def _unit_coordinate(axis: Axis) -> Callable[[np.ndarray], np.ndarray]:
    """An axis' values as 0 to 1. Listed levels that grow by ratios count by ratios, zero among them."""
    low, high = axis.values[0], axis.values[-1]
    if high == low:
        return lambda v: 0 * np.asarray(v) + (np.asarray(v) != low) * 2.0  # only this value is on the map
    steps = np.diff(axis.values)
    if axis.scale == "log" or len(axis.values) < 3 or steps.max() < 1.5 * steps.min():
        return lambda v: places(v, low, high, axis.scale)
    small = min(abs(v) for v in axis.values if v)
    ends = np.arcsinh(np.array([low, high]) / small)
    return lambda v: (np.arcsinh(np.asarray(v) / small) - ends[0]) / (ends[1] - ends[0])
