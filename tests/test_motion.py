"""A blade that holds, returns or changes its speed: in a case, a run, a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cut_files import COARSE, campaign_of, write_readings
from refusals import refused

from benchmarks.sensitivities import Marched, extrapolated
from cutbench.calibration.cut_runs import ComputedCut, CutRuns
from cutbench.calibration.fitting import fit
from cutbench.case.case import Case, load_case
from cutbench.case.motion import Motion, read_motion, simplified
from cutbench.discovery import discover
from cutbench.run.checkpoint import Checkpoint
from cutbench.run.pool.pool import TaskPool
from cutbench.run.result import Outcome
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import extended

SPEED = 0.02  # mm/s
CASE = load_case(
    "gelatin",
    {**COARSE, "depth": "2 mm", "speed": f"{SPEED} mm/s", "with_": "maxwell", "g_1": 0.5, "tau_1": "20 s"},
)
#: Down to 1.2 mm, a minute there, back to 0.4 mm at twice the speed.
THERE = ((0.0, 0.0), (60.0, 1.2), (120.0, 1.2), (140.0, 0.4))


# -- the polyline -------------------------------------------------------------------------------------
def test_without_points_the_way_is_the_travel():
    plain = Motion(5.0, SPEED)
    assert plain.end == 5.0 and plain.travel(3.3) == 3.3 and plain.room(2.0) == 3.0 and not plain.turns(2.0)


def test_with_points_the_way_is_time_and_corners_are_met():
    m = Motion(2.0, SPEED, THERE)
    assert m.end == pytest.approx(140 * SPEED)
    assert m.travel(30 * SPEED) == pytest.approx(0.6) and m.travel(100 * SPEED) == pytest.approx(1.2)
    assert m.travel(130 * SPEED) == pytest.approx(0.8)
    assert m.room(50 * SPEED) == pytest.approx(10 * SPEED) and m.turns(60 * SPEED) and not m.turns(1.0)


def test_a_measured_way_is_reduced_to_its_corners():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 140, 300)
    d = np.interp(t, *zip(*THERE, strict=True)) + 1e-4 * rng.standard_normal(t.size)
    corners = simplified(tuple(zip(t.tolist(), d.tolist(), strict=True)))
    assert len(corners) <= 6
    np.testing.assert_allclose(np.interp(t, *zip(*corners, strict=True)), d, atol=0.01)


@pytest.mark.parametrize(
    "raw",
    [
        3,
        "60 s",
        [1, 2],
        [["0 s", "0 mm"]],
        [["1 s", "0 mm"], ["2 s", "1 mm"]],
        [["0 s", "0 mm"], ["0 s", "1 mm"]],
        [["0 s", "0 mm"], ["5 mm", "1 s"]],
        [["0 s", "0 mm"], ["5 s", "9 mm"]],
        [["0 s", "0 mm"], ["5 s", "-1 mm"]],
        [["0 s", "0 mm"], ["9 s", "1 mm"], ["8 s", "2 mm"]],
        [[0, 0], [5, float("nan")]],
    ],
)
def test_what_no_blade_can_follow_is_refused(raw):
    with refused("motion") as caught:
        CASE.set(motion=raw)
    assert caught.value.expected


def test_a_file_s_motion_is_part_of_the_case(tmp_path):
    path = tmp_path / "hold.toml"
    path.write_text(
        'base = "gelatin"\n[protocol]\nmotion = [["0 s", "0 mm"], ["1 min", "1.2 mm"], ["90 s", "1.2 mm"]]\n'
    )
    case = load_case(path)
    assert case.motion == ((0.0, 0.0), (60.0, 1.2), (90.0, 1.2))
    plain = load_case("gelatin")
    assert case.id != plain.id and case.set(G="5 kPa").motion == case.motion
    assert Case.from_dict(case.to_dict()) == case and Case.from_dict(case.to_dict()).id == case.id
    assert "motion" not in plain.to_dict()
    path.write_text(path.read_text().replace('"90 s"', '"50 s"'))
    with refused("motion", value="50 s", line=3):
        load_case(path)
    assert read_motion([[0, 0], ["2 s", 1]]) == ((0.0, 0.0), (2.0, 1.0))


# -- the run ------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def held():
    return run_case(CASE.set(motion=THERE))


def test_one_straight_line_is_the_run_without_it():
    plain = run_case(CASE.set(depth="0.6 mm"))
    line = run_case(CASE.set(depth="0.6 mm", motion=[(0, 0), (0.6 / SPEED, 0.6)]))
    np.testing.assert_allclose(line.displacement_mm, plain.displacement_mm, rtol=1e-9)
    np.testing.assert_allclose(line.force_N, plain.force_N, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(line.curve["time_s"], plain.curve["time_s"], rtol=1e-9)


def test_force_relaxes_while_the_blade_rests_and_falls_on_the_way_back(held):
    assert held.outcome.done and "1.2 mm deep" in str(held.outcome)
    t, d, F = held.curve["time_s"], held.displacement_mm, held.force_N
    rest = (t >= 60 - 1e-9) & (t <= 120 + 1e-9)
    assert t[-1] == pytest.approx(140) and d[-1] == pytest.approx(0.4)
    np.testing.assert_allclose(d[rest], 1.2, atol=1e-9)
    assert (np.diff(F[rest]) < 0).all()
    # What is left to relax falls by e in 20 s, whatever else the block does.
    at = np.interp([60, 80, 100, 120], t, F)
    assert np.diff(at)[1] / np.diff(at)[0] == pytest.approx(np.exp(-1), abs=0.06)
    assert F[-1] < 0.4 * at[-1]
    assert abs(held.curve["closure"][-1]) < 0.01
    work = np.concatenate([[0], np.cumsum(np.diff(d) * (F[1:] + F[:-1]) / 2)])
    assert work[-1] > 0  # more was done on the way down than came back


def test_without_relaxation_a_frictionless_block_gives_all_back():
    there = [(0, 0), (40, 0.8), (80, 0.8), (120, 0.05)]
    case = CASE.set(without=["maxwell", "adhesion", "viscous_degraded", "stiff_cohesion"], motion=there)
    r = run_case(case)
    down, back = (np.interp(x, r.curve["time_s"], r.force_N) for x in (20.0, 80 + 40 * 0.4 / 0.75))
    assert back == pytest.approx(down, rel=2e-3)
    rest = (r.curve["time_s"] >= 40) & (r.curve["time_s"] <= 80)
    # The damping that carries runs through snaps dies down within a step or two.
    assert np.ptp(r.force_N[rest]) < 2e-3 * r.force_N.max()


@pytest.mark.slow
def test_derivatives_hold_through_hold_and_return():
    case = CASE.set(motion=THERE, tolerance=1e-11)
    steps = 28 * [0.1]  # of the clock; they meet the corners
    names = ("G", "tau_1", "tau_W")
    middle = Marched(case, names, steps=steps)
    assert middle.forces.size == 28 and middle.lost is None and middle.unresolved == 0
    assert middle.forces[-1] < 0.5 * middle.forces.max()  # it has come back
    for i, name in enumerate(names):
        expected, apart = extrapolated(case, name, middle, i)
        size = np.abs(expected).max()
        assert apart.max() < 1e-5 * size, f"{name}: differences have no such digits"
        np.testing.assert_allclose(middle.slopes[:, i], expected, rtol=0, atol=1e-4 * size, err_msg=name)


def test_speed_is_no_parameter_of_a_motion():
    with refused("sensitivities", value="speed"):
        run_case(CASE.set(motion=THERE), sensitivities=["speed"])


def test_a_hold_goes_on_from_a_checkpoint(tmp_path, held):
    case, file = CASE.set(motion=THERE), tmp_path / "checkpoint.npz"

    def stop(done, total, text):
        if done > 90 * case.p.speed:
            raise KeyboardInterrupt

    first = run_case(case, checkpoint=Checkpoint(file, case.id), on_progress=stop)
    assert first.outcome.kind == "interrupted"
    again = run_case(case, checkpoint=Checkpoint(file, case.id))
    np.testing.assert_allclose(again.force_N, held.force_N, rtol=1e-5, atol=1e-8)


def test_a_candidate_is_looked_at_in_the_run_that_was_held():
    case = extended(CASE.set(motion=THERE, without="maxwell"), ["maxwell", "gent"])
    assert case.motion == THERE and {"maxwell", "gent"} <= {*case.mechanisms}
    with pytest.raises(TypeError):  # in the order of its fields one was forgotten
        Case("held", 2, case.mechanisms, case.values, case.numerics)


def test_discovery_computes_what_was_measured(tmp_path):
    t = np.linspace(1.0, 140.0, 40)
    d = np.interp(t, *zip(*THERE, strict=True))
    write_readings(tmp_path / "held.csv", "t [s],u [mm],F [N]", (t, d, t / 99), (4, 5, 6))
    campaign = campaign_of(
        tmp_path, "held", CASE, parameters='G = "9 kPa"', fit='free = ["G"]',
        experiment='columns = { time = "t [s]", displacement = "u [mm]", force = "F [N]" }',
    )  # fmt: skip
    (experiment,) = campaign.experiments
    asked = []

    def computed(case, names, added, folder=None, effort=0.0) -> ComputedCut:
        """A force in proportion to the travel and the modulus; a law that is added changes it later on."""
        asked.append(case)
        asked.extend(each.case for each in added)
        x = np.interp(times := np.linspace(0, case.motion[-1][0], 80), *zip(*case.motion, strict=True))
        force = 100 * case.values["G"] * x
        slopes = {n: 100 * x if n == "G" else np.zeros(80) for n in names}
        by_added = [dict.fromkeys(each.names, x**3) for each in added]
        return ComputedCut(np.stack([x, force, times]), Outcome("done", ""), np.nan, slopes, by_added)

    asked_for = replace(campaign, candidates=("gent",))
    found = discover(asked_for, runs=CutRuns(TaskPool(0), compute=computed), refine=False)
    assert found.steps and asked and all(case.motion == campaign.case(experiment).motion for case in asked)
    # What a law changes that no run has is asked beside the run at the place that was found.
    (gent,) = (s for s in found.steps[0].scores.scores if s.name == "gent")
    assert gent.sensitivity.by["held"].any()


# -- the fit ------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_a_fit_follows_the_hold_and_finds_the_relaxation(tmp_path, held):
    rng = np.random.default_rng(4)
    t = np.linspace(1.0, 140.0, 120)
    d = np.interp(t, held.curve["time_s"], held.displacement_mm)
    F = np.interp(t, held.curve["time_s"], held.force_N) + 0.003 * rng.standard_normal(t.size)
    write_readings(tmp_path / "held.csv", "t [s],u [mm],F [N]", (t, d, F), (4, 5, 6))
    campaign = campaign_of(
        tmp_path,
        "held",
        CASE,
        top=f"baseline = {[*CASE.set(without='coulomb').mechanisms]}",
        parameters='G = "9 kPa"\ng_1 = 0.3\ntau_1 = "35 s"',
        fit='free = ["G", "g_1", "tau_1"]',
        experiment='columns = { time = "t [s]", displacement = "u [mm]", force = "F [N]" }',
    )
    (experiment,) = campaign.experiments
    case = campaign.case(experiment)
    assert not experiment.monotone and 4 <= len(case.motion) <= 8
    times, travels = zip(*case.motion, strict=True)
    assert np.abs(np.interp(t, times, travels) - d).max() < 0.03
    found = fit(campaign, workers=0, refine=False)
    for name in ("G", "g_1", "tau_1"):
        estimate = found.estimate(name)
        assert estimate.low < CASE.values[name] < estimate.high, name
        assert estimate.value == pytest.approx(CASE.values[name], rel=0.25), name
