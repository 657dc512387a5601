"""Points of a plane-strain map run again in three dimensions: does the regime hold, and the numbers?

Taken are the runs whose label is least certain, those nearest to the boundary by the measure that decides it,
and the materials that the map marks. A block's elements are larger than a section's, so beside it stands the
section with the block's numerics: what the two sections differ by is the numerics', what block and section
differ by then is the third dimension's. A block confirms nothing where the two sections have other labels, or
where its layers hold up a force that does not fall.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.base.files import write_json
from cutbench.case.case import Case
from cutbench.case.numerics import Numerics, defaults
from cutbench.maps import dataset as maps
from cutbench.maps.dataset import case_on
from cutbench.maps.guidance import margins_of
from cutbench.maps.markers import ANOTHER, CONFIRMED, NUMERICS, RECORD, UNFINISHED
from cutbench.run.block_cost import cost_sentence, expected_seconds, layers_sentence
from cutbench.run.files import read_run
from cutbench.run.measures import ABRUPT, SMOOTH, UNDECIDED
from cutbench.run.pool.pool import Job, TaskPool
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
    """One point as a section, as a section with the block's numerics (``like``), and as a block.

    ``ratio``: the block over the section of equal numerics, the effect of the ends.
    """

    name: str
    at: dict[str, float]
    margin: float
    id_2d: str
    id_like: str
    id_3d: str
    outcome_2d: str
    outcome_like: str
    outcome_3d: str
    label_2d: str | None
    label_like: str | None
    label_3d: str | None
    two: dict[str, float] = field(default_factory=dict)
    like: dict[str, float] = field(default_factory=dict)
    three: dict[str, float] = field(default_factory=dict)
    ratio: dict[str, float] = field(default_factory=dict)
    wall_s: float = math.nan

    @property
    def verdict(self) -> str:
        """``unfinished`` where a run did not reach its end; ``numerics`` where the two sections have other
        labels or the block none, so that it cannot tell; else ``confirmed``, or ``another`` where it
        differs.
        """
        if None in (self.label_2d, self.label_like, self.label_3d):
            return UNFINISHED
        if self.label_like != self.label_2d or self.label_3d == UNDECIDED:
            return NUMERICS
        return CONFIRMED if self.label_3d == self.label_2d else ANOTHER


def least_certain(data: xr.Dataset, count: int) -> list[MapPoint]:
    """The ``count`` runs of a map that lie nearest to the boundary by their own measures, nearest first."""
    labels = data["label"].values
    decided = np.isin(labels, [maps.LABELS.index(name) for name in (SMOOTH, ABRUPT, UNDECIDED)])
    near = margins_of(data)
    places = maps.places_of(data)
    distance = np.where(decided & np.isfinite(near), np.abs(near), np.inf).ravel()
    order = np.argsort(distance, kind="stable")[:count]
    points = []
    for i in order[np.isfinite(distance[order])]:
        at = {name: float(values.ravel()[i]) for name, values in places.items()}
        text = ", ".join(f"{name} = {value:.4g}" for name, value in at.items())
        points.append(MapPoint(text, at, case_on(data, at), float(near.ravel()[i])))
    return points


def marked_points(data: xr.Dataset) -> list[MapPoint]:
    """The materials that the map marks, each at its own place."""
    points = []
    for mark in json.loads(data.attrs.get("marks", "[]")):
        at = {name: mark[name] for name in maps.axes_of(data)}
        if all(value is not None and math.isfinite(value) for value in at.values()):
            case = replace(case_on(data, at), name=mark["name"])
            points.append(MapPoint(mark["name"], at, case))
    return points


def block_case(case: Case, changes: Mapping[str, object] | None = None) -> Case:
    """The plane-strain ``case`` as a block: its physics and laws, a solid's mesh, then ``changes``."""
    flat = vars(Numerics())
    mesh = {name: value for name, value in vars(defaults(3)).items() if value != flat[name]}
    numerics = replace(case.numerics, **mesh, mesh=None, symmetry="auto")
    block = replace(case, name=f"{case.name} (block)", dim=3, numerics=numerics)
    return block.set(**dict(changes)) if changes else block


def section_as_block(flat: Case, block: Case) -> Case:
    """The section ``flat`` with the numerics, the depth and the end of its ``block``."""
    values = {**flat.values, "depth": block.values["depth"]}
    numerics = replace(block.numerics, mesh=None, symmetry="auto")
    return replace(
        flat, name=f"{flat.name} (as the block)", values=values, numerics=numerics, until=block.until
    )


