"""Sweeps through Dask: the same map, whoever joins, leaves, or dies."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import analytic_runs
import pytest
from refusals import refused

from cutbench.base.errors import ComputationFailed
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study
from cutbench.run.pool.cluster import check_scheduler
from cutbench.run.pool.worker import work
from cutbench.run.store.runs import Store

HERE = Path(__file__).parent
STUDY = """base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 30.0
points = 6
scale = "log"
[[axis]]
name = "viscosity"
from = 0.01
to = 5.0
points = 5
scale = "log"
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return load_study(path)


@pytest.fixture
def slow_log(log, monkeypatch):
    monkeypatch.setenv("FAKE_RUN_S", "0.1")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(HERE.parent)]))
    return log


@pytest.fixture
def cluster():
    """A scheduler and workers as processes of their own, started as a person does; all ended at the end."""
    pytest.importorskip("distributed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    processes = []

    def start(kind):
        words = {
            "scheduler": [
                "scheduler",
                "--host",
                "127.0.0.1",
                "--port",
                address.rpartition(":")[2],
                "--no-dashboard",
            ],
            "worker": ["worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"],
        }[kind]
        processes.append(
            subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]],
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        )  # fmt: skip
        while kind == "scheduler":  # until it answers
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", int(address.rpartition(":")[2]))) == 0:
                    break
            time.sleep(0.1)
        return processes[-1]

    start.address = address
    yield start
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    ("scheduler", "hint"), [("somewhere", "tcp://"), ("tcp://127.0.0.1", "tcp://"), ("", "'local'")]
)
def test_what_is_no_address_is_refused(scheduler, hint, study, tmp_path):
    pytest.importorskip("distributed")
    with refused("--scheduler") as caught:
        run_study(study, tmp_path / "out", scheduler=scheduler)
    assert hint in caught.value.expected


def test_without_dask_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with refused("--scheduler", value="local", hint="cutbench[dask]"):
        check_scheduler("local")


def test_a_worker_that_does_not_see_the_store_sends_the_run_back(study, slow_log, tmp_path):
    case, store = study.grid[0], Store(tmp_path / "runs")
    sent = work(analytic_runs.fake_run, case, tmp_path / "elsewhere", store.mark(), False)
    assert sent.case.id == case.id and case.id not in store
    assert work(analytic_runs.fake_run, case, store.root, store.mark(), False) is None
    assert case.id in store and store.mark() == Store(store.root).mark()


@pytest.mark.slow
def test_a_local_cluster_gives_the_same_map_and_computes_each_run_once(study, slow_log, tmp_path):
    pytest.importorskip("distributed")
    done = run_study(
        study, tmp_path / "out", workers=2, scheduler="local", run=analytic_runs.fake_run, pictures=False
    )
    ids = slow_log.read_text().split()
    assert done.complete and sorted(ids) == sorted(case.id for case in study.cases())
    here = run_study(study, tmp_path / "here", workers=0, run=analytic_runs.computed, pictures=False)
    assert done.map.equals(here.map)


def worker_processes() -> list[int]:
    """What this process has started to compute (not its resource tracker), from /proc."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            words = (entry / "cmdline").read_bytes()
        except (OSError, ValueError, IndexError):
            continue
        if parent == os.getpid() and b"spawn_main" in words:
            found.append(int(entry.name))
    return found


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds the workers in /proc")
def test_one_of_two_local_dask_workers_is_killed_and_nothing_is_lost(study, slow_log, tmp_path):
    pytest.importorskip("distributed")
    killed, kept = [], set()

    def on_progress(finished, total, text):
        if finished >= 5 and not killed:
            workers = worker_processes()
            assert len(workers) == 2
            kept.update(result.case.id for result in Store(tmp_path / "out" / "runs"))
            killed.append((workers[0], slow_log.read_text().split()))
            os.kill(workers[0], signal.SIGKILL)

    done = run_study(
        study, tmp_path / "out", workers=2, scheduler="local", run=analytic_runs.fake_run, pictures=False,
        on_progress=on_progress,
    )  # fmt: skip
    assert len(killed) == 1 and done.complete and done.status.failed == 0
    begun, ids = killed[0][1], slow_log.read_text().split()
    assert set(ids) == {case.id for case in study.cases()}
    assert not set(ids[len(begun) :]) & kept, "a finished run was begun again"
    assert len(ids) - len(set(ids)) <= 1, "only the run that was lost may be computed again"
    here = run_study(study, tmp_path / "here", workers=0, run=analytic_runs.computed, pictures=False)
    assert done.map.equals(here.map)


@pytest.mark.slow
def test_workers_come_and_go_and_lost_runs_are_done_again(study, slow_log, tmp_path, cluster):
    cluster("scheduler")
    workers = [cluster("worker"), cluster("worker")]
    killed = []

    def on_progress(finished, total, text):
        if finished >= 4 * (len(killed) + 1) and len(killed) < 3:
            killed.append(workers.pop(0))
            killed[-1].send_signal(signal.SIGKILL)
            workers.append(cluster("worker"))

    done = run_study(
        study,
        tmp_path / "out",
        scheduler=cluster.address,
        run=analytic_runs.fake_run,
        pictures=False,
        on_progress=on_progress,
    )
    assert len(killed) == 3 and done.complete and done.status.failed == 0
    ids = slow_log.read_text().split()
    assert set(ids) == {case.id for case in study.cases()}
    assert len(ids) - len(set(ids)) <= 3, "only a run that was lost with its worker may be computed again"
    here = run_study(study, tmp_path / "here", workers=0, run=analytic_runs.computed, pictures=False)
    assert done.map.equals(here.map)


@pytest.mark.slow
def test_a_lost_scheduler_loses_no_finished_run(study, slow_log, tmp_path, cluster, monkeypatch):
    monkeypatch.setattr("cutbench.run.pool.cluster.SCHEDULER_TIMEOUT_S", 6.0)
    scheduler = cluster("scheduler")
    cluster("worker")
    rng = random.Random(5)
    after = rng.randint(3, 12)

    def on_progress(finished, total, text):
        if finished >= after and scheduler.poll() is None:
            scheduler.kill()
            scheduler.wait()

    with pytest.raises(ComputationFailed):
        run_study(
            study,
            tmp_path / "out",
            scheduler=cluster.address,
            run=analytic_runs.fake_run,
            pictures=False,
            on_progress=on_progress,
        )
    time.sleep(0.5)
    kept = {result.case.id for result in Store(tmp_path / "out" / "runs")}
    assert len(kept) >= after
    begun = slow_log.read_text().split()
    done = run_study(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run, pictures=False)
    again = slow_log.read_text().split()[len(begun) :]
    assert done.complete and not set(again) & kept
