"""A folder of results belongs to one run: no other process writes there meanwhile, files that do not belong
together are refused, and what a full disk leaves can be used."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from coarse_runs import brief_run
from refusals import refusal
from test_fit_stops import campaign
from typer.testing import CliRunner

import cutbench
from cutbench.base.errors import BadInput
from cutbench.base.files import folder_lock
from cutbench.cli.main import app

HOLDS = """import sys
from cutbench.base.files import folder_lock
with folder_lock(sys.argv[1]):
    print(flush=True)
    input()
"""
STUDY = 'title = "t"\nbase = "gelatin"\n[[axis]]\nname = "G"\nvalues = ["5 kPa", "6 kPa"]\n'


@pytest.fixture
def held(tmp_path):
    """A folder in which another process is at work."""
    folder = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout and process.stdout.readline() == "\n"
        yield folder, process
        process.kill()


@pytest.mark.parametrize("command", ["run2d", "tension", "fit", "sweep"])
def test_a_command_is_refused_a_folder_that_another_process_writes_to(command, held, tmp_path):
    folder, _ = held
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    campaign(tmp_path, "60 kPa")
    what = {"fit": str(tmp_path / "campaign.toml"), "sweep": str(study)}.get(command, "gelatin")
    done = CliRunner().invoke(app, [command, what, "--out", str(folder)])
    assert done.exit_code == 2 and "--out" in done.stderr and str(folder) in done.stderr
    assert {path.name for path in folder.iterdir()} == {".lock"}


def test_a_folder_is_free_again_once_that_process_has_died(held):
    folder, process = held
    with pytest.raises(BadInput), folder_lock(folder):
        pass
    process.kill()
    with folder_lock(folder, wait_s=10):
        pass


def test_a_curve_of_another_run_is_refused_with_its_file(tmp_path):
    result = brief_run()
    result.save(tmp_path)
    assert cutbench.load(tmp_path).id == result.id
    path = tmp_path / "curve.csv"
    path.write_text(path.read_text().replace("\n0.0,", "\n0.001,", 1))
    with pytest.raises(BadInput) as refused:
        cutbench.load(tmp_path)
    assert refused.value.file == str(path)


def test_a_run_saved_over_another_is_whole(tmp_path):
    for result in (brief_run(), brief_run()):
        result.save(tmp_path)
    record = json.loads((tmp_path / "run.json").read_text())
    assert cutbench.load(tmp_path).id == record["id"] and "curve.csv" in record["files"]


FULL = """
import resource, sys
from cutbench.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
sys.argv = ["cutbench", *sys.argv[2:]]
main()
"""


def on_a_full_disk(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", FULL, "20000", *words], capture_output=True, text=True)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size there")
def test_where_the_disk_is_full_there_is_one_message_and_the_numbers_are_there(tmp_path):
    campaign(tmp_path, "60 kPa")
    out = tmp_path / "out"
    done = on_a_full_disk("fit", str(tmp_path / "campaign.toml"), "--out", str(out))
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert str(out / "fit.png") in done.stderr
    assert json.loads((out / "fit.json").read_text())["status"] == "converged"
    assert {path.name for path in out.iterdir()} == {"fit.json", "fitted.toml"}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size there")
def test_a_map_that_does_not_fit_on_the_disk_loses_no_run(tmp_path):
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(STUDY + '[protocol]\ndepth = "0.2 mm"\n[numerics]\nh = "0.7 mm"\n')
    done = on_a_full_disk("sweep", str(study), "--out", str(out), "--workers", "0")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert str(out / "map.nc") in done.stderr and not (out / "map.nc").exists()
    assert len(list((out / "runs").glob("??/*/run.json"))) == 2


def test_results_of_another_case_are_not_written_over(tmp_path):
    base = ["run2d", "gelatin", "--h", "0.8", "--element", "P1", "--depth", "0.2", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, base).exit_code == 0
    before = (tmp_path / "curve.csv").read_bytes()
    refusal(CliRunner().invoke(app, [*base, "--set", "G=9 kPa"]), "out")
    assert (tmp_path / "curve.csv").read_bytes() == before
    assert CliRunner().invoke(app, base).exit_code == 0