def confirm(
    data: xr.Dataset,
    points: Sequence[MapPoint],
    folder: Path,
    run: Runner,
    *,
    source: str,
    changes: Mapping[str, object] | None = None,
    announce: Callable[[str], None] | None = None,
    limit_s: float = math.inf,
    workers: int = 0,
    sections_only: bool = False,
) -> list[Confirmed]:
    """Repeat points of a map in three dimensions, and compare.

    Each point is run as a section, as a section with its block's numerics and as a block, all sections
    first: they say what the blocks cost, in sentences to ``announce``. ``changes`` are those of the blocks,
    as ``Case.set`` takes them. ``run(case, folder)`` computes a case and leaves it there, with ``workers``
    in other processes; what ``folder`` already holds is not computed again. ``confirm.json`` is written
    there after each block, with the map's ``source``. It ends early, with what it has, after a run that was
    interrupted before ``limit_s``; one that took so long is left unfinished. With ``sections_only`` nothing
    is compared."""
    # All cases first: what does not fit is refused before hours of computing.
    blocks = [block_case(point.case, changes) for point in points]
    likes = [section_as_block(point.case, block) for point, block in zip(points, blocks, strict=True)]
    done: list[Confirmed] = []
    sections = [case for point, like in zip(points, likes, strict=True) for case in (point.case, like)]
    runs = {case.id: result for case, result in _runs(sections, folder, run, limit_s, workers)}
    cut_short = any(case.id not in runs for case in sections)
    if announce and not cut_short:
        pairs = [(b, runs[like.id]) for b, like in zip(blocks, likes, strict=True)]
        for sentence in _cost(pairs, folder, workers):
            announce(sentence)
    if cut_short or sections_only:
        return done
    for block, result in _runs(blocks, folder, run, limit_s, workers):
        runs[block.id] = result
        done = [
            _compared(data, point, runs[point.case.id], runs[like.id], runs[solid.id])
            for point, like, solid in zip(points, likes, blocks, strict=True)
            if solid.id in runs
        ]
        write_json(confirmation_record(data, done, source, len(points)), folder / RECORD)
    return done


def _runs(
    cases: Sequence[Case], folder: Path, run: Runner, limit_s: float, workers: int
) -> Iterator[tuple[Case, Result]]:
    """Each case with its run, computed unless it ended in its folder before, until one is interrupted."""
    missing = {}
    for case in cases:
        place = folder / "runs" / case.id
        if (old := _stored_run(case, place)) is not None:
            yield case, old
        else:
            missing[case.id] = Job(case.id, _timed, (run, case, place))
    with suppress(KeyboardInterrupt), TaskPool(workers) as pool:
        for job in pool.run(missing.values()):
            result, seconds = job.result()
            if result.outcome.kind == "interrupted" and seconds < limit_s:
                return
            yield result.case, result


def _timed(run: Runner, case: Case, place: Path) -> tuple[Result, float]:
    """A run, and how long it took now, s."""
    place.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    return run(case, place), time.monotonic() - began


def _cost(pairs: Sequence[tuple[Case, Result]], folder: Path, workers: int) -> Iterator[str]:
    """About how long each block that is not there takes, by its section, and all of them."""
    left = [(b, like) for b, like in pairs if _stored_run(b, folder / "runs" / b.id) is None]
    times = [expected_seconds(block, like) for block, like in left]
    for number, ((block, _), seconds) in enumerate(zip(left, times, strict=True), start=1):
        said = [cost_sentence(block.name, seconds), *filter(None, [layers_sentence(block)])]
        yield f"block {number} of {len(left)}, {'; '.join(said)}"
    hands = max(min(workers, len(left)), 1)
    whole = max([sum(times) / hands, *times], default=0.0)
    yield cost_sentence(f"all blocks, {hands} at once" if hands > 1 else "all blocks", whole)


def confirmation_record(data: xr.Dataset, done: Sequence[Confirmed], source: str, asked: int) -> dict:
    """The content of confirm.json."""
    counts = Counter(point.verdict for point in done)
    return {
        "schema": 2,
        "map": source,
        "title": data.attrs.get("title", ""),
        "axes": {name: str(data[name].attrs["units"]) for name in maps.axes_of(data)},
        "drop_threshold": float(data.attrs["drop_threshold"]),
        "asked": asked,
        "compared": len(done),
        **{name: counts[name] for name in (CONFIRMED, ANOTHER, NUMERICS, UNFINISHED)},
        "points": [{**asdict(point), "verdict": point.verdict} for point in done],
    }


def _stored_run(case: Case, folder: Path) -> Result | None:
    """The run of ``case`` that ended in ``folder`` before."""
    try:
        old = read_run(folder)
    except BadInput:
        return None
    return old if old.id == case.id and old.outcome.kind in ("done", "stalled") else None


def _compared(data: xr.Dataset, point: MapPoint, flat: Result, like: Result, block: Result) -> Confirmed:
    results = (flat, like, block)
    labels, numbers = zip(*map(maps.regime_of(data).of, results), strict=True)
    two, same, three = ({name: each[name] for name in COMPARED} for each in numbers)
    ratio = {name: three[name] / same[name] if same[name] else math.nan for name in COMPARED}
    ended = [label if r.outcome.done else None for label, r in zip(labels, results, strict=True)]
    return Confirmed(
        point.name, dict(point.at), point.margin, flat.id, like.id, block.id,
        flat.outcome.kind, like.outcome.kind, block.outcome.kind,
        ended[0], ended[1], ended[2], two, same, three, ratio,
        block.timings.get("total", math.nan),
    )  # fmt: skip
