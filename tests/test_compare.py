"""Two commits side by side: what counts as equal, what is told, and that the commits' own code runs."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import pytest

from benchmarks import compare
from benchmarks.compare import JOBS, Job

RUN = """import pathlib, sys
out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
out.mkdir()
(out / "curve.csv").write_text({curve!r})
(out / "run.json").write_text({run!r})
"""
CURVE = {"time_s": (0, 1, 2), "force_N": (0, 0.5, 1), "force_skin_N": (0, 0, 1e-7), "closure": (0, 0, 1e-6)}
JOB = Job("tiny", "run2d gelatin")
needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")


def package(folder, curve=CURVE, seconds=1.0, script=RUN, **measures):
    """A package whose one command writes this curve and report."""
    rows = [",".join(curve), *(",".join(map(str, row)) for row in zip(*curve.values(), strict=True))]
    run = {"id": str(folder), "timings_s": {"total": seconds}, "outcome": {"kind": "done"},
           "measures": {"onset_mm": None, "peak_N": 1.0, **measures}}  # fmt: skip
    (folder / "cutbench").mkdir(parents=True)
    (folder / "cutbench/__init__.py").touch()
    text = script.format(curve="\n".join(rows) + "\n", run=json.dumps(run))
    (folder / "cutbench/__main__.py").write_text(text)
    return folder


def side_by_side(tmp_path, old=None, new=None):
    trees = package(tmp_path / "a", **(old or {})), package(tmp_path / "b", **(new or {}))
    return compare.compare(JOB, trees, tmp_path / "jobs", 1e-9)


def test_equal_numbers_are_equal_whatever_time_they_took(tmp_path):
    found = side_by_side(tmp_path, new={"seconds": 9.0})
    assert found["equal"] and found["largest"] == 0
    assert found["old"]["exit"] == 0 < found["old"]["cpu_s"]


def test_a_force_that_moves_is_found_and_told_by_the_measures(tmp_path):
    moved = {**CURVE, "force_N": (0, 0.5, 1 + 1e-6)}
    found = side_by_side(tmp_path, new={"curve": moved, "peak_N": 1.01})
    assert not found["equal"]
    assert found["files"]["curve.csv"]["largest"] == pytest.approx(1e-6, rel=1e-5)
    assert found["files"]["curve.csv"]["above"] == ["force_N"]
    assert any("peak_N: 1 -> 1.01" in line for line in compare.told(found))


def test_rounding_in_a_small_share_is_measured_against_the_force(tmp_path):
    rounded = {**CURVE, "force_skin_N": (0, 0, 1e-7 + 1e-13), "closure": (0, 0, 1e-6 + 1e-12)}
    assert side_by_side(tmp_path, new={"curve": rounded})["equal"]


def test_a_lost_column_is_a_difference_and_a_new_one_is_not(tmp_path):
    lost = {name: column for name, column in CURVE.items() if "skin" not in name}
    assert not side_by_side(tmp_path / "lost", new={"curve": lost})["equal"]
    assert side_by_side(tmp_path / "more", old={"curve": lost})["equal"]


def test_other_steps_on_the_same_line_are_no_equal_curve(tmp_path):
    finer = {"time_s": (0, 0.5, 1, 2), "force_N": (0, 0.25, 0.5, 1)}
    coarse = {"time_s": (0, 1, 2), "force_N": (0, 0.5, 1)}
    found = side_by_side(tmp_path, {"curve": coarse}, {"curve": finer})
    assert not found["equal"] and found["files"]["curve.csv"]["largest"] == 0
    assert any("4 instead of 3" in line for line in compare.told(found))


def test_an_onset_that_appears_is_a_difference(tmp_path):
    assert not side_by_side(tmp_path, new={"onset_mm": 3.0})["equal"]


def test_a_command_that_fails_is_reported(tmp_path):
    refuse = "raise SystemExit('no such option: --depth')"
    found = side_by_side(tmp_path, new={"script": refuse})
    assert not found["equal"]
    assert any(line.startswith("new:") and "--depth" in line for line in compare.told(found))


@needs_git
def test_two_commits_from_checkout_to_table(tmp_path, benchmarks_of, capsys):
    def git(*args):
        who = ("-c", "user.name=x", "-c", "user.email=x@y.example")
        subprocess.run(["git", "-C", str(repository), *who, *args], check=True, capture_output=True)

    repository = package(tmp_path / "repository")
    git("init", "-q")
    for peak in (1.0, 2.0):
        package(tmp_path / f"p{peak}", peak_N=peak)
        text = (tmp_path / f"p{peak}/cutbench/__main__.py").read_text()
        (repository / "cutbench/__main__.py").write_text(text)
        git("add", "-A")
        git("commit", "-q", "-m", "x")
    benchmarks_of(repository)
    assert compare.main(["HEAD", "HEAD", "--json", str(tmp_path / "same.json")], [JOB]) == 0
    assert compare.main(["HEAD~1", "HEAD", "--json", str(tmp_path / "other.json")], [JOB]) == 1
    job = json.loads((tmp_path / "other.json").read_text())["jobs"][0]
    assert job["files"]["run.json"]["above"] == ["measures.peak_N"] and not job["equal"]
    assert "tiny" in capsys.readouterr().out
    assert [path.name for path in (repository / ".git/worktrees").glob("*")] == []


@needs_git
@pytest.mark.parametrize("args", [["nonsense", "HEAD"], ["HEAD", "HEAD", "--only", "cheese"],
                                  ["HEAD", "HEAD", "--tolerance", "-1"]])  # fmt: skip
def test_bad_input_is_refused_before_any_run(args):
    with pytest.raises(SystemExit) as stop:
        compare.main(args)
    assert stop.value.code == 2


@pytest.mark.slow
def test_the_campaign_that_it_makes_is_read(tmp_path):
    job = next(job for job in JOBS if job.name == "fit")
    for name, text in job.files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "cutbench", "data", str(tmp_path / "campaign.toml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
