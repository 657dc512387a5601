"""One process of a pool: compute a run, keep it, end with the pool. Each loads this: keep it light."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from cutbench.base.errors import ComputationFailed, CutbenchError
from cutbench.case.case import Case
from cutbench.run import runner
from cutbench.run.result import Outcome, Result
from cutbench.run.store.runs import Store

Run = Callable[[Case], Result]

#: A job that takes its process down so often, with no other beside it, is given up.
MAX_LOSSES = 3


class WorkerLost(ComputationFailed):
    """A job took its process down again and again."""

    def __init__(self, what: str):
        super().__init__(
            f"{what} (out of memory, or killed; in a script, start processes under if __name__ == '__main__')"
        )


class PoolLost(ComputationFailed):
    """The Dask scheduler is gone, and what was under way with it."""

    def __init__(self, error: object):
        super().__init__(f"the Dask scheduler was lost ({error or type(error).__name__})")


def work(run: Run | None, case: Case, root: Path, mark: str, replace: bool) -> Result | None:
    """In a worker: compute one run and keep it, whatever becomes of it.

    What another has finished meanwhile in the same store is left as it is. A worker that does not see the
    store (by its ``mark``) sends the run back.
    """
    if not (root / mark).is_file():
        return computed(run, case)
    store = Store(root)
    there = store.get(case.id)
    if there is None or (replace and not there.outcome.done):
        store.put(computed(run, case), replace=replace)
    return None


def computed(run: Run | None, case: Case) -> Result:
    """What ``run`` (default: ``cutbench.run.runner.run_case``) makes of a case; a failure is a result too."""
    _ = case.id  # refused here, not in a result, where this process has other code than the one that asks
    try:
        return (run or runner.run_case)(case)
    except CutbenchError as error:
        return failure(case, str(error))
    except Exception as error:  # one run's defect must not end the others; the map shows it
        return failure(case, f"{type(error).__name__}: {error}")


def failure(case: Case, message: str) -> Result:
    """The result of a run that has none."""
    curve = {name: np.zeros(0) for name in ("displacement_mm", "force_N", "time_s", "cut_length_mm")}
    return Result(case, curve, Outcome("failed", message))


def begin_worker(lifeline: Connection) -> None:
    """Leave Ctrl-C to the parent, and end with it: a parent that is killed leaves no process behind."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        lifeline.poll(None)  # nothing is ever sent: this returns when the parent closes its end or dies
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
