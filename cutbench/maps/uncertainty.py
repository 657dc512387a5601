"""How far a map's line may be off: runs beside it repeated with refined numerics, and over what the model
leaves open.

What a run says is the logarithm of its measure over the threshold, r (0 on the line; ``margin`` is tanh r).
Repeated with elements and steps half as large a run has another r: the changes of all that were repeated,
mean ± 1.96 standard deviations, are the numerics' strip. What ``cutbench.run.band`` would repeat of a run
gives a lowest and a highest r: their means over the runs that have it are the model's strip. Each strip holds
0, no change. A regime is undecided where r with the changes of both would have either sign.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from cutbench.case.case import Case
from cutbench.case.mesh_sizes import chosen, near_blade
from cutbench.case.model_alternatives import alternative_cases
from cutbench.maps.boundary import NORMAL_QUANTILE, Index

#: Of logarithms: a margin says no more.
MAX_LOG_RATIO = 2.0
NUMERICS, MODEL = "numerics", "model"
CAUSES = (NUMERICS, MODEL)
#: Variables of a map: what repeated runs say at their place.
RATIOS = ("refined_ratio", "band_low_ratio", "band_high_ratio")


def refined(case: Case) -> Case:
    """``case`` with elements on the cut plane and steps half as large; those under the tip stay."""
    n, tool = case.numerics, case.model.tool
    finer = n.finer(h=0.5, step=0.5, step_min=0.5, damage_step=0.5, energy_step=0.5)
    if tool is not None:
        thickness, h = case.p.thickness, case.sizes.h_mm
        corner = near_blade(n, thickness, tool.edge_radius(case.p))["corner"]
        shallow = chosen(n.shallow, h, thickness, n.tuning.mesh.shallow)
        finer = replace(finer, corner=min(2 * corner / h, 1.0), shallow=shallow)
    return replace(case, numerics=finer)


def log_ratio(margin: float) -> float:
    """r of a margin, between −``MAX_LOG_RATIO`` and that; nan of nan."""
    return float(np.clip(np.arctanh(np.clip(margin, -0.9999, 0.9999)), -MAX_LOG_RATIO, MAX_LOG_RATIO))


def _changes(r: Mapping[str, float], pairs: Iterable[tuple[str, str]]) -> list[float]:
    """Of r from a run to its repetition, where both have it."""
    changes = (r.get(other, math.nan) - r.get(id, math.nan) for id, other in pairs)
    return [change for change in changes if math.isfinite(change)]


@dataclass(frozen=True)
class UncertaintyStrip:
    """By how much r may change, ``low`` ≤ 0 ≤ ``high``, and how many runs say it; none: not known, 0."""

    low: float = 0.0
    high: float = 0.0
    runs: int = 0


@dataclass
class RepeatedRuns:
    """What is repeated of a map: the refined run of a run, and its runs with one thing changed; all ids."""

    refined: dict[str, str] = field(default_factory=dict)
    alternatives: dict[str, dict[str, str]] = field(default_factory=dict)

    def ask(self, cases: Mapping[str, Case], near: Sequence[str], runs: int, bands: int) -> list[Case]:
        """The cases to run for the ``runs`` first of ``near`` (ids), and of these the ``bands`` first."""
        asked = []
        for id in near[:runs]:
            asked.append(fine := refined(cases[id]))
            self.refined[id] = fine.id
        for id in near[:bands]:
            # A map of a gel without friction is one of frictionless cuts: with it there is another map.
            others = alternative_cases(cases[id], switching_on=False)[0]
            self.alternatives[id] = {name: other.id for name, other in others.items()}
            asked += others.values()
        return asked

    def numerics(self, r: Mapping[str, float]) -> UncertaintyStrip:
        """From r by id, of all runs that have ended."""
        changes = np.array(_changes(r, self.refined.items()))
        if not changes.size:
            return UncertaintyStrip()
        wide = NORMAL_QUANTILE * float(changes.std(ddof=1)) if changes.size > 1 else 0.0
        mean = float(changes.mean())
        return UncertaintyStrip(min(0.0, mean - wide), max(0.0, mean + wide), changes.size)

    def model(self, r: Mapping[str, float]) -> UncertaintyStrip:
        """Likewise, of what the model leaves open."""
        every = [
            _changes(r, ((id, other) for other in changed.values()))
            for id, changed in self.alternatives.items()
        ]
        ends = [(min(0.0, *changes), max(0.0, *changes)) for changes in every if changes]
        if not ends:
            return UncertaintyStrip()
        low, high = map(float, np.mean(ends, axis=0))
        return UncertaintyStrip(low, high, len(ends))


def nearest_to_boundary(r: Mapping[Index, float], panel: int | None) -> list[Index]:
    """Places by |r|, those of all levels of the axis ``panel`` in turn; none that says only its side."""
    near = sorted((i for i in r if abs(r[i]) < MAX_LOG_RATIO), key=lambda i: (abs(r[i]), i))
    if panel is None:
        return near
    levels = [[i for i in near if i[panel] == level] for level in sorted({i[panel] for i in near})]
    return [i for turn in itertools.zip_longest(*levels) for i in turn if i is not None]


def uncertainty_strips(data: xr.Dataset) -> dict[str, UncertaintyStrip]:
    """A map's strips by cause; nothing of maps without."""
    if "strip" not in data:
        return {}
    columns = data["cause"].values, data["strip"].values, data["strip_runs"].values
    return {
        cause: UncertaintyStrip(float(ends[0]), float(ends[1]), int(runs))
        for cause, ends, runs in zip(*columns, strict=True)
        if runs
    }


