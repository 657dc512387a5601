"""The workers of a Dask scheduler for a pool's jobs: other machines, or processes of this one.

Dask sends a job again when its worker is lost, and takes workers that join later.
"""

from __future__ import annotations

import contextlib
import importlib.util
import re
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.threads import ONE_THREAD
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
            # No default of this process: the lock of a map's file is none of the scheduler's.
            whom = self._cluster or self._scheduler
            self._client = Client(whom, timeout=timeout, set_as_default=False)
            self._executor = self._client.get_executor(pure=False, retries=0)
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

    def submit(self, call: Callable[..., Any], *args: Any) -> Future:
        return self._executor.submit(call, *args)

    def check(self) -> None:
        running = self._client.status == "running"
        self._silent_since = None if running else self._silent_since or time.monotonic()
        if self._silent_since is not None and time.monotonic() - self._silent_since > SCHEDULER_TIMEOUT_S:
            raise PoolLost("it no longer answers")

    def error(self, error: BaseException) -> BaseException:
        from distributed import KilledWorker

        lost = isinstance(error, KilledWorker)
        return WorkerLost(f"its worker was lost {MAX_LOSSES} times") if lost else error

    def close(self) -> None:
        with contextlib.suppress(OSError):  # a scheduler that is gone cannot be taken leave of
            if self._client is not None:
                self._client.close(timeout=2)
            if self._cluster is not None:
                self._cluster.close(timeout=5)
        if self._client is not None or self._cluster is not None:
            self._settings.__exit__(None, None, None)
        self._client = self._cluster = None
