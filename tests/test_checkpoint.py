"""A run that was killed goes on from its checkpoint and ends on the same curve."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.run.checkpoint import NAME, Checkpoint
from cutbench.run.files import read_curve
from cutbench.run.runner import run_case

SMALL = {"width": "6 mm", "height": "6 mm", "length": "8 mm"}


def test_a_tree_comes_back_as_it_was(tmp_path):
    keep = Checkpoint(tmp_path / NAME, "key", every_s=0.0)
    tree = {"a": np.arange(6.0).reshape(2, 3), "b": [1, {"c": np.array([True])}, None], "d": "text", "e": {}}
    keep.offer(tree)
    found = Checkpoint(tmp_path / NAME, "key").load()
    assert found["a"].tolist() == tree["a"].tolist() and found["a"].dtype == float
    assert found["b"][1]["c"].dtype == bool
    assert (found["b"][0], found["b"][2], found["d"], found["e"]) == (1, None, "text", {})
    assert [p.name for p in tmp_path.iterdir()] == [NAME]


def test_only_the_same_run_is_resumed(tmp_path):
    keep = Checkpoint(tmp_path / NAME, "key", every_s=0.0)
    assert keep.load() is None
    keep.offer({"a": 1})
    assert Checkpoint(tmp_path / NAME, "another").load() is None
    whole = (tmp_path / NAME).read_bytes()
    for cut in (0, 10, len(whole) // 2, len(whole) - 5):
        (tmp_path / NAME).write_bytes(whole[:cut])
        assert keep.load() is None, cut
    (tmp_path / NAME).write_bytes(whole)
    assert keep.load() == {"a": 1}


def test_a_state_is_written_no_more_often_than_asked(tmp_path):
    keep = Checkpoint(tmp_path / NAME, "key", every_s=3600.0)
    keep.offer({"a": 1})
    assert not (tmp_path / NAME).exists()
    keep.write()
    assert keep.load() == {"a": 1}


@pytest.mark.parametrize(("dim", "h", "depth"), [(2, "0.6 mm", "3 mm"), (3, "1.5 mm", "1.2 mm")])
def test_an_interrupted_run_goes_on_and_ends_on_the_same_curve(tmp_path, dim, h, depth):
    case = load_case("gelatin", {**SMALL, "h": h, "corner": 0.25, "element": "P1", "depth": depth}, dim=dim)
    marks = [0.3 * case.p.depth, 0.6 * case.p.depth, case.p.depth]
    whole = run_case(case, snapshots_mm=marks, frames=4)
    seen = []

    def stop(travel, total, text):
        seen.append(travel)
        if travel > 0.5 * case.p.depth and len(seen) > 3:
            raise KeyboardInterrupt

    first = run_case(
        case, on_progress=stop, snapshots_mm=marks, frames=4,
        checkpoint=Checkpoint(tmp_path / NAME, case.id),
    )  # fmt: skip
    assert first.outcome.kind == "interrupted"
    assert first.frames[-1].displacement_mm == first.outcome.reached_mm
    seen.clear()
    again = run_case(
        case,
        on_progress=lambda travel, *_: seen.append(travel),
        snapshots_mm=marks,
        frames=4,
        checkpoint=Checkpoint(tmp_path / NAME, case.id),
    )
    assert seen[0] >= 0.4 * case.p.depth  # it did not begin anew
    assert again.outcome.done
    assert again.curve.keys() == whole.curve.keys()
    for name, column in whole.curve.items():
        scale = max(np.abs(column).max(), 1e-12)
        assert np.abs(again.curve[name] - column).max() < 1e-5 * scale, name
    assert [s.displacement_mm for s in again.snapshots] == pytest.approx(
        [s.displacement_mm for s in whole.snapshots]
    )
    assert [s.displacement_mm for s in again.frames] == pytest.approx(
        [s.displacement_mm for s in whole.frames], abs=0.05 * case.p.depth
    )
    assert again.counts["iterations"] == pytest.approx(whole.counts["iterations"], abs=3)
    for name, value in whole.measures.items():
        if name not in ("closure", "reaction_error"):
            assert again.measures[name] == pytest.approx(value, rel=1e-4, abs=1e-9, nan_ok=True), name


@pytest.mark.slow
def test_a_killed_process_goes_on(tmp_path):
    """Killed without a chance to clean up, after its first checkpoint."""
    out = tmp_path / "run"
    sets = [f"--set={key}={value}" for key, value in {**SMALL, "element": "P1"}.items()]
    command = ["run3d", "gelatin", *sets, "--h=1.5", "--depth=0.5", "--no-plane-strain", "--checkpoint=0"]
    process = subprocess.Popen(
        [sys.executable, "-m", "cutbench", *command, f"--out={out}"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    until = time.monotonic() + 120
    while not (out / NAME).exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.002)
    process.kill()
    process.wait(timeout=30)
    assert (out / NAME).exists() and not (out / "run.json").exists()
    with np.load(out / NAME) as file:
        reached = dict(json.loads(str(file["tree"]))["dict"])["progress"]
    done = CliRunner().invoke(app, [*command, f"--out={out}"])
    assert done.exit_code == 0, done.output
    assert not (out / NAME).exists()
    assert dict(reached["dict"])["pseudo_time_mm"] > 0
    whole = CliRunner().invoke(app, [*command, f"--out={tmp_path / 'whole'}"])
    assert whole.exit_code == 0, whole.output
    a, b = read_curve(out), read_curve(tmp_path / "whole")
    assert a["displacement_mm"] == pytest.approx(b["displacement_mm"], abs=1e-9)
    assert np.abs(a["force_N"] - b["force_N"]).max() < 1e-6 * b["force_N"].max()
