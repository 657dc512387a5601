"""A sweep's runs on the workers of a Dask scheduler: other machines, or processes of this one.

Dask sends a run again when its worker is lost, and takes workers that join later. A worker that sees
the store's folder (a shared file system) writes there itself; from one that does not, the run comes
back over the network and is written here.
"""

from __future__ import annotations

import contextlib
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.threads import ONE_THREAD
from cutbench.case.case import Case
from cutbench.run.pool.worker import Run, computed, work
from cutbench.run.result import Result

if TYPE_CHECKING:
    from cutbench.maps.sweep import _Sweep

#: A run that takes its worker down so often is given up.
LOSSES = 3
#: Seconds to wait for a scheduler to answer.
PATIENCE_S = 30.0
#: Runs handed out beyond the workers' threads, so that none waits for this process.
_AHEAD = 2


def check_scheduler(scheduler: str) -> None:
    """Raise BadInput if Dask is not installed, or ``scheduler`` is neither an address nor ``local``."""
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise BadInput(
            key="--scheduler", value=scheduler, expected="Dask to be installed: pip install 'cutbench[dask]'"
        ) from error
    if scheduler != "local" and not re.fullmatch(r"(tcp|tls|ucx|ws|wss)://\S+:\d+", scheduler):
        raise BadInput(
            key="--scheduler", value=scheduler, expected="'local', or an address such as tcp://10.0.0.1:8786"
        )


def remote(run: Run | None, case: Case, root: str, mark: str, replace: bool) -> Result | None:
    """On a worker: compute and keep a run; returned where the store is not to be seen from there.

    Dask sends a task again when the worker that did it is lost before its answer was fetched: what is
    in the store by then is not computed again.
    """
    if mark and (Path(root) / mark).is_file():
        work(run, case, Path(root), replace)
        return None
    return computed(run, case)


def run_on_cluster(sweep: _Sweep, scheduler: str, workers: int) -> None:
    """Compute all that the sweep asks for. ``local`` starts ``workers`` processes and ends them.

    Raises BadInput if no scheduler answers, ComputationFailed if it is lost on the way; what has ended
    is in the store.
    """
    import dask
    from distributed import Client, LocalCluster

    timeout = f"{PATIENCE_S:g}s"
    with dask.config.set(
        {
            "distributed.scheduler.allowed-failures": LOSSES - 1,
            "distributed.comm.timeouts.connect": timeout,
            "distributed.worker.memory.terminate": False,
        }
    ):
        cluster = None
        try:
            if scheduler == "local":
                cluster = LocalCluster(
                    n_workers=max(1, workers), threads_per_worker=1, dashboard_address=None,
                    env={**ONE_THREAD},
                )  # fmt: skip
            client = Client(cluster or scheduler, timeout=timeout)
        except OSError as error:
            raise BadInput(
                key="--scheduler", value=scheduler, expected=f"a Dask scheduler that answers ({error})"
            ) from error
        try:
            _feed(sweep, client)
        finally:
            with contextlib.suppress(OSError):  # a scheduler that is gone cannot be taken leave of
                client.close(timeout=2)
                if cluster is not None:
                    cluster.close(timeout=5)


def _feed(sweep: _Sweep, client) -> None:
    from distributed import CancelledError, KilledWorker, wait
    from distributed.comm import CommClosedError

    mark = sweep.store.mark()
    flying: dict = {}
    silent_since = None
    try:
        while sweep.todo or flying or sweep.more():
            threads = sum(client.nthreads().values())
            while sweep.todo and len(flying) < threads + _AHEAD:
                id = sweep.todo.popleft()
                future = client.submit(
                    remote, sweep.run, sweep.cases[id], str(sweep.store.root.resolve()), mark,
                    sweep.replace, pure=False, retries=0,
                )  # fmt: skip
                flying[future] = id
            try:
                done = wait(list(flying), timeout=0.5, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                done = set()
            for future in done:
                id = flying.pop(future)
                try:
                    result = future.result()
                except KilledWorker:
                    sweep.given_up(id, f"its worker was lost {LOSSES} times (out of memory, or killed)")
                    continue
                _keep(sweep, id, result)
            silent_since = None if client.status == "running" else silent_since or time.monotonic()
            if silent_since is not None and time.monotonic() - silent_since > PATIENCE_S:
                raise CommClosedError("it no longer answers")
            sweep.tick()
    except (CancelledError, OSError) as error:  # closed, cancelled, or timed out
        for id in flying.values():
            if sweep.store.has(id):
                _keep(sweep, id, None)
        raise ComputationFailed(
            f"the Dask scheduler was lost ({error or type(error).__name__}); what has ended is kept in"
            f" {sweep.store.root}: start the same command again to go on"
        ) from error


def _keep(sweep: _Sweep, id: str, result: Result | None) -> None:
    try:
        if result is not None:
            sweep.store.put(result, replace=sweep.replace)
        sweep.ended(id)
    except OSError as error:
        raise ComputationFailed(f"a run could not be kept in {sweep.store.root}: {error}") from error
