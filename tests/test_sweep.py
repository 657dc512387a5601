"""Sweeps: nothing finished is lost or done twice, whatever happens to the processes."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path

import analytic_runs
import numpy as np
import pytest
from refusals import refused
from rich.console import Console

from cutbench.cli.progress import bar
from cutbench.maps.atlas_map import write_estimated
from cutbench.maps.dataset import LABELS, case_on, load_map
from cutbench.maps.sampling_plan import forecast
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study
from cutbench.run.store.runs import Store

STUDY = f"""base = "gelatin"
{analytic_runs.AXES}"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return load_study(path)


#: For what is computed, kept and done again.
undrawn = partial(run_study, pictures=False)


def computed(log) -> Counter:
    return Counter(log.read_text().split())


def test_the_map_holds_what_the_curves_say(study, log, tmp_path):
    told = []
    sweep = run_study(
        study,
        tmp_path / "out",
        workers=0,
        run=analytic_runs.fake_run,
        on_progress=lambda *at: told.append(at),
    )
    assert sweep.complete and not sweep.interrupted
    assert computed(log) == Counter(case.id for case in study.cases())
    pictures = {f"{name}.{kind}" for name in ("phase",) for kind in ("png", "svg")}
    assert {p.name for p in sweep.out.iterdir()} == {
        *pictures, "map.csv", "map.html", "map.nc", "runs", "summary.txt"
    }  # fmt: skip
    data = load_map(sweep.out / "map.nc")
    assert data["label"].dims == ("cohesion", "viscosity", "adhesion")
    for index, case in study.points():
        drop = analytic_runs.drop_of(case)
        assert data["drop_rel"].values[index] == pytest.approx(drop, rel=1e-9)
        assert LABELS[data["label"].values[index]] == ("abrupt" if drop >= 0.1 else "smooth")
        assert data["run_id"].values[index] == case.id
    assert set(np.unique(data["label"])) == {LABELS.index("abrupt"), LABELS.index("smooth")}
    assert data["peak_N"].attrs["units"] == "N" and data["cohesion"].attrs["long_name"] == "cohesion"
    assert data.attrs["study"] == STUDY
    assert told[0][:2] == (0, 24) and told[-1][:2] == (24, 24)
    with open(sweep.out / "map.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24 and {row["label"] for row in rows} == {"abrupt", "smooth"}
    assert float(rows[0]["cohesion"]) == 1.0 and rows[0]["run_id"] == study.grid[0].id


def test_the_first_pictures_are_an_estimate_and_the_last_are_not(study, log, tmp_path):
    study.path.write_text(STUDY.replace("30.0", "12.0"))  # where the atlas has runs
    study, out, seen = load_study(study.path), tmp_path / "out", []

    def headed() -> list[bool]:
        return ["An estimate" in (out / name).read_text() for name in ("phase.svg", "map.html")]

    def run(case):
        computed = int(np.isfinite(load_map(out / "map.nc")["drop_rel"]).sum())
        seen.append(headed() == [True, True] and computed <= len(seen))
        return analytic_runs.fake_run(case)

    run_study(study, out, workers=0, run=run, first_picture_s=1e9)
    assert len(seen) == 24 and all(seen) and headed() == [False, False]
    with refused("out", value=str(out)):
        write_estimated(study, out)


def test_marked_materials_and_case_files_have_runs_of_their_own(study, log, tmp_path):
    (tmp_path / "my").mkdir()
    (tmp_path / "my" / "soft.toml").write_text(
        'base = "gelatin"\n[parameters]\nG = "5 kPa"\nmu = 0.2\n[protocol]\ndepth = "9 mm"\n'
    )
    study.path.write_text(STUDY + '[plot]\nmark = ["elastomer", "my/soft.toml"]\n')
    study = load_study(study.path)
    elastomer, soft = study.marks()
    assert elastomer.differs == "μ = 0.35" and soft.differs == "μ = 0.2" and soft.name == "soft"
    assert soft.case.p.depth == 9 and soft.case.numerics == study.base.numerics
    assert soft.at["cohesion"] == pytest.approx(1.5 * 10.1, rel=0.01)
    sweep = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    assert sweep.status.total == 26 and computed(log).keys() >= {elastomer.case.id, soft.case.id}
    data = load_map(sweep.out / "map.nc")
    for mark in study.marks():
        own = data.sel(mark=mark.name)
        assert float(own["mark_drop_rel"]) == pytest.approx(analytic_runs.drop_of(mark.case), rel=1e-9)
        assert str(own["mark_run_id"].values) == mark.case.id and own["mark_differs"] == mark.differs
    with open(sweep.out / "map.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["mark"] for row in rows] == [""] * 24 + ["elastomer", "soft"]
    assert float(rows[-1]["viscosity"]) == pytest.approx(soft.at["viscosity"])
    assert rows[-1]["run_id"] == soft.case.id


def test_a_second_sweep_computes_nothing_and_draws_the_same(study, log, tmp_path):
    first = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    content = (first.out / "map.csv").read_bytes()
    second = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    assert max(computed(log).values()) == 1
    assert second.status.reused == 24 and (second.out / "map.csv").read_bytes() == content


def test_failed_runs_are_kept_out_of_the_labels_and_done_again_only_when_asked(study, log, tmp_path):
    first = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.unlucky_run)
    unlucky = {case.id for case in study.grid if int(case.id, 16) % 3 == 0}
    assert 0 < len(unlucky) < 24 and first.status.failed == len(unlucky)
    for index, case in study.points():
        bad = case.id in unlucky
        assert (LABELS[first.map["label"].values[index]] == "not_computed") == bad
        assert np.isnan(first.map["drop_rel"].values[index]) == bad
        assert ("singular" in first.map["message"].values[index]) == bad
    undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    assert max(computed(log).values()) == 1
    third = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run, retry_failed=True)
    assert {id for id, n in computed(log).items() if n == 2} == unlucky
    assert third.status.failed == 0 and (third.map["label"].values > 0).all()


