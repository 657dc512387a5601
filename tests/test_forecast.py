"""What a sweep has before it: runs counted and timed without running any."""

from __future__ import annotations

import re

import analytic_runs
import pytest
from typer.testing import CliRunner

from cutbench.cli.main import app
from cutbench.maps.sampling_plan import forecast, plan_of
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study
from cutbench.run.store.runs import Store

GRID = f'base = "gelatin"\n{analytic_runs.AXES}[plot]\nmark = ["elastomer"]\n'
SEARCH = """mode = "boundary"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 30.0
scale = "log"
[[axis]]
name = "adhesion"
values = [0.0, 0.187]
[boundary]
start = 3
batch = 2
runs = 12
"""


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "study.toml"
        path.write_text(text)
        return path

    return write


def timed_run(case):
    result = analytic_runs.computed(case)
    result.timings["total"] = 3.0 + len(case.id) / 16
    return result


def test_a_grid_has_its_points_and_marks_less_what_is_in_the_store(write, tmp_path):
    study, store = load_study(write(GRID)), tmp_path / "store"
    before = forecast(study, store, 2)
    assert (before.reused, before.first, before.max_runs, before.timed) == (0, 25, 25, 0)
    assert before.total_s == pytest.approx(25 * before.seconds / 2) and not store.exists()
    small = GRID.replace("points = 4", "points = 2").replace('mark = ["elastomer"]', "")
    run_study(load_study(write(small)), tmp_path / "out", workers=0, run=timed_run, store=store)
    after = forecast(load_study(write(GRID)), store, 2)
    assert (after.reused, after.first, after.max_runs, after.timed) == (12, 13, 13, 12)
    assert after.seconds == pytest.approx(4.0) and after.total_s == pytest.approx(26.0)
    # Other points of the same numerics are timed by what is there.
    other = forecast(load_study(write(GRID.replace("to = 30.0", "to = 20.0"))), store, 1)
    assert other.reused == 6 and other.seconds == pytest.approx(4.0)


def test_a_search_has_its_first_look_and_a_limit_and_goes_on_from_the_store(write, tmp_path):
    study, store = load_study(write(SEARCH)), tmp_path / "store"
    before = forecast(study, store, 4)
    assert before.reused == 0 and 1 <= before.first <= 6 and before.max_runs == 24
    # As an interrupted search left it: the first look is there.
    for case in plan_of(study).ask({}):
        Store(store).put(timed_run(case))
    later = forecast(study, store, 4)
    assert later.reused == before.first and 1 <= later.first <= 4
    assert later.max_runs == 24 - before.first
    run_study(study, tmp_path / "out", workers=0, run=timed_run, pictures=False, store=store)
    done = forecast(study, store, 4)
    assert done.first == done.max_runs == 0 and done.reused == len(list(store.glob("??/*")))


def test_a_dry_run_writes_nothing(write, tmp_path):
    out = tmp_path / "out"
    words = ["sweep", str(write(GRID)), "--out", str(out), "--dry-run", "--workers", "2"]
    said = CliRunner().invoke(app, words, catch_exceptions=False).output
    assert {"25", "0", "2"} <= set(re.findall(r"\d+", said))
    assert not out.exists()
