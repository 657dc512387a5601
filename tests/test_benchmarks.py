"""The benchmarks: each is there and can be called, what is timed, and that nothing is left out in silence."""

from __future__ import annotations

import ast
import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import __main__ as bench
from benchmarks import edges, one_run, page, peer, tools, transition
from cutbench.base.threads import ONE_THREAD
from cutbench.case.case import load_case
from cutbench.run.build import build
from cutbench.run.runner import run_case

ROOT = Path(__file__).resolve().parents[1]
#: All but what another interpreter runs.
MODULES = sorted({path.stem for path in (ROOT / "benchmarks").glob("*.py")} - {"__init__", "peer_dolfinx"})
needs_git = pytest.mark.skipif(tools.git("rev-parse", "HEAD") is None, reason="needs a git clone")


@pytest.mark.parametrize("name", MODULES)
def test_each_opens_and_says_how_it_is_called(name, capsys):
    module = importlib.import_module(f"benchmarks.{name}")
    called = re.search(
        r"``?python -m (benchmarks[\w.]*)|^ +python -m (benchmarks[\w.]*)", module.__doc__, re.M
    )
    if (
        called
        and called[0].strip("` ").split()[-1] in (f"benchmarks.{name}", "benchmarks")
        and name != "page"
    ):
        with pytest.raises(SystemExit) as stop:
            module.main(["--help"])
        kept = capsys.readouterr().out
        assert stop.value.code == 0 and ("--json" in kept or "--out" in kept)


def test_the_other_interpreters_part_is_python_too():
    ast.parse((ROOT / "benchmarks" / "peer_dolfinx.py").read_text(encoding="utf-8"))


def result(**seconds):
    """A run of 2 s."""
    return SimpleNamespace(
        timings={"assembly": 0.6, "factorization": 0.4, "solve": 0.2, "total": 2.0, **seconds},
        counts={"steps": 5, "rejected_steps": 1, "iterations": 8, "degrees_of_freedom": 99},
        outcome=SimpleNamespace(kind="done", reached_mm=0.5),
        measures={"closure": 1e-3, "onset_mm": float("nan")},
    )  # fmt: skip


def test_the_limit_is_the_part_in_factorization_and_solution_wherever_they_are_made():
    assert one_run.record(result(), 1.0)["limit"] == pytest.approx(0.3)
    window = {"window": 0.5, "window_factorization": 0.2, "window_solve": 0.1}
    assert one_run.record(result(**window), 1.0)["limit"] == pytest.approx(0.45)
    # Not known where the front's own solutions have not been timed.
    assert one_run.record(result(window=0.5), 1.0)["limit"] is None
    assert one_run.record(result(), 1.0)["onset_mm"] is None


def test_a_run_times_the_solutions_around_its_front_within_its_own_time():
    seconds = run_case(load_case("gelatin", {"depth": "0.5 mm", "h": "0.5 mm"})).timings
    around = {name: value for name, value in seconds.items() if name.startswith("window_")}
    assert around["window_factorization"] > 0 < around["window_solve"]
    assert sum(around.values()) < seconds["window"] < seconds["total"]
    outside = ("setup", "assembly", "residual", "factorization", "solve", "window")
    assert sum(seconds.get(name, 0.0) for name in outside) <= seconds["total"]


@pytest.mark.parametrize("changes", peer.PROBLEMS.values(), ids=peer.PROBLEMS)
def test_the_peers_problem_has_its_size_and_laws(changes):
    case = load_case("gelatin", changes)
    assert build(case).problem.free.size == pytest.approx(2090, rel=0.01)
    assert {"smith_ferrante", "viscous"} <= set(case.model.mechanisms)
    assert not [name for name in case.model.mechanisms if "surface" in name]
    default = load_case("gelatin").numerics
    assert case.numerics.predictor == default.predictor
    assert case.numerics.energy_step == default.energy_step < 1


def test_points_of_the_transition_lie_in_their_box():
    jobs = transition.jobs(5, seed=3)
    assert jobs == transition.jobs(5, seed=3) != transition.jobs(5, seed=4)
    cases = [load_case(job["material"], job["changes"]) for job in jobs]
    assert {case.until for case in cases} == {"transition"}
    p = [case.p for case in cases]
    values = {
        "cohesion": [q.G_c / q.delta_c / q.G for q in p],
        "viscosity": [q.eta_reg * q.speed / q.delta_c for q in p],
        "adhesion": [q.tau_W / (q.G_c / q.delta_c) for q in p],
        "mu": [q.mu for q in p],
        "tip": [q.tip for q in p],
    }
    for side in transition.BOX:
        low, high = side.low * (1 - 1e-5), side.high * (1 + 1e-5)
        assert len(set(values[side.name])) == 5 and all(low <= value <= high for value in values[side.name])


