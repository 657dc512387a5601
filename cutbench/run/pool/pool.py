"""Compute many jobs at once: in this process, in processes of this machine, or on a Dask scheduler's workers.

A pool knows nothing of what is computed. It takes jobs one by one while there is room for them, and yields
them as they end. A job whose process dies is tried again, alone, and given up when that happens
``MAX_LOSSES`` times.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import Any, Protocol

from cutbench.base.errors import BadInput
from cutbench.run.pool.cluster import DaskWorkers
from cutbench.run.pool.job import Done, Job
from cutbench.run.pool.local import Broken, LocalWorkers
from cutbench.run.pool.worker import MAX_LOSSES, PoolLost, WorkerLost

#: Seconds between two looks at what has ended.
_POLL_S = 0.2


class Workers(Protocol):
    """What a pool's jobs go to. ``result`` raises ``Broken`` where all that was under way is lost."""

    def room(self) -> int: ...
    def submit(self, job: Job) -> Any: ...
    def wait(self, futures: list, timeout_s: float) -> set: ...
    def result(self, future: Any) -> Any: ...
    def close(self) -> None: ...


class TaskPool:
    """``workers`` processes (0: this one; None: one a core), or those of the Dask ``scheduler`` (an address,
    or ``"local"``). To be used in a ``with``: processes begin with the first job and end with the block.

    Raises BadInput for a number of workers or a scheduler that cannot be.
    """

    def __init__(self, workers: int | None = None, scheduler: str | None = None):
        if workers is not None and workers < 0:
            raise BadInput("workers", workers, "a number of processes, 0 or more")
        self.count = cores() if workers is None else workers
        self._workers: Workers | None = None
        if scheduler is not None:
            self._workers = DaskWorkers(scheduler, self.count)
        elif self.count:
            self._workers = LocalWorkers(self.count)

    def __enter__(self) -> TaskPool:
        return self

    def __exit__(self, *_: object) -> None:
        if self._workers is not None:
            self._workers.close()

    def run(self, jobs: Iterable[Job | None], on_wait: Callable[[], None] = lambda: None) -> Iterator[Done]:
        """Yield ``jobs`` as they end. ``None`` among them says that what comes next depends on those out.

        ``on_wait`` is called every now and then. A KeyboardInterrupt passes through. Raises
        ComputationFailed if a scheduler is lost, BadInput if none answers.
        """
        if self._workers is not None:
            yield from self._run(self._workers, iter(jobs), on_wait)
            return
        for job in jobs:
            if job is not None:
                yield _here(job)
                on_wait()

    def _run(
        self, workers: Workers, jobs: Iterator[Job | None], on_wait: Callable[[], None]
    ) -> Iterator[Done]:
        flying: dict[Any, Job] = {}
        suspects: deque[Job] = deque()
        lost: Counter[Hashable] = Counter()
        more = True
        try:
            while True:
                waits = False
                # What died in company may have died of the company: suspects go alone.
                while more and not waits and not suspects and len(flying) < workers.room():
                    try:
                        job = next(jobs)
                    except StopIteration:
                        more = False
                        break
                    waits = job is None
                    if job is not None:
                        flying[workers.submit(job)] = job
                if suspects and not flying:
                    job = suspects.popleft()
                    flying[workers.submit(job)] = job
                if not flying and not more:
                    return
                broken = []
                for future in workers.wait(list(flying), _POLL_S):
                    try:
                        done = Done(flying[future].key, workers.result(future))
                    except Broken:
                        broken.append(flying.pop(future))
                        continue
                    except PoolLost:
                        raise
                    except BaseException as error:
                        done = Done(flying[future].key, error=error)
                    del flying[future]
                    yield done
                for job in broken:
                    lost[job.key] += len(broken) == 1
                    if lost[job.key] < MAX_LOSSES:
                        suspects.append(job)
                    else:
                        yield Done(job.key, error=WorkerLost(f"its process died {MAX_LOSSES} times"))
                on_wait()
        finally:
            for future in flying:
                future.cancel()


def _here(job: Job) -> Done:
    try:
        return Done(job.key, job.call(*job.args))
    except Exception as error:
        return Done(job.key, error=error)


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