def test_ctrl_c_keeps_what_is_done(study, log, tmp_path):
    stopped = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.stopped_run)
    assert stopped.interrupted and not stopped.complete and stopped.status.finished == 2
    assert int((stopped.map["outcome"].values > 0).sum()) == 2
    assert (stopped.out / "map.csv").exists()
    again = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    assert again.complete and max(computed(log).values()) == 1


@pytest.mark.slow
def test_workers_that_die_do_not_end_the_sweep(study, log, tmp_path):
    """One run kills its process each time, another once; the rest pays nothing for it."""
    sweep = undrawn(study, tmp_path / "out", workers=2, run=analytic_runs.deadly_run)
    assert sweep.complete and not sweep.interrupted
    lost = sweep.map["message"].str.contains("process died 3 times")
    m = sweep.map
    expected = (m["cohesion"] > 25) & (m["viscosity"] < 0.1) & (m["adhesion"] == 0)
    assert bool((lost == expected).all())
    assert sweep.status.failed == int(lost.sum()) == 1
    assert bool((np.isfinite(sweep.map["drop_rel"]) == ~expected).all())
    # Each of the four deaths takes at most two others along.
    assert sum(n for id, n in computed(log).items()) <= 22 + 2 + 3 + 4 * 2
    again = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    assert again.status.failed == 0, "a kill says nothing of the case: the next sweep tries it again"


SCRIPT = """
import signal
import sys
from analytic_runs import fake_run
# Where the tests run in the background, Ctrl-C is ignored from the start.
signal.signal(signal.SIGINT, signal.default_int_handler)

if __name__ == "__main__":
    from cutbench.maps.sweep import run_study
    sweep = run_study(
        sys.argv[1], sys.argv[2], workers=2, run=fake_run, first_picture_s=0.5, pictures=False
    )
    print("interrupted" if sweep.interrupted else "complete", sweep.status.finished, flush=True)
"""


