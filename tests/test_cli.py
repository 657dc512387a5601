"""What the command line does with a run: files, exit status, messages. The run itself is made up."""

from __future__ import annotations

import json
import re
from pathlib import Path
from shutil import copy
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from cutbench.base.errors import ComputationFailed
from cutbench.cli.main import app
from cutbench.run.result import Outcome, Result


def invoke(*args: object):
    return CliRunner().invoke(app, [str(a) for a in args])


@pytest.fixture
def solver(runs_by):
    """A stand-in for the solver that notes what it was asked and ends as it is told."""
    asked = SimpleNamespace(case=None, snapshots=None, kind="done", raises=None)

    def run_case(case, *, on_progress=None, snapshots_mm=(), frames=None, checkpoint=None):
        asked.case, asked.snapshots = case, list(snapshots_mm)
        if asked.raises is not None:
            raise asked.raises
        travel = np.linspace(0.0, case.p.depth, 22)
        force = 0.1 * travel
        zero = np.zeros_like(travel)
        for at, value in zip(travel, force, strict=True):
            on_progress(float(at), case.p.depth, f"{value:.3g} N")
        curve = {
            "displacement_mm": travel,
            "force_N": force,
            "time_s": travel / case.p.speed,
            "cut_length_mm": np.maximum(travel - 3, 0),
            "force_neo_hookean_N": force,
            "work_neo_hookean_mJ": 0.05 * travel**2,
            "reaction_N": force,
            "closure": zero,
        }
        return Result(
            case, curve, Outcome(asked.kind, "made up", "", case.p.depth), {"total": 0.1}, {"steps": 21}
        )

    runs_by(run_case)
    return asked


def test_options_reach_the_case(solver, tmp_path):
    done = invoke(
        "run2d", "gelatin", "--set", "eta_reg=0.5 s", "--set", "cohesion=9", "--h", "0.3", "--depth", "8 mm",
        "--element", "P1", "--normal", "material", "--without", "coulomb", "--with", "viscous",
        "--out", tmp_path,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    case = solver.case
    assert (case.p.eta_reg, case.p.depth, case.sizes.h_mm) == (0.5, 8.0, 0.3)
    assert (case.numerics.element, case.numerics.normal) == ("P1", "material")
    assert case.groups()["(G_c/delta_c)/G"] == pytest.approx(9)
    assert "viscous" in case.mechanisms
    assert not {"coulomb", "viscous_degraded"} & set(case.mechanisms)
    assert solver.snapshots == [2.0, 4.0, 6.0, 8.0]


def test_a_run_is_written_and_can_be_drawn_again(solver, tmp_path):
    out = tmp_path / "out"
    assert invoke("run2d", "meat", "--out", out).exit_code == 0
    assert json.loads((out / "run.json").read_text(encoding="utf-8"))["outcome"]["kind"] == "done"
    assert (out / "curve.csv").read_text(encoding="utf-8").startswith("displacement_mm,force_N,time_s")
    (out / "curve.png").unlink()
    again = invoke("plot", out)
    assert again.exit_code == 0, again.output
    assert (out / "curve.png").is_file()


def test_several_runs_are_drawn_into_one_picture(solver, tmp_path):
    for name in ("meat", "gelatin"):
        assert invoke("run2d", name, "--out", tmp_path / name).exit_code == 0
    both = [tmp_path / name for name in ("meat", "gelatin")]
    done = invoke("plot", *both, "--out", tmp_path / "both.svg")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "both.svg").read_text(encoding="utf-8")
    assert ">meat<" in text and ">gelatin<" in text
    assert invoke("plot", *both, "--out", tmp_path / "both.gif").exit_code == 2
    assert invoke("plot", both[0], tmp_path / "nowhere", "--out", tmp_path / "b.png").exit_code == 2


