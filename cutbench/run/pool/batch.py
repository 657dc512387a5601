"""Compute a set of cases, each once: what the store holds is not computed again."""

from __future__ import annotations

from collections.abc import Iterable

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.case.case import Case
from cutbench.run.pool.pool import Job, TaskPool
from cutbench.run.pool.worker import Run, WorkerLost, work
from cutbench.run.result import Result
from cutbench.run.store.runs import Store


class Batch:
    """Runs by id. ``workers`` processes compute (default: one a core; 0: this one).

    ``on_progress`` counts the runs asked for so far.
    """

    def __init__(self, store: Store, *, workers: int | None = None, on_progress: OnProgress = silent):
        self.store, self._on_progress, self._workers = store, on_progress, workers
        self.results: dict[str, Result] = {}
        self.computed = 0

    def go(self, cases: Iterable[Case], run: Run | None = None) -> None:
        """Have all ``cases`` in ``results``; ``run`` (default: ``run_case``), which other processes can
        import, computes them.

        A KeyboardInterrupt passes through; runs that have ended are in the store by then.
        """
        todo = []
        for case in {case.id: case for case in cases if case.id not in self.results}.values():
            kept = self.stored(case.id)
            if kept is None:
                self.store.remove(case.id)  # what it has under the id is not what was asked for
                todo.append(case)
            else:
                self.results[case.id] = kept
        self._report(len(todo))
        root, mark = self.store.root.resolve(), self.store.mark()
        jobs = (Job(case.id, work, (run, case, root, mark, True)) for case in todo)
        with TaskPool(self._workers if len(todo) > 1 else 0) as pool:
            for count, done in enumerate(pool.run(jobs), 1):
                try:
                    done.result()
                except WorkerLost as error:
                    raise ComputationFailed(
                        f"{error}; runs that ended are kept: start again, perhaps with fewer --workers"
                    ) from error
                result = self.store.get(done.key)
                if result is None:  # not kept: interrupted in the process that computed it
                    raise KeyboardInterrupt
                self.results[done.key] = result
                self.computed += 1
                self._report(len(todo) - count)

    def stored(self, id: str) -> Result | None:
        """A run from the store that serves, if it has one."""
        return self.store.get(id)

    def _report(self, left: int) -> None:
        self._on_progress(len(self.results), len(self.results) + left, "")