def test_sharp_blades_are_those_that_are_named_and_finer_numerics_are_finer():
    jobs = list(edges.jobs(refined=True))
    cases = [load_case(job["material"], job["changes"]) for job in jobs]
    for k in range(0, len(cases), 4):
        base, elements, steps, damage = (case.numerics for case in cases[k : k + 4])
        assert "wedge" in cases[k].mechanisms and cases[k].values["edge_radius"] in (0.05, 0.02)
        assert elements.h == base.h / 2 and steps.step == base.step / 2
        assert damage.damage_step == pytest.approx(base.damage_step / 3)
    cohesions = {round(case.groups()["(G_c/delta_c)/G"], 3) for case in cases if case.name == "meat"}
    assert {30.0, 40.0} < cohesions and len(cohesions) == 3
    record = {"material": "meat", "cpu_s": 1.0, "steps": 3, "rejected_steps": 0, "closure": 0.0,
              "onset_mm": 2.0, "peak_N": None, "drop_rel": 0.1, "told": jobs[1]["told"]}  # fmt: skip
    moved = edges.row(record, {**record, "onset_mm": 1.0, "drop_rel": 0.2})
    assert moved[-3:] == ["+100.0%", "", "-0.100"]


def command(*args):
    line = [sys.executable, "-m", "benchmarks", *args]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_the_quick_command_prints_and_writes(tmp_path):
    done = command("--quick", "--materials", "gelatin", "--json", str(tmp_path / "b.json"))
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert data["quick"] is True and data["machine"]["versions"]["numpy"] and data["older"] is None
    (run,) = data["runs"]
    assert run["run"] == "gelatin" and run["older"] is None
    assert run["here"]["outcome"] == "done" and run["here"]["reached_mm"] == pytest.approx(bench.QUICK_MM)
    assert 0 < run["here"]["limit"] < 1 and run["here"]["cpu_s"] > 0
    assert f"{run['here']['unknowns']}" in done.stdout
    assert list(tmp_path.iterdir()) == [tmp_path / "b.json"]


PACKAGE = """
from types import SimpleNamespace
class Case:
    def set(self, **changes): return self
def load_case(name, changes): return Case()
def run2d(case):
    return SimpleNamespace(
        timings={{"total": 1.0, "factorization": 0.5}}, measures={{"peak_N": {peak}}},
        counts={{"degrees_of_freedom": 9, "steps": 1}},
        outcome=SimpleNamespace(kind="{kind}", reached_mm=7.0))
"""


@pytest.fixture
def repository(tmp_path, benchmarks_of):
    """Two commits of a package that computes nothing."""
    who = ("-c", "user.name=x", "-c", "user.email=x@y.example")
    folder = tmp_path / "repository"
    (folder / "cutbench").mkdir(parents=True)
    (folder / "benchmarks").mkdir()
    shutil.copy(ROOT / "benchmarks" / "one_run.py", folder / "benchmarks")
    subprocess.run(["git", "init", "-q", str(folder)], check=True)
    for peak in (1.0, 2.0):
        (folder / "cutbench" / "__init__.py").write_text(PACKAGE.format(peak=peak, kind="done"))
        for step in (("add", "-A"), ("commit", "-q", "-m", "x")):
            subprocess.run(["git", "-C", str(folder), *who, *step], check=True, capture_output=True)
    benchmarks_of(folder)
    return folder


@needs_git
def test_an_older_commit_runs_beside_this_one(repository, tmp_path, capsys):
    asked = [
        "--against",
        "HEAD~1",
        "--materials",
        "meat",
        "--rounds",
        "2",
        "--json",
        str(tmp_path / "b.json"),
    ]
    assert bench.main(asked) == 0
    data = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    (run,) = data["runs"]
    assert (run["older"]["peak_N"], run["here"]["peak_N"]) == (1.0, 2.0)
    assert run["here"]["changes"] == run["older"]["changes"] == {"depth": "7 mm"}
    assert len(run["here"]["all_cpu_s"]) == 2 and data["older"] == tools.git("rev-parse", "HEAD~1")
    assert data["older"][:7] in capsys.readouterr().out


