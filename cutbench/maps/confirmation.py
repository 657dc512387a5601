"""Points of a plane-strain map run again in three dimensions: does the regime hold, and the numbers?

Taken are the runs whose label is least certain, those nearest to the boundary by the measure that decides it,
and the materials that the map marks, or runs near them, as far as the blocks' layers are thinner than the
cohesive zone: thicker ones hold the force up. A block's elements are larger than a section's, so beside it
stands the section with the block's numerics: what the two sections differ by is the numerics', what block and
section differ by then is the third dimension's. A block is judged by what its middle carries, which is the
answer of a long blade; it confirms nothing where the two sections have other labels.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
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
from cutbench.maps.plot_coordinates import is_log
from cutbench.run.block_cost import cost_sentence, expected_seconds, layer_zones, layers_sentence
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

    ``ratio``: the block over the section of equal numerics, the effect of the ends; ``middle``: the block as
    if all of its blade were as the middle, which ``label_3d`` is of; ``layer_zones``: its thickest layer over
    the cohesive zone.
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
    middle: dict[str, float] = field(default_factory=dict)
    layer_zones: float = math.nan

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
    return list(islice(_runs_by(data, np.abs(margins_of(data))), count))


def _runs_by(data: xr.Dataset, far: np.ndarray) -> Iterator[MapPoint]:
    """The runs of a map that have a regime, by how ``far`` they are from something, the nearest first."""
    decided = np.isin(data["label"].values, [maps.LABELS.index(one) for one in (SMOOTH, ABRUPT, UNDECIDED)])
    places, near = maps.places_of(data), margins_of(data).ravel()
    distance = np.where(decided & np.isfinite(far), far, np.inf).ravel()
    order = np.argsort(distance, kind="stable")
    for i in order[np.isfinite(distance[order])]:
        at = {name: float(values.ravel()[i]) for name, values in places.items()}
        text = ", ".join(f"{name} = {value:.4g}" for name, value in at.items())
        yield MapPoint(text, at, case_on(data, at), float(near[i]))


def resolved_points(
    data: xr.Dataset, count: int, materials: bool, changes: Mapping[str, object] | None = None
) -> tuple[list[MapPoint], list[str]]:
    """Points whose cohesive zone the layers of their blocks, with ``changes``, resolve: the ``count`` least
    certain runs, and for each marked material that does not itself the run nearest to it. Sentences say what
    is left out. Raises BadInput where no run of the map can be resolved."""

    def zones(point: MapPoint) -> float:
        return layer_zones(block_case(point.case, changes))

    def resolved(points: Iterator[MapPoint]) -> Iterator[MapPoint]:
        return (point for point in points if not zones(point) > 1)

    chosen = list(islice(resolved(_runs_by(data, np.abs(margins_of(data)))), count))
    nearer = [one for one in least_certain(data, count) if one.at not in [point.at for point in chosen]]
    said = [f"{one.name}: left out, layers are {zones(one):.2g} cohesive zones thick" for one in nearer]
    for mark in marked_points(data) if materials else []:
        thick = zones(mark)
        beside = mark if not thick > 1 else next(resolved(_runs_by(data, _distances(data, mark))), None)
        if beside is not None and beside.at not in [point.at for point in chosen]:
            chosen.append(beside)
        if beside is not mark:
            instead = f"; near it: {beside.name}" if beside else ""
            said.append(f"{mark.name}: left out, layers are {thick:.2g} cohesive zones thick{instead}")
    if said and not chosen:
        some = [block_case(point.case, changes) for point in _runs_by(data, np.abs(margins_of(data)))]
        least = min(some, key=layer_zones)
        enough = math.ceil(layer_zones(least) * (least.numerics.layers or 1))
        raise BadInput(
            "layers", least.numerics.layers,
            f"layers no thicker than a cohesive zone: layers={enough} would do for the longest of the map",
        )  # fmt: skip
    return chosen, said


def _distances(data: xr.Dataset, mark: MapPoint) -> np.ndarray:
    """How far each run is from a place, over the lengths of the axes."""
    parts = []
    for name, values in maps.places_of(data).items():
        scale = np.log if is_log(data[name]) else np.asarray
        parts.append((scale(values) - scale(mark.at[name])) / max(float(np.ptp(scale(values))), 1e-300))
    return np.sqrt(np.sum(np.square(parts), axis=0))


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
    results = (flat, like, _as_its_middle(block))
    labels, numbers = zip(*map(maps.regime_of(data).of, results), strict=True)
    two, same, middle = ({name: each[name] for name in COMPARED} for each in numbers)
    whole = maps.regime_of(data).of(block)[1]
    three = {name: whole[name] for name in COMPARED}
    ratio = {name: three[name] / same[name] if same[name] else math.nan for name in COMPARED}
    ended = [label if r.outcome.done else None for label, r in zip(labels, results, strict=True)]
    return Confirmed(
        point.name, dict(point.at), point.margin, flat.id, like.id, block.id,
        flat.outcome.kind, like.outcome.kind, block.outcome.kind,
        ended[0], ended[1], ended[2], two, same, three, ratio,
        block.timings.get("total", math.nan), middle, layer_zones(block.case),
    )  # fmt: skip


def _as_its_middle(block: Result) -> Result:
    """A blade of which all is as the middle of the ``block``, on which ligaments between cuts hold nothing
    up."""
    if "middle_force_N" not in block.curve:
        return block
    names = ("force_N", "cut_length_mm")
    curve = {**block.curve, **{name: block.curve[f"middle_{name}"] for name in names}}
    return replace(block, curve=curve, measures={})
