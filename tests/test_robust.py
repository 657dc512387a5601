"""A box around the map of the smooth and the abrupt: its points, and that they reach their depth."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import robustness
from cutbench.maps.study import load_study
from cutbench.run.runner import run_case

STUDY = load_study(robustness.STUDY)
COUNT = 24
POINTS = robustness.points(STUDY, COUNT, h="0.6 mm")


def test_the_box_is_the_map_made_longer_by_half():
    sides = {side.name: side for side in robustness.box(STUDY)}
    assert set(sides) == {*(axis.name for axis in STUDY.axes), "tip"}
    for axis in STUDY.axes:
        side = sides[axis.name]
        low, high = axis.values[0], axis.values[-1]
        assert side.low <= low < high < side.high
        if axis.scale == "log":
            assert np.log(side.high / side.low) == pytest.approx(1.5 * np.log(high / low))
            assert side.low / low == pytest.approx(high / side.high)
        else:
            assert side.high - high == pytest.approx((high - low) / 4)
            assert side.low == 0 if low == 0 else side.low < low
    assert (sides["tip"].low, sides["tip"].high) == (0.5, 4.0)


def test_the_points_are_a_latin_hypercube_of_the_box():
    """Each slice of each side holds one point."""
    for side in robustness.box(STUDY):
        at = np.array([float(str(side.at(part)).split()[0]) for part in (0.0, 1.0)])
        assert at == pytest.approx((side.low, side.high), rel=1e-5)
        values = np.array([value_of(case, side.name) for case in POINTS])
        if side.log:
            parts = np.log(values / side.low) / np.log(side.high / side.low)
        else:
            parts = (values - side.low) / (side.high - side.low)
        # Six digits may put a point a little beyond its slice.
        np.testing.assert_allclose(np.sort(parts), (np.arange(COUNT) + 0.5) / COUNT, atol=0.5 / COUNT + 1e-5)


def value_of(case, name):
    p = case.p
    return {
        "cohesion": p.G_c / p.delta_c / p.G, "viscosity": p.eta_reg * p.speed / p.delta_c,
        "adhesion": p.tau_W / (p.G_c / p.delta_c), "tip": p.tip,
    }[name]  # fmt: skip


def test_the_seed_decides_the_points():
    again = [case.id for case in robustness.points(STUDY, COUNT, h="0.6 mm")]
    other = [case.id for case in robustness.points(STUDY, COUNT, h="0.6 mm", seed=2)]
    assert again == [case.id for case in POINTS]
    assert len(set(again)) == COUNT
    ends = {(case.p.depth, case.until) for case in POINTS}
    assert ends == {(21.0, "depth")}, "down to the bottom, wherever the study's runs end"
    assert not set(again) & set(other)


@pytest.fixture
def script(tmp_path):
    """The script on a few short runs: (exit status, what it wrote)."""

    def call(*more, points=3):
        file = tmp_path / "found.json"
        status = robustness.main([
            "--points", str(points), "--depth", "0.1 mm", "--h", "0.6 mm", "--workers", "0",
            "--store", str(tmp_path / "store"), "--json", str(file), *more,
        ])  # fmt: skip
        return status, json.loads(file.read_text()) if file.exists() else None

    return call


def test_the_script_counts_and_computes_nothing_twice(script, runs_by, capsys):
    status, found = script()
    assert status == 0
    assert (found["points"], found["computed"], found["reached"], found["short"]) == (3, 3, 3, [])
    assert all(run["reached_mm"] == pytest.approx(0.1) for run in found["runs"])
    assert "3 of 3" in capsys.readouterr().out
    runs_by(None)  # would be called for a run that is missing
    assert script() == (status, found)


def test_the_script_goes_on_where_it_was_stopped(script, runs_by, capsys):
    calls = []

    def stop(case):
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(case.id)
        return run_case(case)

    runs_by(stop)
    status, found = script()
    assert (status, found["computed"], found["points"]) == (1, 2, 3)
    assert "1 of 3" in capsys.readouterr().out
    first, calls[:] = list(calls), [None]
    status, found = script()
    assert (status, found["computed"]) == (0, 3)
    assert len(calls) == 2 and calls[1] not in first


def test_a_run_that_falls_short_is_listed_with_its_reason(script, runs_by, capsys):
    runs_by(unlucky)
    status, found = script(points=2)
    assert status == 1
    assert found["reached"] == 0
    assert [run["message"].partition(":")[0] for run in found["short"]] == ["FloatingPointError"] * 2
    out = capsys.readouterr().out
    assert "0 of 2" in out and out.count("singular") == 2
    assert "(G_c/delta_c)/G = " in out


def unlucky(case):
    raise FloatingPointError("the matrix is singular")


@pytest.mark.parametrize(
    ("more", "named"),
    [
        (["--depth", "0.1"], "depth = '0.1'"),
        (["--h", "2 s"], "h = '2 s'"),
        (["--study", "none.toml"], "none.toml"),
    ],
)
def test_bad_input_to_the_script_is_one_message(script, capsys, more, named):
    status, found = script(*more)
    assert (status, found) == (2, None)
    err = capsys.readouterr().err
    assert named in err and "Traceback" not in err and len(err.splitlines()) == 1


def test_a_file_that_cannot_be_written_is_refused_before_any_run(capsys):
    with pytest.raises(SystemExit) as stop:
        robustness.main(["--json", "none/there/found.json"])
    assert stop.value.code == 2 and "none/there" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("case", POINTS, ids=[str(i) for i in range(COUNT)])
def test_a_point_of_the_box_reaches_the_bottom(case):
    """All of these: one short of the depth in two dozen would be more than one in a hundred.

    The layer between edge and clamp is squeezed to nothing: a tenth of a thickness above it no mesh is left.
    """
    result = run_case(case)
    assert result.displacement_mm[-1] > case.p.depth - case.p.thickness / 10, (
        f"{result.outcome} at {case.groups()}"
    )
    assert np.isfinite(result.force_N).all()
    curve = result.curve
    off = np.abs(curve["reaction_N"] - curve["force_N"])
    assert off.max() <= 1e-6 * np.abs(curve["force_N"]).max()
    # A coarse mesh cuts in jumps, which the trapezoidal rule of the ledger sees only roughly.
    assert abs(curve["closure"][-1]) < 0.05
