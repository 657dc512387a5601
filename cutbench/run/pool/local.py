"""Processes of this machine for a pool's jobs: one thread each, ended with the process that began them."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool as Broken
from typing import Any

from cutbench.base.threads import one_thread_each
from cutbench.run.pool.job import Job
from cutbench.run.pool.worker import begin_worker

__all__ = ["Broken", "LocalWorkers"]


class LocalWorkers:
    """``count`` processes, begun when they are needed, and anew after one of them died."""

    def __init__(self, count: int):
        self._count = count
        self._pool: ProcessPoolExecutor | None = None

    def room(self) -> int:
        """One in hand beyond the processes: none waits for who reads the results."""
        return self._count + 1

    def submit(self, job: Job) -> Future:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")  # forking a process with BLAS threads can hang
            # Processes live as long as the other end of this pipe is open. (An Event would be shared
            # state, and a process that is killed while it waits for one blocks whoever sets it.)
            self._lifeline, self._end = context.Pipe(duplex=False)
            self._pool = ProcessPoolExecutor(self._count, context, begin_worker, (self._lifeline,))
        try:
            with one_thread_each():
                return self._pool.submit(job.call, *job.args)
        except Broken as error:
            lost: Future = Future()
            lost.set_exception(error)
            return lost

    def wait(self, futures: list[Future], timeout_s: float) -> set[Future]:
        done = wait(futures, timeout_s, FIRST_COMPLETED).done
        if any(not f.cancelled() and isinstance(f.exception(), Broken) for f in done):
            done = wait(futures).done  # all that was under way is lost with one process
            self.close()
        return done

    def result(self, future: Future) -> Any:
        return future.result()

    def close(self) -> None:
        if self._pool is None:
            return
        self._end.close()  # ends the processes in the middle of a job, should there still be any
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._lifeline.close()
        self._pool = None
