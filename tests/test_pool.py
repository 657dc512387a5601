"""The pool of processes, whatever is computed in it; and the bar that shows how far it is."""

from __future__ import annotations

import io
import math
import os
import time
from pathlib import Path

import pool_jobs as jobs
import pytest
from refusals import refused
from rich.console import Console

from cutbench.base.progress import Clock, Pace
from cutbench.cli import progress
from cutbench.run.pool.pool import Job, TaskPool
from cutbench.run.pool.worker import WorkerLost

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(HERE.parent)]))


@pytest.mark.parametrize("workers", [0, 2])
def test_values_and_errors_come_back_with_their_keys(workers):
    asked = [Job(i, jobs.double, (i,)) for i in range(5)] + [Job("bad", jobs.wrong, (7,))]
    with TaskPool(workers) as pool:
        found = {done.key: done for done in pool.run(asked)}
    assert {key: done.result() for key, done in found.items() if key != "bad"} == {i: 2 * i for i in range(5)}
    with pytest.raises(ValueError, match="no 7"):
        found["bad"].result()


@pytest.mark.parametrize("workers", [0, 2])
def test_what_comes_next_may_depend_on_what_has_ended(workers):
    seen = []

    def rounds():
        for n in (3, 2):
            before = len(seen)
            yield from (Job((n, i), jobs.double, (i,)) for i in range(n))
            while len(seen) < before + n:
                yield None

    with TaskPool(workers) as pool:
        for done in pool.run(rounds()):
            seen.append(done.key)
        assert [key[0] for key in seen] == [3, 3, 3, 2, 2]
        assert [done.result() for done in pool.run([Job(0, jobs.double, (4,))])] == [8], "used again"


@pytest.mark.slow  # tests/test_sweep.py asks the same of a sweep
def test_a_job_that_takes_its_process_down_is_tried_again_then_given_up(tmp_path):
    asked = [
        Job("once", jobs.deadly, (str(tmp_path / "once"), 1)),
        Job("always", jobs.deadly, (str(tmp_path / "always"), 99)),
        *(Job(i, jobs.double, (i,)) for i in range(3)),
    ]
    with TaskPool(2) as pool:
        found = {done.key: done for done in pool.run(asked)}
    assert found["once"].result() == "alive" and [found[i].result() for i in range(3)] == [0, 2, 4]
    with pytest.raises(WorkerLost, match="3 times"):
        found["always"].result()


def test_a_number_of_processes_that_cannot_be_is_refused():
    with refused("workers", value="-1"):
        TaskPool(-1)


def test_the_time_left_counts_effort_and_begins_with_what_was_expected(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    clock = Clock(Pace(lambda mm: mm**2, expected_s=100.0))
    assert clock.left(0.0, 10.0) == "1 min 40 s"
    now[0] = 50.0  # half of the way is a quarter of the effort, and takes twice as long as expected
    assert clock.left(5.0, 10.0) == "2 min 18 s"
    assert Clock().left(0.0, 10.0) == ""


def test_a_bar_has_the_time_left_and_without_a_terminal_lines_do(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    said = io.StringIO()
    with progress.bar("cut", "mm", console=Console(file=said, width=200)) as on_progress:
        on_progress(4.0, 10.0, "")  # what was there before took no time
        now[0] = 30.0
        on_progress(6.0, 10.0, "1.2 N")
        on_progress(6.5, 10.0, "1.3 N")
        now[0] = 45.0
        on_progress(7.0, math.nan, "a stage")
    first, second = said.getvalue().splitlines()
    assert all(part in first for part in ("6 of 10 mm", "1.2 N", "1 min 00 s")) and "stage" in second