def total_change(strips: Iterable[UncertaintyStrip]) -> tuple[float, float]:
    """By how much r may change in all."""
    strips = list(strips)
    return sum(s.low for s in strips), sum(s.high for s in strips)


def undecided(r: np.ndarray | float, low: float, high: float) -> np.ndarray:
    """Where r, changed by something between ``low`` and ``high``, would have either sign."""
    return (np.asarray(r) + low < 0) & (np.asarray(r) + high >= 0)


def uncertainty_variables(
    checks: RepeatedRuns, r: Mapping[str, float], ids: np.ndarray, dims: Sequence[str]
) -> dict[str, tuple]:
    """What the repeated runs add to a map of the runs ``ids``: strips by cause, and what they say."""
    strips = {NUMERICS: checks.numerics(r), MODEL: checks.model(r)}

    def by_place(values: Mapping[str, float], text: str) -> tuple:
        array = np.array([values.get(str(id), math.nan) for id in ids.ravel()]).reshape(ids.shape)
        return dims, array, {"units": "1", "long_name": f"logarithm of measure over threshold, {text}"}

    bands = {
        id: values
        for id, changed in checks.alternatives.items()
        if (values := [s for other in changed.values() if math.isfinite(s := r.get(other, math.nan))])
    }
    fine = {id: r.get(other, math.nan) for id, other in checks.refined.items()}
    names = np.array([checks.refined.get(str(id), "") for id in ids.ravel()]).reshape(ids.shape)
    ends = np.array([[s.low, s.high] for s in strips.values()])
    text = "by how much the logarithm of measure over threshold may change: lowest, highest"
    runs = np.array([s.runs for s in strips.values()])
    halved, low, high = RATIOS
    return {
        "strip": (["cause", "end"], ends, {"units": "1", "long_name": text}),
        "strip_runs": (["cause"], runs, {"units": "1", "long_name": "places at which runs were repeated"}),
        halved: by_place(fine, "elements and steps half as large"),
        low: by_place({id: min(v) for id, v in bands.items()}, "least over what the model leaves open"),
        high: by_place({id: max(v) for id, v in bands.items()}, "largest over what the model leaves open"),
        "refined_run_id": (dims, names, {"long_name": "the refined run; its folder in the store"}),
    }


def strip_sentences(data: xr.Dataset) -> list[str]:
    """By which factor the measure at the line may be off, a sentence a cause."""
    words = {
        NUMERICS: "elements and steps half as large change the drop",
        MODEL: "what the model leaves open changes the drop",
    }
    return [
        f"at the line {words[cause]} to {math.exp(s.low):.2f} to {math.exp(s.high):.2f} times"
        f" ({s.runs} places)"
        for cause, s in uncertainty_strips(data).items()
    ]
