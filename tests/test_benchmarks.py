"""The benchmarks: what is timed, that the parts add up, and that nothing is left out in silence."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import __main__ as bench
from benchmarks.jobs import JOBS
from benchmarks.measure import PARTS, record
from cutbench.base.threads import ONE_THREAD
from cutbench.case.case import load_case
from cutbench.run.build import build

ROOT = Path(__file__).resolve().parents[1]


def result(kind="done", factorizations=10, solves=40):
    """A run of 2 s, of which the timer knows 1.5 s."""
    return SimpleNamespace(
        timings={"setup": 0.1, "assembly": 0.6, "residual": 0.2, "factorization": 0.4, "solve": 0.2,
                 "total": 2.0},
        counts={"steps": 5, "rejected_steps": 1, "iterations": 8, "degrees_of_freedom": 99,
                "factorization_calls": factorizations, "solve_calls": solves},
        outcome=SimpleNamespace(kind=kind, reached_mm=0.5), measures={"closure": 0.001},
    )  # fmt: skip


def test_parts_add_up_to_the_total():
    found = record(result(), 100.0)
    assert sum(found["seconds"][part] for part in (*PARTS, "rest")) == pytest.approx(2.0)
    assert found["seconds"]["rest"] == pytest.approx(0.5)


def test_cheap_solves_do_not_count_as_iterations():
    found = record(result(), None)
    assert (found["iterations"], found["solves"], found["iterations_in_accepted_steps"]) == (10, 40, 8)
    assert found["ms_per_iteration"]["total"] == pytest.approx(200.0)
    assert found["ms_per_iteration"]["assembly"] == pytest.approx(80.0)  # tangents and residuals


def test_a_run_without_iterations_has_no_time_per_iteration():
    assert record(result(factorizations=0), None)["ms_per_iteration"]["total"] is None


@pytest.mark.parametrize("job", [job for job in JOBS if "coarse" in job.name], ids=lambda job: job.name)
def test_the_coarse_section_has_about_2100_unknowns(job):
    case = load_case(job.material, job.changes)
    assert case.numerics.element == "P2"
    assert build(case).problem.free.size == pytest.approx(2100, rel=0.05)


def test_jobs_have_their_depths():
    assert [job.depth_mm for job in JOBS if "coarse" in job.name] == 4 * [14.0]
    assert {job.material: job.depth_mm for job in JOBS if not job.changes} == dict.fromkeys(
        ("gelatin", "elastomer", "meat"), 21.0
    )


def command(*args, **env):
    return subprocess.run(
        [sys.executable, "-m", "benchmarks", *args], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, **env}, check=False,
    )  # fmt: skip


def test_quick_command_prints_and_writes(tmp_path):
    names = ("gelatin, coarse", "gelatin, coarse, superlu")
    only = [word for name in names for word in ("--only", name)]
    done = command("--quick", *only, "--json", str(tmp_path / "b.json"), OMP_NUM_THREADS="2")
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert data["quick"] is True and data["machine"]["threads_per_run"] == "1"
    assert data["machine"]["versions"]["numpy"] and data["machine"]["cores"] >= 1
    assert [job["name"] for job in data["jobs"]] == list(names)
    for job in data["jobs"]:
        assert job["outcome"] == "done" and job["reached_mm"] == pytest.approx(0.5)
        assert 0 < job["iterations"] <= job["solves"]
        assert job["seconds"]["rest"] > 0
        assert f"{job['degrees_of_freedom']}" in done.stdout
    assert data["jobs"][1]["solver"] == "superlu"
    assert list(tmp_path.iterdir()) == [tmp_path / "b.json"]


def test_each_run_has_one_thread(monkeypatch):
    given = {}

    def fake(*args, env, **kwargs):
        given.update(env)
        return SimpleNamespace(returncode=0, stdout=json.dumps({"seconds": {"total": 1.0}}), stderr="")

    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.setattr(bench.subprocess, "run", fake)
    bench.run(JOBS[0], 1)
    assert {given[name] for name in ONE_THREAD} == {"1"}


def shown(job, kind):
    found = record(result(kind), None)
    return {**vars(job), **found, "solver": "superlu", "message": f"{kind}: no step", "reached_mm": 3.0}


def test_a_run_that_falls_short_is_told(monkeypatch, capsys):
    monkeypatch.setattr(bench, "run", lambda job, repeat: shown(job, "stalled"))
    assert bench.main(["--only", "meat"]) == 1
    out = capsys.readouterr().out
    assert "3 of 21" in out and "meat: stalled: no step" in out


def test_a_crash_does_not_hide_the_others(monkeypatch, capsys, tmp_path):
    def run(job, repeat):
        if job.name == "meat":
            raise RuntimeError("meat: crashed")
        return shown(job, "done")

    monkeypatch.setattr(bench, "run", run)
    assert bench.main(["--json", str(tmp_path / "b.json")]) == 1
    data = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert data["crashed"] == ["meat: crashed"] and len(data["jobs"]) == len(JOBS) - 1
    assert "meat: crashed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "named"),
    [(["--repeat", "0"], "--repeat = 0"), (["--json", "/no/such/folder/b.json"], "/no/such/folder/b.json"),
     (["--only", "cheese"], "cheese")],
)  # fmt: skip
def test_bad_input_is_refused_before_any_run(args, named, monkeypatch, capsys):
    monkeypatch.setattr(bench, "run", lambda *_: pytest.fail("ran"))
    with pytest.raises(SystemExit) as stop:
        bench.main(args)
    assert stop.value.code == 2
    assert named in capsys.readouterr().err


def test_a_block_is_pressed_in_by_each_solver_to_the_same_force(tmp_path):
    from benchmarks import solid

    jobs = [job for job in solid.jobs(large=False, run=False) if job["h"] == solid.SIZES[0][0]]
    assert [job["solver"] for job in jobs] == list(solid.SOLVERS)
    assert len(solid.jobs(large=True, run=True)) == len(solid.SIZES) * len(solid.SOLVERS) + 1
    found = [solid.measured({**job, "h": 2.0}) for job in jobs[:2]]
    assert found[0]["force_N"] == pytest.approx(found[1]["force_N"], rel=1e-6)
    direct, kept = found
    assert direct["factorizations"] == direct["iterations"] > 0 == direct["gmres_iterations"]
    assert kept["factorizations"] < kept["iterations"] < kept["gmres_iterations"]
    assert all(len(solid.row(r)) == len(solid._COLUMNS) for r in found)


def test_a_table_of_blocks_needs_a_folder_to_be_written_to(capsys):
    from benchmarks import solid

    with pytest.raises(SystemExit) as stopped:
        solid.main(["--json", "none/there/table.json"])
    assert stopped.value.code == 2 and "none/there" in capsys.readouterr().err