@pytest.fixture
def start(tmp_path, log, study):
    """Start a sweep of two workers in a process of its own."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    here = Path(__file__).parent

    def start(out, seconds):
        env = os.environ | {
            "PYTHONPATH": os.pathsep.join([str(here), str(here.parent)]),
            "FAKE_RUN_S": str(seconds),
        }
        return subprocess.Popen(
            [sys.executable, str(script), str(study.path), str(out)],
            env=env, stdout=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip

    return start


def wait_for(condition, seconds=120):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


@pytest.mark.slow
def test_killed_half_way_it_loses_no_finished_run_and_ends_with_the_same_map(start, study, log, tmp_path):
    whole = undrawn(study, tmp_path / "whole", workers=0, run=analytic_runs.fake_run)
    log.write_text("")
    out = tmp_path / "out"
    process = start(out, 0.2)
    wait_for(lambda: len(log.read_text().split()) >= 12 and (out / "map.nc").exists())
    process.kill()  # the sweep alone: its workers must notice by themselves
    process.wait()
    time.sleep(1.0)
    begun = computed(log)
    time.sleep(0.6)
    assert computed(log) == begun, "a worker outlived its sweep"
    kept = {result.case.id for result in Store(out / "runs")}
    assert 8 <= len(kept) < 24
    second = start(out, 0)
    assert second.communicate(timeout=60)[0].split() == ["complete", "24"]
    after = computed(log) - begun
    assert not set(after) & kept, "a finished run was computed again"
    assert set(after) | kept == {case.id for case in study.cases()}
    assert (out / "map.csv").read_bytes() == (whole.out / "map.csv").read_bytes()
    a, b = load_map(out / "map.nc"), load_map(whole.out / "map.nc")
    assert a.equals(b)


def test_ctrl_c_on_a_pool_ends_cleanly_with_a_map(start, log, tmp_path):
    out = tmp_path / "out"
    process = start(out, 0.2)
    wait_for(lambda: len(list(out.glob("runs/??/*"))) >= 4)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the parent and its workers
    said = process.communicate(timeout=20)[0].split()
    assert process.returncode == 0 and said[0] == "interrupted" and 4 <= int(said[1]) < 24
    data = load_map(out / "map.nc")
    assert int((data["outcome"].values > 0).sum()) == int(said[1])


def test_workers_compute_with_one_thread_and_the_caller_keeps_its_own(study, log, tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    undrawn(study, tmp_path / "out", workers=1, run=analytic_runs.threads_run)
    assert {line.split("=")[1] for line in log.read_text().split()} == {"1"}
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_the_bar_shows_runs_failures_and_time_left(study, log, tmp_path):
    console = Console(record=True, force_terminal=True, width=120, file=io.StringIO())
    with bar("map", "runs", console=console) as on_progress:
        undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.unlucky_run, on_progress=on_progress)
    text = console.export_text()
    assert "24 of 24 runs" in text and "failed" in text and "left" in text


def test_a_folder_that_cannot_be_written_and_a_bad_number_of_workers_are_bad_input(study, tmp_path):
    (tmp_path / "file").write_text("")
    with refused("out"):
        run_study(study, tmp_path / "file" / "out", workers=0, run=analytic_runs.fake_run)
    with refused("workers", value="-1"):
        run_study(study, tmp_path / "out", workers=-1, run=analytic_runs.fake_run)


def children(pid: int) -> list[int]:
    """Processes begun by ``pid`` and by those, from /proc."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError, IndexError):
            continue
        if parent == pid:
            found += [int(entry.name), *children(int(entry.name))]
    return found


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds the workers in /proc")
def test_ten_kills_at_random_moments_lose_no_finished_run_and_compute_none_twice(start, study, log, tmp_path):
    """Workers and the sweep itself, killed ten times: each finished run is kept and never begun again."""
    whole = run_study(study, tmp_path / "whole", workers=0, run=analytic_runs.computed)
    rng, out = random.Random(11), tmp_path / "out"
    process = start(out, 0.8)
    # A run that takes its worker down three times in one sweep is given up: at most two in a row.
    for victim in "wwswswwsws":
        time.sleep(rng.uniform(0.3, 2.5))
        if process.poll() is not None:
            process = start(out, 0.8)
        if victim == "w":
            wait_for(lambda p=process: workers_of(p) or p.poll() is not None)
        kept = {folder.name for folder in out.glob("runs/??/*")}
        begun = computed(log)
        if victim == "s" or process.poll() is not None:
            process.kill()
            process.wait()
            time.sleep(0.5)  # its workers end with it
            process = start(out, 0.8)
        else:
            with contextlib.suppress(ProcessLookupError, IndexError):  # it has ended by itself
                os.kill(rng.choice(workers_of(process)), signal.SIGKILL)
        time.sleep(0.1)
        assert not set(computed(log) - begun) & kept, "a finished run was begun again"
    if process.poll() is None:
        process.communicate(timeout=120)
    last = start(out, 0)
    assert last.communicate(timeout=120)[0].split() == ["complete", "24"]
    assert load_map(out / "map.nc").equals(load_map(whole.out / "map.nc"))
    assert (out / "map.csv").read_bytes() == (whole.out / "map.csv").read_bytes()


