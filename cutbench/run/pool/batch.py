"""Compute a set of cases, each once: what the store holds is not computed again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.case.case import Case
from cutbench.run.pool.pool import Job, TaskPool
from cutbench.run.pool.worker import Run, WorkerLost, work
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

#: The kind of run that ``run_case`` makes.
CUT = "cut"


class Batch:
    """Runs by id. ``workers`` processes compute (default: one a core; 0: this one).

    ``on_progress`` counts the runs asked for so far.
    ``runs`` says by kind how cases are run, with functions that other processes can import; None: as any is.
    """

    def __init__(
        self,
        store: Store,
        *,
        workers: int | None = None,
        on_progress: OnProgress = silent,
        runs: Mapping[str, Run | None] | None = None,
    ):
        self.store, self._on_progress, self._workers = store, on_progress, workers
        self._runs = {CUT: None, **(runs or {})}
        self.results: dict[str, Result] = {}
        self.kinds: dict[str, str] = {}
        self.computed = 0

    def go(self, asked: Iterable[tuple[Case, str]]) -> None:
        """Have all of ``asked``, pairs of a case and its kind, in ``results``.

        A KeyboardInterrupt passes through; runs that have ended are in the store by then.
        """
        new = {case.id: (case, kind) for case, kind in asked if case.id not in self.results}
        self.kinds |= {id: kind for id, (_, kind) in new.items()}
        todo = []
        for id, (case, kind) in new.items():
            kept = self._stored_run(id, kind)
            if kept is None:
                todo.append((case, kind))
            else:
                self.results[id] = kept
        self._report(len(todo))
        root, mark = self.store.root.resolve(), self.store.mark()
        jobs = (Job(case.id, work, (self._fresh(case, kind), case, root, mark, True)) for case, kind in todo)
        with TaskPool(self._workers if len(todo) > 1 else 0) as pool:
            for count, done in enumerate(pool.run(jobs), 1):
                try:
                    done.result()
                except WorkerLost as error:
                    raise ComputationFailed(
                        f"{error}; runs that ended are kept: start again, perhaps with fewer --workers"
                    ) from error
                self._take(done.key)
                self._report(len(todo) - count)

    def _stored_run(self, id: str, kind: str) -> Result | None:
        """A run of this kind from the store, if it has one."""
        return self.store.get(id)

    def _fresh(self, case: Case, kind: str) -> Run | None:
        """How this kind is run, anew: what the store has under the id is not what was asked for."""
        self.store.remove(case.id)
        return self._runs[kind]

    def _take(self, id: str) -> None:
        result = self.store.get(id)
        if result is None:  # not kept: interrupted in the process that computed it
            raise KeyboardInterrupt
        self.results[id] = result
        self.computed += 1

    def _report(self, left: int) -> None:
        self._on_progress(len(self.results), len(self.results) + left, "")
