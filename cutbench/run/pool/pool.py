"""Compute many jobs at once: in this process, in processes of this machine, or on a Dask scheduler's workers.

A pool knows nothing of what is computed. It takes jobs one by one while there is room for them, and yields
them as they end. A job whose process dies is tried again, alone, and given up when that happens
``MAX_LOSSES`` times.
"""

from __future__ import annotations

import multiprocessing
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

from cutbench.base.errors import BadInput
from cutbench.base.threads import cores, one_thread_each
from cutbench.run.pool.cluster import DaskWorkers
from cutbench.run.pool.worker import MAX_LOSSES, PoolLost, WorkerLost, begin_worker

#: Seconds between two looks at what has ended.
_POLL_S = 0.2


@dataclass(frozen=True)
class Job:
    """A function that other processes can import, and what it is called with; ``key`` is for who asks."""

    key: Any
    call: Callable[..., Any]
    args: tuple = ()


@dataclass(frozen=True)
class Done:
    """A job that has ended: with a value, or with the error that it raised or that took its process."""

    key: Any
    value: Any = None
    error: BaseException | None = None

    def result(self) -> Any:
        """The value. Raises the job's error."""
        if self.error is not None:
            raise self.error
        return self.value


class Workers(Protocol):
    """What a pool's jobs go to.

    ``check`` raises PoolLost where they no longer answer; ``error`` is what a job's error says to the asker.
    """

    def room(self) -> int: ...
    def submit(self, call: Callable[..., Any], *args: Any) -> Future: ...
    def check(self) -> None: ...
    def error(self, error: BaseException) -> BaseException: ...
    def close(self) -> None: ...


class LocalWorkers:
    """``count`` processes of this machine, begun when they are needed, and anew after one of them died.

    Each has one thread, and ends with the process that began it.
    """

    def __init__(self, count: int):
        self._count = count
        self._pool: ProcessPoolExecutor | None = None

    def room(self) -> int:
        """One in hand beyond the processes: none waits for who reads the results."""
        return self._count + 1

    def submit(self, call: Callable[..., Any], *args: Any) -> Future:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")  # forking a process with BLAS threads can hang
            # Processes live as long as the other end of this pipe is open. (An Event would be shared
            # state, and a process that is killed while it waits for one blocks whoever sets it.)
            self._lifeline, self._end = context.Pipe(duplex=False)
            self._pool = ProcessPoolExecutor(self._count, context, begin_worker, (self._lifeline,))
        try:
            with one_thread_each():
                return self._pool.submit(call, *args)
        except BrokenProcessPool as error:
            lost: Future = Future()
            lost.set_exception(error)
            return lost

    def check(self) -> None:
        """Processes of this machine are not lost all at once."""

    def error(self, error: BaseException) -> BaseException:
        return error

    def close(self) -> None:
        if self._pool is None:
            return
        self._end.close()  # ends the processes in the middle of a job, should there still be any
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._lifeline.close()
        self._pool = None


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
        flying: dict[Future, Job] = {}
        # What died in company may have died of the company: suspects go alone.
        suspects: deque[Job] = deque()
        lost: Counter[Hashable] = Counter()
        more = True
        try:
            while more or flying or suspects:
                job: Job | None
                while more and not suspects and len(flying) < workers.room():
                    try:
                        job = next(jobs)
                    except StopIteration:
                        more = False
                        break
                    if job is None:
                        break
                    flying[workers.submit(job.call, *job.args)] = job
                if suspects and not flying:
                    job = suspects.popleft()
                    flying[workers.submit(job.call, *job.args)] = job
                broken = []
                for future in _ended(workers, flying):
                    job = flying.pop(future)
                    if _broken(future):
                        broken.append(job)
                    elif future.cancelled():
                        raise PoolLost("it no longer answers")
                    elif (error := future.exception()) is not None:
                        yield Done(job.key, error=workers.error(error))
                    else:
                        yield Done(job.key, future.result())
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


def _ended(workers: Workers, flying: Iterable[Future]) -> set[Future]:
    """What ends within a moment; all of it, where a process took the others with it."""
    ended = wait(flying, _POLL_S, FIRST_COMPLETED).done
    workers.check()
    if any(map(_broken, ended)):
        ended = wait(flying).done
        workers.close()
    return ended


def _broken(future: Future) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenProcessPool)


def _here(job: Job) -> Done:
    try:
        return Done(job.key, job.call(*job.args))
    except Exception as error:
        return Done(job.key, error=error)
