"""The workers of a Dask scheduler for a pool's jobs: other machines, or processes of this one.

Dask sends a job again when its worker is lost, and takes workers that join later.
"""

from __future__ import annotations

import contextlib
import importlib.util
import re
import time
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.threads import ONE_THREAD
from cutbench.run.pool.job import Job
from cutbench.run.pool.worker import MAX_LOSSES, PoolLost, WorkerLost

#: Seconds to wait for a scheduler to answer.
SCHEDULER_TIMEOUT_S = 30.0
#: Jobs handed out beyond the workers' threads, so that none waits for this process.
_EXTRA_JOBS = 2


def check_scheduler(scheduler: str) -> None:
    """Raise BadInput if Dask is not installed, or ``scheduler`` is neither an address nor ``local``."""
    if not _installed():
        raise BadInput("--scheduler", scheduler, "Dask to be installed: pip install 'cutbench[dask]'")
    if scheduler != "local" and not re.fullmatch(r"(tcp|tls|ucx|ws|wss)://\S+:\d+", scheduler):
        raise BadInput("--scheduler", scheduler, "'local', or an address such as tcp://10.0.0.1:8786")


def _installed() -> bool:
    try:
        return importlib.util.find_spec("distributed") is not None
    except ValueError:  # blocked, or half loaded
        return False


class DaskWorkers:
    """Jobs go to ``scheduler``; ``local`` starts ``count`` processes here and ends them."""

    def __init__(self, scheduler: str, count: int):
        check_scheduler(scheduler)
        self._scheduler, self._count = scheduler, count
        self._client: Any = None
        self._cluster: Any = None
        self._silent_since: float | None = None

    def _start(self) -> None:
        import dask
        from distributed import Client, LocalCluster

        timeout = f"{SCHEDULER_TIMEOUT_S:g}s"
        self._settings = dask.config.set(
            {
                "distributed.scheduler.allowed-failures": MAX_LOSSES - 1,
                "distributed.comm.timeouts.connect": timeout,
                "distributed.worker.memory.terminate": False,
            }
        )
        try:
            if self._scheduler == "local":
                self._cluster = LocalCluster(
                    n_workers=max(1, self._count), threads_per_worker=1, dashboard_address=None,
                    env={**ONE_THREAD},
                )  # fmt: skip
            self._client = Client(self._cluster or self._scheduler, timeout=timeout)
        except OSError as error:
            expected = f"a Dask scheduler that answers ({error})"
            raise BadInput("--scheduler", self._scheduler, expected) from error

    def room(self) -> int:
        if self._client is None:
            self._start()
        try:
            return sum(self._client.nthreads().values()) + _EXTRA_JOBS
        except (OSError, TimeoutError) as error:
            raise PoolLost(error) from error

    def submit(self, job: Job) -> Any:
        return self._client.submit(job.call, *job.args, pure=False, retries=0)

    def wait(self, futures: list, timeout_s: float) -> set:
        from distributed import CancelledError, wait

        done: set = set()
        try:
            done = wait(futures, timeout=timeout_s, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            pass
        except (CancelledError, OSError) as error:  # closed, or cancelled
            raise PoolLost(error) from error
        running = self._client.status == "running"
        self._silent_since = None if running else self._silent_since or time.monotonic()
        if self._silent_since is not None and time.monotonic() - self._silent_since > SCHEDULER_TIMEOUT_S:
            raise PoolLost("it no longer answers")
        return done

    def result(self, future: Any) -> Any:
        from distributed import CancelledError, KilledWorker

        if future.status == "error":
            error = future.exception()
            if isinstance(error, KilledWorker):
                raise WorkerLost(f"its worker was lost {MAX_LOSSES} times") from error
            raise error
        try:
            return future.result()
        except (CancelledError, OSError) as error:  # lost on its way to here
            raise PoolLost(error) from error

    def close(self) -> None:
        with contextlib.suppress(OSError):  # a scheduler that is gone cannot be taken leave of
            if self._client is not None:
                self._client.close(timeout=2)
            if self._cluster is not None:
                self._cluster.close(timeout=5)
        if self._client is not None or self._cluster is not None:
            self._settings.__exit__(None, None, None)
        self._client = self._cluster = None
