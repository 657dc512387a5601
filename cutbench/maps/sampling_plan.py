"""Which runs a study asks for next, given those that have ended: all at once, or round by round; and how many
there are, and about how long they take, before anything is run."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.threads import cores
from cutbench.case.case import Case, load_case
from cutbench.case.model_alternatives import alternative_cases
from cutbench.case.motion import TRANSITION
from cutbench.maps.atlas_map import expected_margins
from cutbench.maps.axes import BOUNDARY
from cutbench.maps.boundary import BoundaryEstimate, BoundarySearch, Index, levels_of
from cutbench.maps.dataset import MapRow, row_of
from cutbench.maps.regimes import quasi_static_case
from cutbench.maps.study import Study
from cutbench.maps.uncertainty import RepeatedRuns, log_ratio, nearest_to_boundary
from cutbench.run.runner import run_case
from cutbench.run.store.runs import Store

#: So many runs come before those of the marked materials.
_RUNS_BEFORE_MARKS = 8


class SamplingPlan:
    """The runs of a grid, of a sample, or one axis at a time: known beforehand, asked for once."""

    def __init__(self, study: Study):
        self.study = study
        #: Run id by index in the map, as far as asked for.
        self.ids: dict[Index, str] = {}
        self.impossible: dict[str, MapRow] = {}
        #: Of each run, where the study wants it, the one at rest.
        self.rest: dict[str, str] = {}
        #: What is repeated of them, once all others have ended.
        self.checks = RepeatedRuns()
        #: Whether it begins from what the atlas expects of the boundary.
        self.informed = False

    @property
    def max_runs(self) -> int:
        """Runs that are asked for at the most."""
        return len({case.id for case in self.with_marks(self.with_rest(self.study.cases()))}) + self.repeated

    @property
    def repeated(self) -> int:
        """Runs that ``repeats`` asks for at the most."""
        wanted = self.study.doubtful
        return wanted.runs + (
            wanted.bands * len(alternative_cases(self.study.base, switching_on=False)[0])
            if wanted.bands
            else 0
        )

    def repeats(self, rows: Mapping[str, MapRow]) -> list[Case]:
        """The runs that say how far the line may be off, when ``ask`` has none left; asked for once."""
        wanted = self.study.doubtful
        if self.checks.refined or self.checks.alternatives or not (wanted.runs or wanted.bands):
            return []
        margins = {i: rows[id].margin(self.study.regime) for i, id in self.ids.items() if id in rows}
        r = {index: log_ratio(each) for index, each in margins.items() if not math.isnan(each)}
        names = [axis.name for axis in self.study.axes]
        panel = names.index(self.study.plot.panel) if self.study.plot.panel in names else None
        places = {self.ids[index]: index for index in nearest_to_boundary(r, panel)}  # two may be one run
        chosen = list(places)[: max(wanted.runs, wanted.bands)]
        cases = {id: self.study.case_at(self.values_at(places[id])) for id in chosen}
        return self.checks.ask(cases, chosen, wanted.runs, wanted.bands)

    def values_at(self, index: Index) -> list[float]:
        """The values of the axes at a place of a grid."""
        return [axis.values[i] for axis, i in zip(self.study.axes, index, strict=True)]

    def ask(self, rows: Mapping[str, MapRow]) -> list[Case]:
        """The next cases, in order; none when the study is done. ``rows`` are all that have ended."""
        if self.ids:
            return []
        self.ids = {index: case.id for index, case in self.study.points()}
        return self.with_marks(self.with_rest(self.study.cases()))

    def with_marks(self, cases: list[Case]) -> list[Case]:
        """The first runs and those of the marked materials, which follow a look at the whole map."""
        return [
            *cases[:_RUNS_BEFORE_MARKS],
            *(mark.case for mark in self.study.marks()),
            *cases[_RUNS_BEFORE_MARKS:],
        ]

    def with_rest(self, cases: list[Case]) -> list[Case]:
        """And the runs at rest of all these, where the study wants them."""
        if not self.study.regime.rest:
            return cases
        still = [quasi_static_case(case) for case in cases]
        self.rest |= {case.id: other.id for case, other in zip(cases, still, strict=True)}
        return [*cases, *still]

    def estimates(self, rows: Mapping[str, MapRow]) -> dict[Index, BoundaryEstimate]:
        """What is known of a boundary that is sought, by the indices of the levels."""
        return {}


@dataclass
class _Level:
    """One combination of levels: its indices, where it lies in the map, and its search."""

    chosen: Index
    where: tuple[slice | int, ...]
    search: BoundarySearch
    places: dict[Index, Index] = field(default_factory=dict)  # in the box -> in the map
    done: bool = False


class BoundaryPlan(SamplingPlan):
    """The rounds of a search, one for each combination of levels, side by side: none waits for another."""

    def __init__(self, study: Study):
        super().__init__(study)
        assert study.search is not None, "a study that seeks a boundary says how"
        shape = tuple(len(axis.values) for axis in study.axes if axis.continuous)
        expected = expected_margins(study)
        self.informed = bool(expected)
        self._levels = [
            _Level(
                chosen,
                where,
                BoundarySearch(
                    shape,
                    start=study.search.start,
                    batch=study.search.batch,
                    runs=study.search.runs,
                    expected=expected.get(chosen),
                ),
            )
            for chosen, where in levels_of(study.axes)
        ]

    @property
    def max_runs(self) -> int:
        runs = sum(level.search.max_runs for level in self._levels)
        return runs * (1 + self.study.regime.rest) + len(self.study.marks()) + self.repeated

    def ask(self, rows: Mapping[str, MapRow]) -> list[Case]:
        first = not self.ids
        while True:
            asked = [self._next(level, rows) for level in self._levels]
            # One of each level in turn: any beginning says something of all.
            turns = list(itertools.zip_longest(*asked))
            cases = [
                case
                for turn in turns
                for level, inner in zip(self._levels, turn, strict=True)
                if inner is not None
                for case in self._case(level, inner)
            ]
            if cases or not turns:
                cases = self.with_rest(cases)
                return self.with_marks(cases) if first else cases

    def _next(self, level: _Level, rows: Mapping[str, MapRow]) -> list[Index]:
        """The next round of one search; none while runs of the last are under way, and when it is done."""
        margins = self._margins(level, rows)
        if level.done or len(margins) < len(level.places):
            return []
        asked = level.search.ask(margins)
        level.done = not asked
        return asked

    def _case(self, level: _Level, inner: Index) -> list[Case]:
        along = iter(inner)
        index = level.places[inner] = tuple(k if isinstance(k, int) else next(along) for k in level.where)
        try:
            case = self.study.case_at(self.values_at(index))
        except BadInput as error:  # a place in the middle that the corners did not foretell
            self.ids[index] = f"none-{'-'.join(map(str, index))}"
            self.impossible[self.ids[index]] = MapRow("failed", str(error))
            return []
        self.ids[index] = case.id
        return [case]

    def estimates(self, rows: Mapping[str, MapRow]) -> dict[Index, BoundaryEstimate]:
        return {level.chosen: level.search.estimate(self._margins(level, rows)) for level in self._levels}

    def _margins(self, level: _Level, rows: Mapping[str, MapRow]) -> dict[Index, float]:
        ended = {**self.impossible, **rows}
        ids = {inner: self.ids[index] for inner, index in level.places.items()}
        return {inner: ended[id].margin(self.study.regime) for inner, id in ids.items() if id in ended}


def plan_of(study: Study) -> SamplingPlan:
    """The plan of a study's mode."""
    return BoundaryPlan(study) if study.mode == BOUNDARY else SamplingPlan(study)