@pytest.mark.parametrize(
    ("size", "width_mm", "ratio", "type_pt"), [("paper", 85.0, None, 8.0), ("slide", 160.0, 16 / 9, 11.0)]
)
def test_a_picture_has_the_size_and_the_type_that_are_asked_for(
    size, width_mm, ratio, type_pt, solver, tmp_path
):
    assert invoke("run2d", "meat", "--out", tmp_path / "run").exit_code == 0
    (tmp_path / "map").mkdir()
    copy(Path(__file__).parents[1] / "studies" / "results" / "boundary" / "map.nc", tmp_path / "map")
    for sources in (["run"], ["run", "run"], ["map"]):
        out = tmp_path / "out.svg"
        done = invoke("plot", *(tmp_path / each for each in sources), "--out", out, "--size", size)
        assert done.exit_code == 0, done.output
        head = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"|$', text := out.read_text(encoding="utf-8"))
        width, height = (float(pt) / 72 * 25.4 for pt in head.groups())
        assert width == pytest.approx(width_mm, abs=0.1)
        assert ratio is None or width / height == pytest.approx(ratio, rel=1e-3)
        # What is smaller is a subscript.
        types = [float(pt) for pt in re.findall(r"font-size: ([\d.]+)px", text)]
        assert max(types) == pytest.approx(type_pt) and types.count(max(types)) > 0.6 * len(types)


def test_a_size_needs_a_file_and_a_name_that_is_known(solver, tmp_path):
    assert invoke("run2d", "meat", "--out", tmp_path).exit_code == 0
    wrong = {"--out": ["--size", "paper"], "poster": ["--size", "poster", "--out", tmp_path / "a.pdf"]}
    for named, options in wrong.items():
        done = invoke("plot", tmp_path, *options)
        assert done.exit_code == 2 and named in done.output
        assert "Traceback" not in done.output and not (tmp_path / "a.pdf").exists()


def test_default_folder_names_the_case(solver, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke("run2d", "gelatin").exit_code == 0
    assert (tmp_path / "runs" / f"gelatin-{solver.case.id}" / "run.json").is_file()


@pytest.mark.parametrize(("kind", "code"), [("done", 0), ("stalled", 1), ("failed", 1), ("interrupted", 130)])
def test_exit_status_says_how_it_ended_and_what_was_reached_is_kept(kind, code, solver, tmp_path):
    solver.kind = kind
    done = invoke("run2d", "gelatin", "--out", tmp_path)
    assert done.exit_code == code
    assert f"{kind}: made up" in done.output
    assert (tmp_path / "curve.csv").is_file()


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [(ComputationFailed("the mesh inverted"), 1, "inverted"), (KeyboardInterrupt(), 130, "interrupted")],
)
def test_errors_become_one_message_and_a_status(error, code, said, solver, tmp_path):
    solver.raises = error
    done = invoke("run2d", "gelatin", "--out", tmp_path)
    assert done.exit_code == code
    assert said in done.output
    assert "Traceback" not in done.output


@pytest.mark.parametrize("tip", ["12 mm", "10.2 mm", "30 mm"])
def test_advice_about_the_tip_holds_when_it_is_followed(tip, solver, tmp_path):
    import re

    coarse = ("--h", "0.25")
    refused = invoke("run2d", "gelatin", "--set", f"tip={tip}", *coarse, "--out", tmp_path)
    assert refused.exit_code == 2
    h, longest = re.search(r"h = '(.+?) mm' would do, or a tip of at most (\S+) mm", refused.output).groups()
    assert invoke("run2d", "gelatin", "--set", f"tip={tip}", "--h", h, "--out", tmp_path).exit_code == 0
    other = ("--out", tmp_path / "other")
    assert invoke("run2d", "gelatin", "--set", f"tip={longest} mm", *coarse, *other).exit_code == 0


@pytest.mark.parametrize("corner", [0.1, 0.5])
def test_a_sweep_says_once_what_its_runs_are_to_be_doubted_for(corner, tmp_path, monkeypatch, runs_by):
    def no_run(case):
        raise KeyboardInterrupt

    runs_by(no_run)
    study = tmp_path / "coarse.toml"
    study.write_text(
        f'base = "gelatin"\n[numerics]\nh = "1 mm"\ncorner = {corner}\n'
        '[[axis]]\nname = "cohesion"\nvalues = [5.0, 9.0]\n',
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    said = invoke("sweep", study, "--workers", 0)
    assert said.exit_code == 130, said.output
    assert (tmp_path / "maps" / "coarse").is_dir()
    assert said.output.count("corner =") == (corner == 0.5)


def test_the_bare_name_says_what_to_begin_with_and_each_of_it_is_there():
    done = CliRunner().invoke(app, [])
    first, _, _ = done.output.partition("Usage")
    commands = re.findall(r"^  cutbench (\w+)", first, re.M)
    assert done.exit_code == 0 and {"estimate", "run2d", "sweep", "fit", "app"} <= set(commands)
    assert set(commands) <= {command.callback.__name__ for command in app.registered_commands}
