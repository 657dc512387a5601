"""The benchmark that kills sweeps: on stand-in runs, and that it sees what is lost or written twice."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import kills

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc (Linux)")

#: A sweep of two workers as the benchmark starts it, but of runs by formula, and without pictures.
SCRIPT = """
import sys
from analytic_runs import fake_run

if __name__ == "__main__":
    from cutbench.maps.sweep import run_study
    run_study(sys.argv[1], sys.argv[2], workers=2, run=fake_run, pictures=False)
"""


@pytest.fixture
def stand_ins(tmp_path):
    """Sweeps of a few runs that take a moment each."""
    script, here = tmp_path / "script.py", Path(__file__).parent
    script.write_text(SCRIPT)
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(here), str(here.parent)]), "FAKE_RUN_S": "0.4"}

    def start(study, out):
        return subprocess.Popen(
            [sys.executable, str(script), str(study), str(out)], env=env, stdout=subprocess.DEVNULL
        )

    # Fewer runs, deep enough for the formula.
    return kills.STUDY.replace("points = 5", "points = 2").replace("3.5 mm", "9 mm"), start


@pytest.mark.slow
def test_a_sweep_that_is_killed_ends_with_the_same_map(stand_ins, tmp_path):
    file = tmp_path / "kills.json"
    assert kills.main(["--kills", "2", "--pause", "1", "--json", str(file)], *stand_ins) == 0
    found = json.loads(file.read_text())
    assert 1 <= sum(found["killed"].values()) <= 2
    assert found["runs"] == found["all_runs"] == 12
    assert (found["lost"], found["written_twice"], found["same_map"], found["exit"]) == (0, 0, True, 0)


def test_what_is_lost_or_written_twice_is_counted(tmp_path):
    records = [tmp_path / "runs" / "aa" / name / "run.json" for name in ("kept", "lost", "again")]
    begun = []

    def start(study, out):
        """A process that waits to be killed; when it is started again, runs have suffered."""
        if begun:
            records[1].unlink()
            records[2].unlink()
        for record in (records[0], records[2]) if begun else records:
            record.parent.mkdir(parents=True, exist_ok=True)
            if not record.exists():
                record.write_text(f"{len(begun)}")
        begun.append(out)
        wait = "import time; time.sleep(60)" if len(begun) == 1 else ""
        return subprocess.Popen([sys.executable, "-c", wait])

    found = kills.disturbed(tmp_path / "study.toml", tmp_path, 1, random.Random(0), 0.1, start)
    assert found == {
        "killed": {"sweep": 1, "worker": 0}, "exit": 0, "runs": 3, "lost": 1, "written_twice": 1
    }  # fmt: skip


def test_a_folder_that_is_not_there_is_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        kills.main(["--json", "none/there/kills.json"])
    assert stop.value.code == 2 and "none/there" in capsys.readouterr().err
