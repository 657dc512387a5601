"""Compute the runs that claims ask for, each once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cutbench.base.progress import OnProgress, silent
from cutbench.case.case import Case
from cutbench.run import runner
from cutbench.run.pool.batch import Batch
from cutbench.run.pool.worker import Run
from cutbench.run.result import Result
from cutbench.run.store.runs import Store
from studies.paper.base import BLOCK, CUT, NOTCHED, TENSION
from studies.paper.observed import COLUMNS, notched, observed_run, pulled

#: How each kind of test is run; None: as any case is.
RUNS: dict[str, Run | None] = {CUT: observed_run, BLOCK: None, TENSION: pulled, NOTCHED: notched}


@dataclass(frozen=True)
class _ByKind:
    """Runs a case as its kind is run; other processes can have it."""

    runs: Mapping[str, Run | None]
    kinds: Mapping[str, str]

    def __call__(self, case: Case) -> Result:
        return (self.runs[self.kinds[case.id]] or runner.run_case)(case)


class Runner(Batch):
    """Runs of claims; ``runs`` replaces how tests are run, by kind, which ``kinds`` has by id."""

    def __init__(
        self,
        store: Store,
        *,
        workers: int | None = None,
        on_progress: OnProgress = silent,
        runs: Mapping[str, Run | None] | None = None,
    ):
        super().__init__(store, workers=workers, on_progress=on_progress)
        self._runs = {**RUNS, **(runs or {})}
        self.kinds: dict[str, str] = {}

    def ask(self, asked: Iterable[tuple[Case, str]]) -> None:
        """Have all of ``asked``, pairs of a case and its kind, in ``results``."""
        cases = {case.id: case for case, kind in asked if self.kinds.setdefault(case.id, kind)}
        self.go(cases.values(), _ByKind(self._runs, self.kinds))

    def stored(self, id: str) -> Result | None:
        """If it holds what claims read: a sweep's run lacks the looks at its fields."""
        result = self.store.get(id)
        if result is None or result.outcome.kind == "failed" or COLUMNS[0] in result.curve:
            return result
        return None if self.kinds[id] == CUT else result