def workers_of(process) -> list[int]:
    return [pid for pid in children(process.pid) if not is_tracker(pid)]


def is_tracker(pid: int) -> bool:
    """Python's own helper that tidies up shared memory: no worker."""
    try:
        return b"resource_tracker" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return True


SAMPLE = """mode = "{mode}"
base = "gelatin"
[[axis]]
name = "cohesion"
{range}
scale = "log"
[[axis]]
mechanism = "adhesion"
{rest}
"""


def test_sweeps_of_two_machines_are_one_map(tmp_path, log):
    def swept(name, seed, **how):
        path, range_ = tmp_path / f"{name}.toml", "from = 1.0\nto = 30.0"
        rest = f"[sample]\npoints = 6\nseed = {seed}"
        path.write_text(SAMPLE.format(mode="sobol", range=range_, rest=rest))
        return undrawn(load_study(path), tmp_path / name, workers=0, run=analytic_runs.fake_run, **how)

    apart = [swept(f"s{seed}", seed) for seed in (1, 2)]
    stores = [tmp_path / "s1" / "runs", tmp_path / "s2" / "runs"]
    both = swept("both", [1, 2], also=stores)
    assert forecast(load_study(tmp_path / "both.toml"), tmp_path / "none yet", also=stores).max_runs == 0
    assert both.status.reused == both.status.total == sum(each.status.total for each in apart)
    assert len(computed(log)) == both.status.total
    with refused("also"):
        swept("none", 1, also=[tmp_path / "nowhere"])


@pytest.mark.parametrize(
    ("mode", "range_", "rest", "count"),
    [
        ("sobol", "from = 1.0\nto = 30.0", "[sample]\npoints = 12", 12),
    ],
)
def test_runs_that_do_not_lie_on_a_grid_make_a_map_of_points(tmp_path, log, mode, range_, rest, count):
    path = tmp_path / "study.toml"
    path.write_text(SAMPLE.format(mode=mode, range=range_, rest=rest))
    study = load_study(path)
    sweep = undrawn(study, tmp_path / "out", workers=0, run=analytic_runs.fake_run)
    data = load_map(sweep.out / "map.nc")
    assert data["label"].dims == ("point",) and data.sizes["point"] == count == sweep.status.total
    for k, (_, case) in enumerate(study.points()):
        assert data["drop_rel"].values[k] == pytest.approx(analytic_runs.drop_of(case), rel=1e-9)
        assert data["run_id"].values[k] == case.id
        assert bool(data["with_adhesion"].values[k]) == ("adhesion" in case.mechanisms)
        assert (
            case_on(data, {n: float(data[n].values[k]) for n in ("cohesion", "with_adhesion")}).id == case.id
        )
    with open(sweep.out / "map.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == count and float(rows[0]["cohesion"]) == pytest.approx(
        data["cohesion"].values[0], rel=1e-9
    )


def test_a_store_can_be_shared_by_sweeps(study, log, tmp_path):
    undrawn(study, tmp_path / "a", workers=0, run=analytic_runs.fake_run, store=tmp_path / "store")
    second = undrawn(study, tmp_path / "b", workers=0, run=analytic_runs.fake_run, store=tmp_path / "store")
    assert second.status.reused == 24 and max(computed(log).values()) == 1
    assert not (tmp_path / "b" / "runs").exists()