@needs_git
def test_a_run_that_falls_short_or_crashes_is_told(repository, capsys):
    (repository / "cutbench" / "__init__.py").write_text(PACKAGE.format(peak=1, kind="stalled"))
    assert bench.main(["--materials", "meat"]) == 1
    assert "meat: " in capsys.readouterr().err
    (repository / "cutbench" / "__init__.py").write_text("raise OSError('no such law')")
    assert bench.main(["--materials", "meat,gelatin"]) == 1
    said = capsys.readouterr().err
    assert said.count("OSError") == 2 and {"meat", "gelatin"} <= {
        line.split(":")[0].strip() for line in said.splitlines()
    }


def test_each_run_has_one_thread_and_the_package_that_was_asked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    package = PACKAGE.format(peak=1, kind="done")
    package += "import os\nassert {os.environ[name] for name in " + repr(list(ONE_THREAD)) + "} == {'1'}\n"
    (tmp_path / "cutbench").mkdir()
    (tmp_path / "cutbench" / "__init__.py").write_text(package)
    (found,) = tools.timed([tools.job("meat", 1.0)], tmp_path)
    assert found["peak_N"] == 1.0
    (tmp_path / "cutbench" / "__init__.py").rename(tmp_path / "elsewhere.py")
    (tmp_path / "cutbench").rmdir()
    with pytest.raises(RuntimeError):  # another package, or none
        list(tools.timed([tools.job("meat", 1.0, depth="0.01 mm")], tmp_path))


@pytest.mark.parametrize(
    ("args", "named"),
    [(["--rounds", "0"], "--rounds = 0"), (["--json", "/no/such/folder/b.json"], "/no/such/folder/b.json"),
     (["--materials", "gelatin,cheese"], "cheese"), (["--against", "nonsense"], "nonsense"),
     (["--write"], "--all"), (["--depth", "-1"], "--depth")],
)  # fmt: skip
def test_bad_input_is_refused_before_any_run(args, named, capsys):
    with pytest.raises(SystemExit) as stop:
        bench.main(args)
    assert stop.value.code == 2
    assert named in capsys.readouterr().err


def test_a_folder_without_history_says_what_is_needed(tmp_path, benchmarks_of, capsys):
    benchmarks_of(tmp_path)
    with pytest.raises(SystemExit):
        bench.main(["--against", "dc2113e"])
    assert "git history" in capsys.readouterr().err


def test_the_peer_that_is_not_there_is_told(capsys):
    assert peer.main(["--python", "/no/such/python"]) == 2
    assert "/no/such/python" in capsys.readouterr().err


@pytest.mark.slow
def test_the_peer_and_a_transition_run_quickly(tmp_path):
    file = tmp_path / "b.json"
    assert transition.main(["--quick", "--points", "2", "--json", str(file)]) == 0
    found = json.loads(file.read_text(encoding="utf-8"))["transition"]
    assert found["points"] == found["done"] == len(found["runs"]) == 2
    has = subprocess.run([peer.PYTHON, "-c", "import dolfinx"], capture_output=True, check=False)
    if has.returncode:
        pytest.skip("DOLFINx is not installed")
    assert peer.main(["--quick", "--rounds", "1", "--json", str(file)]) == 0
    found = json.loads(file.read_text(encoding="utf-8"))["peer"]
    assert found["measured"]["ms_per_iteration"] > 0
    assert [r["outcome"] for r in found["problems"]] == ["done", "done"]


def test_the_page_has_what_was_measured_and_the_commit():
    data = json.loads(page.DATA.read_text(encoding="utf-8"))
    text = page.PAGE.read_text(encoding="utf-8")
    assert page.renewed(text, data) == text
    assert re.fullmatch("[0-9a-f]{40}", data["commit"]) and data["changed"] is False and not data["quick"]
    words = " ".join(text.split())  # lines may break anywhere
    assert data["commit"][:7] in words and data["machine"]["cpu"] in words
    slower = json.loads(json.dumps(data))
    slower["runs"][0]["here"]["cpu_s"] *= 2
    assert page.renewed(text, slower) != text


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
    assert len({len(solid.row(r)) for r in found}) == 1