#: Where no such run is in the store: what a blade thickness of travel takes at default numerics in times of a
#: ``probe`` on this machine, how many times as much with friction and on elements and steps half as large,
#: and the travel of a run until its transition in thicknesses (``studies/transition.toml``).
PER_THICKNESS, RUBBING, REFINED, TRANSITION_TRAVEL = 3.15, 4.0, 5.0, 60 / 7


@dataclass(frozen=True)
class Forecast:
    """``reused`` runs are in the store; ``first`` are to be computed for certain, ``max_runs`` if a search
    takes all that it may. A run takes ``seconds``, the mean of ``timed`` in the store (0: by a short run)."""

    reused: int
    first: int
    max_runs: int
    seconds: float
    timed: int
    workers: int

    @property
    def total_s(self) -> float:
        """Wall time of ``max_runs`` runs on the workers."""
        return self.max_runs * self.seconds / max(self.workers, 1)

    def text(self) -> str:
        """In one sentence."""
        runs = f"{self.first}" if self.first == self.max_runs else f"{self.first} to {self.max_runs}"
        source = f"the mean of {self.timed} in the store" if self.timed else "by a short run here and now"
        hands = f"{self.workers} workers" if self.workers > 1 else "one process"
        most = "" if self.first == self.max_runs else "at most "
        time = f"{self.total_s / 60:.2g} minutes" if self.total_s >= 60 else f"{self.total_s:.2g} s"
        return (
            f"{runs} runs to compute, {self.reused} in the store: {most}about {time} on {hands}"
            f" ({self.seconds:.2g} s a run, {source})"
        )


