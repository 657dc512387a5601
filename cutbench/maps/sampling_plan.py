"""Which runs a study asks for next, given those that have ended: all at once, or round by round."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.case.model_alternatives import alternative_cases
from cutbench.maps.atlas_map import expected_margins
from cutbench.maps.axes import BOUNDARY
from cutbench.maps.boundary import BoundaryEstimate, BoundarySearch, Index, margin
from cutbench.maps.dataset import MapRow
from cutbench.maps.regimes import quasi_static_case
from cutbench.maps.study import Study
from cutbench.maps.uncertainty import RepeatedRuns, log_ratio, nearest_to_boundary
from cutbench.run.measures import UNCUT

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
            wanted.bands * len(alternative_cases(self.study.base)[0]) if wanted.bands else 0
        )

    def repeats(self, rows: Mapping[str, MapRow]) -> list[Case]:
        """The runs that say how far the line may be off, when ``ask`` has none left; asked for once."""
        wanted = self.study.doubtful
        if self.checks.refined or self.checks.alternatives or not (wanted.runs or wanted.bands):
            return []
        r = {
            index: log_ratio(margin_of(rows[id], self.study)) for index, id in self.ids.items() if id in rows
        }
        names = [axis.name for axis in self.study.axes]
        panel = names.index(self.study.plot.panel) if self.study.plot.panel in names else None
        near = nearest_to_boundary({index: each for index, each in r.items() if not math.isnan(each)}, panel)
        most = max(wanted.runs, wanted.bands)
        at = {self.ids[index]: [axis.values[i] for axis, i in zip(self.study.axes, index, strict=True)]
              for index in near}  # fmt: skip
        chosen = list(at)[:most]  # two places may be one run
        cases = {id: self.study.case_at(at[id]) for id in chosen}
        return self.checks.ask(cases, chosen, wanted.runs, wanted.bands)

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
    """One combination of levels: its indices by axis, and the search over the other axes."""

    fixed: dict[int, int]
    search: BoundarySearch
    places: dict[Index, Index] = field(default_factory=dict)  # in the box -> in the map
    done: bool = False


class BoundaryPlan(SamplingPlan):
    """The rounds of a search, one for each combination of levels, side by side: none waits for another."""

    def __init__(self, study: Study):
        super().__init__(study)
        if study.search is None:
            raise ValueError("a study without a search has no boundary plan")
        self._free = [k for k, axis in enumerate(study.axes) if axis.continuous]
        levels = [k for k in range(len(study.axes)) if k not in self._free]
        shape = tuple(study.shape[k] for k in self._free)
        expected = expected_margins(study)
        self.informed = bool(expected)
        self._levels = [
            _Level(
                dict(zip(levels, chosen, strict=True)),
                BoundarySearch(
                    shape,
                    start=study.search.start,
                    batch=study.search.batch,
                    runs=study.search.runs,
                    expected=expected.get(chosen),
                ),
            )
            for chosen in itertools.product(*(range(study.shape[k]) for k in levels))
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
        known = self._known(level, rows)
        if level.done or len(known) < len(level.places):
            return []
        asked = level.search.ask(known)
        level.done = not asked
        return asked

    def _case(self, level: _Level, inner: Index) -> list[Case]:
        place = dict(zip(self._free, inner, strict=True)) | level.fixed
        index = level.places[inner] = tuple(place[k] for k in range(len(place)))
        values = [axis.values[i] for axis, i in zip(self.study.axes, index, strict=True)]
        try:
            case = self.study.case_at(values)
        except BadInput as error:  # a place in the middle that the corners did not foretell
            self.ids[index] = f"none-{'-'.join(map(str, index))}"
            self.impossible[self.ids[index]] = MapRow("failed", str(error))
            return []
        self.ids[index] = case.id
        return [case]

    def estimates(self, rows: Mapping[str, MapRow]) -> dict[Index, BoundaryEstimate]:
        return {
            tuple(level.fixed.values()): level.search.estimate(self._known(level, rows))
            for level in self._levels
        }

    def _known(self, level: _Level, rows: Mapping[str, MapRow]) -> dict[Index, float]:
        ids = {inner: self.ids[index] for inner, index in level.places.items()}
        outcomes = {inner: rows.get(id) or self.impossible.get(id) for inner, id in ids.items()}
        return {inner: margin_of(row, self.study) for inner, row in outcomes.items() if row is not None}


def plan_of(study: Study) -> SamplingPlan:
    """The plan of a study's mode."""
    return BoundaryPlan(study) if study.mode == BOUNDARY else SamplingPlan(study)


def margin_of(row: MapRow, study: Study) -> float:
    """A run's margin against the study's thresholds; nan if it did not end well."""
    if row.outcome != "done":
        return math.nan
    regime = study.regime
    surge_min = math.nan if regime.surge_min is None else regime.surge_min
    result = margin(
        np.array(row.measures["drop_rel"]), np.array(row.measures["surge"]), np.array(row.label == UNCUT),
        drop=regime.drop, surge_min=surge_min,
    )  # fmt: skip
    return float(result)
