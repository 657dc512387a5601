"""How many runs a sweep has before it, and about how long they take: nothing is run, nothing written."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cutbench.case.case import Case, load_case
from cutbench.case.motion import TRANSITION
from cutbench.maps.dataset import MapRow, row_of
from cutbench.maps.sampling_plan import plan_of
from cutbench.maps.study import Study
from cutbench.run.pool.pool import cores
from cutbench.run.runner import run_case
from cutbench.run.store.runs import Store

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
    """What ``run_study`` would compute with the runs that are in the folder ``store``, there or not, and in
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
