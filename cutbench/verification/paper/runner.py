"""Compute the runs that claims ask for, each once: what the store holds is not computed again."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from cutbench.base.errors import ComputationFailed
from cutbench.base.threads import one_thread_each
from cutbench.case.case import Case
from cutbench.run.pool.worker import Run, begin_worker, work
from cutbench.run.result import Result
from cutbench.run.store.runs import Store
from cutbench.verification.paper.base import BLOCK, CUT, NOTCHED, TENSION
from cutbench.verification.paper.observed import COLUMNS, notched, observed_run, pulled

#: How each kind of test is run; None: as any case is.
RUNS: dict[str, Run | None] = {CUT: observed_run, BLOCK: None, TENSION: pulled, NOTCHED: notched}


class Runner:
    """Runs by id. ``workers`` processes compute (default: one a core; 0: this one).

    ``on_progress(done, total)`` is told.
    ``runs`` replaces how tests are run, by kind, with functions that other processes can import.
    """

    def __init__(
        self,
        store: Store,
        *,
        workers: int | None = None,
        on_progress: Callable[[int, int], None] = lambda done, total: None,
        runs: Mapping[str, Run] | None = None,
    ):
        self.store, self._tell = store, on_progress
        self._workers = (os.cpu_count() or 1) if workers is None else workers
        self._runs = {**RUNS, **(runs or {})}
        self.results: dict[str, Result] = {}
        self.kinds: dict[str, str] = {}
        self.computed = 0

    def go(self, asked: Iterable[tuple[Case, str]]) -> None:
        """Have all of ``asked``, pairs of a case and its kind of test, in ``results``.

        A KeyboardInterrupt passes through; runs that have ended are in the store by then.
        """
        new = {case.id: (case, kind) for case, kind in asked if case.id not in self.results}
        self.kinds |= {id: kind for id, (_, kind) in new.items()}
        todo = []
        for id, (case, kind) in new.items():
            kept = self._kept(id, kind)
            if kept is None:
                todo.append((case, kind))
            else:
                self.results[id] = kept
        self._report(len(todo))
        if self._workers == 0 or len(todo) < 2:
            for i, (case, kind) in enumerate(todo):
                self._run(case, kind)
                self._take(case)
                self._report(len(todo) - i - 1)
        else:
            with one_thread_each():
                self._in_pool(todo)

    def _kept(self, id: str, kind: str) -> Result | None:
        """A run from the store, if it holds what claims read: a sweep's run lacks the looks at its fields."""
        result = self.store.get(id)
        if result is None or (
            kind == CUT and result.outcome.kind != "failed" and COLUMNS[0] not in result.curve
        ):
            return None
        return result

    def _run(self, case: Case, kind: str) -> None:
        self.store.remove(case.id)
        work(self._runs[kind], case, self.store.root, True)

    def _in_pool(self, todo: list[tuple[Case, str]]) -> None:
        context = multiprocessing.get_context("spawn")
        lifeline, end = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(self._workers, context, initializer=begin_worker, initargs=(lifeline,))
        try:
            flying = {}
            for case, kind in todo:
                self.store.remove(case.id)
                flying[pool.submit(work, self._runs[kind], case, self.store.root, True)] = case
            for count, future in enumerate(as_completed(flying), 1):
                case = flying[future]
                future.result()
                self._take(case)
                self._report(len(todo) - count)
        except BrokenProcessPool as error:
            raise ComputationFailed(
                "a process died (out of memory, or killed); runs that ended are kept: start again, perhaps"
                " with fewer --workers"
            ) from error
        finally:
            end.close()  # ends the workers in the middle of a run, should there still be any
            pool.shutdown(wait=True, cancel_futures=True)
            lifeline.close()

    def _take(self, case: Case) -> None:
        result = self.store.get(case.id)
        if result is None:  # not kept: interrupted in the process that computed it
            raise KeyboardInterrupt
        self.results[case.id] = result
        self.computed += 1

    def _report(self, left: int) -> None:
        self._tell(len(self.results), len(self.results) + left)