def forecast(
    study: Study,
    store: str | os.PathLike[str],
    workers: int | None = None,
    also: Sequence[str | os.PathLike[str]] = (),
) -> Forecast:
    """How many runs ``run_study`` would compute, and about how long: nothing is run, nothing written.

    There are the runs that are in the folder ``store``, there or not, and in
    those that are there ``also``."""
    plan, stores = plan_of(study), [Store(each) for each in (store, *also) if Path(each).is_dir()]
    rows: dict[str, MapRow] = {}
    missing: set[str] = set()
    times: list[float] = []
    while not missing and (asked := [case for case in plan.ask(rows) if case.id not in rows]):
        for case in asked:
            result = next((run for each in stores if (run := each.get(case.id)) is not None), None)
            if result is None:
                missing.add(case.id)
            else:
                rows[case.id] = row_of(result, study.regime)
                times.append(result.timings.get("total", 0.0))
    if not times:
        alike, heads = study.base.to_dict()["numerics"], [h for each in stores for h in each.heads().values()]
        times = [head["seconds"] for head in heads
                 if head["seconds"] and head["numerics"] == alike
                 and head["computation"] == study.base.computation]  # fmt: skip
    most = plan.max_runs - len(rows) if study.search and missing else len(missing)
    if times:
        seconds = sum(times) / len(times)
    elif not missing:
        seconds = 0.0
    else:
        rates = [_rate(case) for case in plan_of(study).ask({})]
        finer = min(study.doubtful.runs, most) * (REFINED - 1)
        seconds = probe() * sum(rates) / len(rates) * (1 + finer / most)
    hands = cores() if workers is None else workers
    return Forecast(len(rows), len(missing), most, seconds, len(times), max(hands, 1))


def _rate(case: Case) -> float:
    """What a run takes, in times of a probe."""
    travel = case.p.depth / case.unit_mm
    travel = min(travel, TRANSITION_TRAVEL) if case.until == TRANSITION else travel
    rubs = any(
        case.values[q.name] > 0 for law in case.model.all if law.role == "friction" for q in law.parameters
    )
    return PER_THICKNESS * travel * (RUBBING if rubs else 1.0)


@cache
def probe() -> float:
    """Seconds of one core that a short run takes on this machine, once its loops are compiled."""
    case = load_case("gelatin", {"depth": "0.5 mm", "numerics": "fast"})
    taken = []
    for _ in range(3):
        began = time.process_time()
        run_case(case)
        taken.append(time.process_time() - began)
    return min(taken)
