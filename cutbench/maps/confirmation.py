"""Points of a plane-strain map run again in three dimensions: does the regime hold, and the numbers?

Taken are the runs whose label is least certain, those nearest to the boundary by the measure that decides it,
and the materials that the map marks.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.base.files import write_json
from cutbench.case.case import Case
from cutbench.case.numerics import Numerics, defaults
from cutbench.maps import dataset as maps
from cutbench.maps.cases import case_on
from cutbench.maps.confirmed_points import RECORD
from cutbench.maps.guidance import margins_of
from cutbench.run.files import read_run
from cutbench.run.measures import ABRUPT, SMOOTH, UNDECIDED
from cutbench.run.result import Result

#: What is compared, besides the label.
COMPARED = ("onset_mm", "peak_N", "steady_N", "drop_rel")

Runner = Callable[[Case, Path], Result]


@dataclass(frozen=True)
class MapPoint:
    """A place of the map to confirm: ``at`` by axis in its unit; ``case`` is the plane-strain one."""

    name: str
    at: Mapping[str, float]
    case: Case
    margin: float = math.nan


@dataclass
class Confirmed:
    """One point in two and three dimensions; ``ratio`` is 3D over 2D."""

    name: str
    at: dict[str, float]
    margin: float
    id_2d: str
    id_3d: str
    outcome_2d: str
    outcome_3d: str
    label_2d: str | None
    label_3d: str | None
    two: dict[str, float] = field(default_factory=dict)
    three: dict[str, float] = field(default_factory=dict)
    ratio: dict[str, float] = field(default_factory=dict)
    wall_s: float = math.nan

    @property
    def agrees(self) -> bool | None:
        """Whether the labels are the same; None where a run did not reach its depth."""
        return None if None in (self.label_2d, self.label_3d) else self.label_2d == self.label_3d


def least_certain(data: xr.Dataset, count: int) -> list[MapPoint]:
    """The ``count`` runs of a map that lie nearest to the boundary by their own measures, nearest first."""
    labels = data["label"].values
    known = np.isin(labels, [maps.LABELS.index(name) for name in (SMOOTH, ABRUPT, UNDECIDED)])
    near = margins_of(data)
    places = maps.places_of(data)
    distance = np.where(known & np.isfinite(near), np.abs(near), np.inf).ravel()
    order = np.argsort(distance, kind="stable")[:count]
    points = []
    for i in order[np.isfinite(distance[order])]:
        at = {name: float(values.ravel()[i]) for name, values in places.items()}
        text = ", ".join(f"{name} = {value:.4g}" for name, value in at.items())
        points.append(MapPoint(text, at, case_on(data, at), float(near.ravel()[i])))
    return points


def marked(data: xr.Dataset) -> list[MapPoint]:
    """The materials that the map marks, each at its own place."""
    points = []
    for mark in json.loads(data.attrs.get("marks", "[]")):
        at = {name: mark[name] for name in maps.axes_of(data)}
        if all(value is not None and math.isfinite(value) for value in at.values()):
            case = replace(case_on(data, at), name=mark["name"])
            points.append(MapPoint(mark["name"], at, case))
    return points


def solid(case: Case, changes: Mapping[str, object] | None = None) -> Case:
    """The plane-strain ``case`` as a block: its physics and laws, a solid's mesh, then ``changes``."""
    flat = vars(Numerics())
    mesh = {name: value for name, value in vars(defaults(3)).items() if value != flat[name]}
    numerics = replace(case.numerics, **mesh, mesh=None, symmetry="auto")
    block = replace(case, name=f"{case.name} (block)", dim=3, numerics=numerics)
    return block.set(**dict(changes)) if changes else block


def confirm(
    data: xr.Dataset,
    points: Sequence[MapPoint],
    folder: Path,
    run: Runner,
    *,
    source: str,
    changes: Mapping[str, object] | None = None,
) -> list[Confirmed]:
    """Run ``points`` in both dimensions and write ``confirm.json`` after each; returns what was compared.

    ``run(case, folder)`` computes a case and leaves it there; what a folder already holds is not computed
    again. Ends early, with what it has, after a run that was interrupted.
    """
    done: list[Confirmed] = []
    # All cases first: what does not fit is refused before hours of computing.
    pairs = [(point, point.case, solid(point.case, changes)) for point in points]
    for point, flat, block in pairs:
        results = []
        for case in (flat, block):
            results.append(_found(case, folder / "runs" / case.id, run))
            if results[-1].outcome.kind == "interrupted":
                break
        if len(results) == 2 and results[1].outcome.kind != "interrupted":
            done.append(_compared(data, point, *results))
        write_json(record(data, done, source, len(points)), folder / RECORD)
        if results[-1].outcome.kind == "interrupted":
            break
    return done


def record(data: xr.Dataset, done: Sequence[Confirmed], source: str, asked: int) -> dict:
    """The content of confirm.json."""
    judged = [point.agrees for point in done if point.agrees is not None]
    return {
        "schema": 1,
        "map": source,
        "title": data.attrs.get("title", ""),
        "axes": {name: str(data[name].attrs["units"]) for name in maps.axes_of(data)},
        "drop_threshold": float(data.attrs["drop_threshold"]),
        "asked": asked,
        "compared": len(done),
        "judged": len(judged),
        "agree": sum(judged),
        "points": [{**asdict(point), "agrees": point.agrees} for point in done],
    }


def _found(case: Case, folder: Path, run: Runner) -> Result:
    """The run of ``case`` in ``folder``, computed unless it ended there before."""
    try:
        old = read_run(folder)
        if old.id == case.id and old.outcome.kind in ("done", "stalled"):
            return old
    except BadInput:
        pass
    folder.mkdir(parents=True, exist_ok=True)
    return run(case, folder)


def _compared(data: xr.Dataset, point: MapPoint, flat: Result, block: Result) -> Confirmed:
    labels, numbers = zip(*map(maps.regime_of(data).of, (flat, block)), strict=True)
    two, three = ({name: found[name] for name in COMPARED} for found in numbers)
    ratio = {name: three[name] / two[name] if two[name] else math.nan for name in COMPARED}
    return Confirmed(
        point.name, dict(point.at), point.margin, flat.id, block.id, flat.outcome.kind, block.outcome.kind,
        labels[0] if flat.outcome.done else None, labels[1] if block.outcome.done else None,
        two, three, ratio, block.timings.get("total", math.nan),
    )  # fmt: skip
