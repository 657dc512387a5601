"""Compute the runs that claims ask for, each once."""

from __future__ import annotations

from collections.abc import Mapping

from cutbench.base.progress import OnProgress, silent
from cutbench.run.pool.batch import Batch
from cutbench.run.pool.worker import Run
from cutbench.run.result import Result
from cutbench.run.store.runs import Store
from studies.paper.base import BLOCK, CUT, NOTCHED, TENSION
from studies.paper.observed import COLUMNS, notched, observed_run, pulled

#: How each kind of test is run; None: as any case is.
RUNS: dict[str, Run | None] = {CUT: observed_run, BLOCK: None, TENSION: pulled, NOTCHED: notched}


class Runner(Batch):
    """Runs of claims; ``runs`` replaces how tests are run, by kind."""

    def __init__(
        self,
        store: Store,
        *,
        workers: int | None = None,
        on_progress: OnProgress = silent,
        runs: Mapping[str, Run | None] | None = None,
    ):
        super().__init__(store, workers=workers, on_progress=on_progress, runs={**RUNS, **(runs or {})})

    def _stored_run(self, id: str, kind: str) -> Result | None:
        """If it holds what claims read: a sweep's run lacks the looks at its fields."""
        result = self.store.get(id)
        if result is None or kind != CUT or result.outcome.kind == "failed" or COLUMNS[0] in result.curve:
            return result
        return None
