"""Calibration: truths are found again, intervals hold, and what cannot be known is said."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import runs_by_formula
from refusals import refused
from typer.testing import CliRunner

from benchmarks import synthetic
from benchmarks.blind_campaigns import Planned, make
from benchmarks.synthetic import Noise, Test, campaign
from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import Until
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.fitting import LATE, fit
from cutbench.calibration.report import report, summary, to_dict, write_fit
from cutbench.case.case import Case, load_case
from cutbench.cli.main import app
from cutbench.data import Experiment, Repetition
from cutbench.data.campaign import Campaign, FitPlan, load_campaign, start_case
from cutbench.run.pool.pool import TaskPool
from cutbench.run.runner import run_case

RUBBER = "studies/rubber/treloar.toml"


def moved(case: Case, **factors: float) -> Case:
    values = {**case.values, **{name: case.values[name] * f for name, f in factors.items()}}
    return replace(case, values=values)


def stretching(seed: int = 0, readings: int = 60, **options):
    """Tension and pure shear of a strain-stiffening solid; three specimens each."""
    truth, _ = start_case(
        None,
        baseline=["gent", "volumetric"],
        kinds=("uniaxial",),
        parameters={"G": "40 kPa", "nu": 0.4999, "inv_J_m": 0.05},
    )
    role = options.pop("role", "train")
    tests = (
        Test("tension", "uniaxial", speed=0.1, reach=2.5, readings=readings),
        Test("shear", "pure_shear", speed=0.1, reach=2.2, readings=readings, role=role),
    )
    plan = FitPlan(free=("G", "inv_J_m"))
    return truth, campaign(
        truth, tests, moved(truth, G=1.6, inv_J_m=0.5), seed=seed, plan=options.pop("plan", plan), **options
    )


def test_a_homogeneous_campaign_gives_its_truth_back():
    truth, made = stretching(seed=3)
    found = fit(made)
    assert found.status == "converged"
    for e in found.estimates:
        assert e.low < truth.values[e.label] < e.high, e.label
        assert abs(e.value / truth.values[e.label] - 1) < 0.1
        assert not e.at_bound and e.moved
    assert 0.5 < found.reduced_chi2 < 2


def strips(*moduli_kPa: float, specimens: int = 3):
    """Tension of strips, a test each of its own modulus: one is asked for."""
    base, _ = start_case(
        None,
        baseline=["neo_hookean", "volumetric"],
        kinds=["uniaxial"],
        parameters={"G": "80 kPa", "nu": 0.4999},
    )
    stretch, rng = np.linspace(1.02, 1.5, 40), np.random.default_rng(3)
    tests = []
    for number, G in enumerate(moduli_kPa):
        curves = [
            1e-3 * G * (stretch - stretch**-2) * (1 + 0.01 * rng.standard_normal())
            + 1e-4 * rng.standard_normal(40)
            for _ in range(specimens)
        ]
        made = tuple(Repetition(stretch, y, name=f"{number}{k}") for k, y in enumerate(curves))
        tests.append(Experiment(f"strip {number}", "uniaxial", made))
    return Campaign("strips", base, tuple(tests), plan=FitPlan(free=("G",)))


def test_an_interval_holds_what_tests_contradict_each_other_about():
    """Each test is as sure of its own modulus as those that agree."""
    (alike,), (apart,) = fit(strips(90, 90, 90)).estimates, fit(strips(80, 90, 100)).estimates
    assert alike.low < 0.090 < alike.high and alike.high - alike.low < 0.006
    assert apart.low < 0.080 and 0.100 < apart.high < 0.150


def test_what_it_misses_is_what_is_drawn():
    """In words the largest residual of a fitted curve; χ² would be in units of the misfit."""
    _, made = stretching(plan=FitPlan(free=("G",), fixed=("inv_J_m",)))
    found = fit(replace(made, base=moved(made.base, inv_J_m=0.01)))
    worst = max(c.relative_rmse for c in found.compared)
    assert worst > 0.03 and f"{100 * worst:.1f} %" in "".join(report(found).sentences)
    assert "chi2" not in summary(found)


def test_without_noise_it_is_exact():
    # As many readings as values compared: nothing is averaged.
    truth, made = stretching(readings=40, noise=Noise(scatter=0.0, reading=0.0))
    found = fit(made)
    for e in found.estimates:
        assert e.value == pytest.approx(truth.values[e.label], rel=1e-5)


@pytest.mark.slow
def test_intervals_hold_as_often_as_they_say():
    inside = []
    for seed in range(40):
        truth, made = stretching(seed=seed)
        inside += [e.low < truth.values[e.label] < e.high for e in fit(made).estimates]
    # 80 values at 95 %: fewer than 69 or so would be a chance of one in a thousand.
    assert 69 <= sum(inside) <= 80


def test_the_common_factor_of_specimens_sets_the_interval():
    # With 3 % between specimens and next to no reading noise G is known to 3 %/sqrt(6), not to the noise.
    relative = []
    for seed in range(12):
        _, made = stretching(seed=seed, noise=Noise(scatter=0.03, reading=1e-3))
        found = fit(made).estimate("G")
        relative.append(found.sd / found.value)
        assert found.dof < 12
    assert 0.007 < np.median(relative) < 0.02


def test_a_test_experiment_is_predicted_and_not_fitted():
    _, made = stretching(seed=1, role="test")
    found = fit(made)
    roles = {c.experiment.id: c.experiment.role for c in found.compared}
    assert roles == {"tension": "train", "shear": "test"}
    alone = replace(made, experiments=made.train)
    assert fit(alone).values == found.values
    assert "predicted" in summary(found)


def test_what_the_data_cannot_tell_stays_where_it_is_and_is_named():
    _, made = stretching(seed=1, plan=FitPlan())
    found = fit(made)
    # The volume: nearly incompressible in all tests. It is not looked for unless asked.
    assert "nu" not in found.values
    # Small stretches say nothing of the stiffening.
    truth, _ = stretching(seed=1)
    small = Test("small", "uniaxial", speed=0.1, reach=1.05, readings=40)
    made = campaign(truth, (small,), moved(truth, G=1.5), seed=1)
    found = fit(made)
    assert set(found.values) == {"G"}
    assert "inv_J_m" in found.fixed
    assert "inv_J_m" in summary(found)


def test_own_values_for_each_experiment():
    truth, made = stretching(seed=2, plan=FitPlan(free=("inv_J_m",), own=("G",)))
    found = fit(made)
    assert set(found.values) == {"G[tension]", "G[shear]", "inv_J_m"}
    for label in ("G[tension]", "G[shear]"):
        assert found.estimate(label).low < truth.values["G"] < found.estimate(label).high


def test_a_bound_is_kept_and_said():
    _, made = stretching(seed=2, plan=FitPlan(free=("G", "inv_J_m"), bounds={"G": (0.045, 0.2)}))
    found = fit(made)
    G = found.estimate("G")
    assert G.at_bound and G.value == pytest.approx(0.045)
    assert to_dict(found)["parameters"]["G"]["at_bound"]


def test_a_profile_agrees_with_the_interval_where_the_problem_is_nearly_linear():
    _, made = stretching(seed=4)
    found = fit(made, profile=["G"])
    (profile,) = found.profiles
    G = found.estimate("G")
    assert profile.low == pytest.approx(G.low, rel=0.01)
    assert profile.high == pytest.approx(G.high, rel=0.01)
    assert profile.rise.min() >= -1e-6
    with refused("profile", value="tau_W"):
        fit(made, profile=["tau_W"])


def test_neo_hooke_on_rubber_fails_as_it_must():
    found = fit(load_campaign(RUBBER))
    errors = {c.experiment.id: c.rmse / np.abs(c.mean).max() for c in found.compared}
    # No curve G (λ − 1/λ²) comes nearer to the tension than the least squares' one; the fit's is hardly off.
    c = next(c for c in found.compared if c.experiment.id == "tension")
    unit = c.x - c.x**-2
    least = c.mean - unit * (unit @ c.mean) / (unit @ unit)
    assert c.rmse < 1.05 * np.sqrt((least**2).mean())
    assert found.estimate("G").value == pytest.approx(unit @ c.mean / (unit @ unit), rel=0.1)
    assert errors["tension"] > 0.1 and errors["pure shear"] > 0.25
    # What noise does not explain is said in per cent of the curve, and is no part of what is scattered.
    assert c.misfit == pytest.approx(c.rmse / np.abs(c.mean).max(), rel=0.2) and found.reduced_chi2 < 2
    assert found.case.model.described in summary(found)


def test_the_command_writes_what_it_found(tmp_path):
    result = CliRunner().invoke(app, ["fit", RUBBER, "--out", str(tmp_path / "fit")])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "fit" / "fit.png").stat().st_size > 10_000
    found = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))
    assert found["parameters"]["G"]["unit"] == "kPa"
    assert found["parameters"]["G"]["low"] < 541 < found["parameters"]["G"]["high"]
    assert {"neo_hookean", "volumetric"} <= set(found["model"].split(", "))
    assert found["experiments"]["equibiaxial"]["role"] == "test"


@pytest.mark.parametrize(
    ("plan", "key"),
    [
        (FitPlan(free=("tau_W",)), "free"),
        (FitPlan(own=("height",)), "own"),
        (FitPlan(fixed=("no_such",)), "fixed"),
        (FitPlan(fixed=("G", "inv_J_m", "nu")), "free"),
    ],
)
def test_plans_that_are_refused(plan, key):
    _, made = stretching(plan=plan)
    with refused(key):
        fit(made)


#: Cut from the first tenths of a millimetre on, on a mesh for tests.
SOLID = load_case("gelatin").set(
    tip="3 mm",
    cohesion=2.0,
    tau_W="2 kPa",
    eta_reg="5 s",
    h="0.8 mm",
    corner=0.125,
    shallow=1.0,
    step="0.1 mm",
    penalty="200 1/mm",
    stick="80 1/mm",
    multiplier="none",
    normal="material",  # elements larger than the tip is round
    element="P1",
)


def cutting(**options):
    tests = (Test("slow", reach=1.0, readings=60), Test("fast", speed=0.1, reach=1.0, readings=60))
    start = moved(SOLID, G=1.3, G_c=0.8)
    plan = options.pop("plan", FitPlan(free=("G", "G_c")))
    return campaign(SOLID, tests[: options.pop("count", 2)], start, plan=plan, **options)


@pytest.mark.parametrize("offset", [-0.3, 0.4])
def test_a_cut_with_a_wrong_zero_is_made_up_from_contact_on(offset):
    case = SOLID.set(with_="contact_offset", offset=f"{offset} mm")
    x, y, t = synthetic.clean(case, Test("cut", reach=1.0, readings=20))
    assert x.size == 20 and x[0] > max(offset, 0.0)
    assert np.all(np.diff(t) > 0) and np.all(np.isfinite(y))


@pytest.mark.slow
def test_a_cutting_campaign_gives_its_truth_back():
    told = []
    found = fit(cutting(seed=5), workers=0, refine=False, on_progress=lambda *at: told.append(at))
    assert found.status == "converged"
    counts = [done for done, _, _ in told]
    assert counts and counts == sorted(counts)
    for e in found.estimates:
        assert e.low < SOLID.values[e.label] < e.high, e.label
    assert found.estimate("G").value == pytest.approx(SOLID.values["G"], rel=0.06)
    (slow, _) = found.compared
    assert list(slow.regimes())[-2:] == ["onset", "transition"]
    data = to_dict(found)
    assert data["experiments"]["slow"]["regimes"]["onset"]["to_mm"] <= 1.0
    assert set(data["parameters"]) == {"G", "G_c"}


@pytest.mark.slow
def test_what_was_computed_before_a_stop_is_not_computed_again(tmp_path):
    made, asked = cutting(seed=5), []

    def stops():
        asked.append(())
        if len(asked) > 8:
            raise KeyboardInterrupt

    stopped = fit(made, runs=CutRuns(TaskPool(0), tmp_path, stops), refine=False)
    assert stopped.status == "interrupted"
    before = written(tmp_path)
    assert before
    found = fit(made, workers=0, refine=False, store=tmp_path)
    runs = written(tmp_path)
    assert found.status == "converged" and before.items() < runs.items()
    # A run that cannot be read is computed again, and none of the others.
    broken, *_ = tmp_path.glob("??/*/curve.npz")
    broken.write_bytes(broken.read_bytes()[:100])
    again = fit(made, workers=0, refine=False, store=tmp_path)
    after = written(tmp_path)
    assert {path.parent for path in after if after[path] != runs.get(path)} == {broken.parent}
    for e in again.estimates:
        assert e.value == pytest.approx(found.values[e.label], rel=1e-3)


def written(store: Path) -> dict[Path, int]:
    """When each record and curve of a store was written."""
    return {path: path.stat().st_mtime_ns for path in store.glob("??/*/*.*")}


def by_formula(folder, *free: str):
    """Cuts with forces by a formula of which ``free`` are looked for, and their truth."""
    planned = Planned(0, "cut", (), ("cohesion as printed", "ellipse"))
    truth = make(planned, 2, folder, run=runs_by_formula.run_case, specimens=1)
    made = load_campaign(truth.file)
    return truth, replace(made, plan=FitPlan(free=free)) if free else made


def interrupted(made, after: int):
    """A fit that is interrupted instead of one more cut."""
    formula = runs_by_formula.Counted()

    def stops(*asked):
        if formula.count >= after:
            raise KeyboardInterrupt
        return formula(*asked)

    found = fit(made, runs=CutRuns(TaskPool(0), compute=stops), refine=False)
    assert formula.count == after
    return found


def test_an_interruption_takes_the_best_of_the_cuts_that_were_computed(tmp_path):
    """And says that it is no estimate, not that the model is wrong."""
    truth, made = by_formula(tmp_path, "G", "G_c")
    made = replace(made, base=made.base.set(G=f"{2 * truth.values['G']!r} MPa"))
    start, late = interrupted(made, 3), interrupted(made, 8)
    errors = [np.mean([c.rmse / c.mean.max() for c in each.compared[:3]]) for each in (start, late)]
    assert errors[1] < 1.05 * errors[0] and (start.runs, late.runs) == (3, 8)
    assert [re.findall(r"\d+", each.message) for each in (start, late)] == [["3"], ["8"]]
    assert not start.far and not start.before.sentences


def test_a_run_that_takes_many_times_as_long_as_others_is_given_up(tmp_path):
    formula, efforts = runs_by_formula.Counted(), []

    def tells(case, names, added, folder, effort):
        efforts.append(effort)
        return replace(formula(case, names, added), effort=100)

    _, made = by_formula(tmp_path, "G", "G_c")
    fit(made, runs=CutRuns(TaskPool(0), compute=tells), refine=False)
    assert math.isinf(efforts[0]) and 200 <= efforts[-1] <= 3000
    with pytest.raises(ComputationFailed, match="given up"):
        run_case(made.base.set(depth="2 mm", h="0.7 mm"), effort=5)


@pytest.mark.parametrize("after", [0, 5])
def test_an_interruption_keeps_what_was_reached(after, tmp_path):
    _, made = by_formula(tmp_path, "G", "G_c")
    found = interrupted(made, after)
    assert found.status == "interrupted" and not found.done
    assert all(np.isnan([e.low, e.high, e.sd]).all() for e in found.estimates)
    assert ("atlas" in found.message) == (after == 0)  # before any run that alone is known
    assert [c.experiment.id for c in found.compared][:3] == ["slow", "middle", "fast"]
    (tmp_path / "fitted.toml").write_text("# of an earlier fit")
    write_fit(found, tmp_path)
    assert json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))["status"] == found.status
    assert not (tmp_path / "fitted.toml").exists()


@pytest.mark.slow
def test_a_place_that_was_reached_is_told_and_is_no_estimate(tmp_path):
    _, made = by_formula(tmp_path, "G", "G_c")
    made = replace(made, experiments=made.train)
    formula = runs_by_formula.Counted()
    whole = fit(made, runs=CutRuns(TaskPool(0), compute=formula), refine=False)
    found = interrupted(made, formula.count - 1)  # at the last place
    assert whole.status == "converged" and found.status == "interrupted"
    assert all(np.isnan([e.low, e.high, e.sd]).all() for e in found.estimates)
    assert len(found.compared) == 3


@pytest.mark.slow
def test_an_interruption_while_tests_are_predicted_keeps_the_fit(tmp_path):
    _, made = by_formula(tmp_path, "G", "G_c")
    formula = runs_by_formula.Counted()
    whole = fit(made, runs=CutRuns(TaskPool(0), compute=formula), refine=False)
    try:
        found = interrupted(made, formula.count - 1)  # the last cut is that of the test that is predicted
    except KeyboardInterrupt:
        pytest.fail("a whole fit is lost")
    assert [e.value for e in found.estimates] == [e.value for e in whole.estimates]


def test_a_fit_that_does_not_end_in_time_says_so(tmp_path):
    _, made = by_formula(tmp_path, "G", "G_c")
    runs = CutRuns(TaskPool(0), check=Until(0.0), compute=runs_by_formula.Counted())
    found = fit(made, runs=runs, limit_s=0.0)
    assert found.status == LATE and not found.done
    assert found.status in summary(found)


@pytest.mark.slow
def test_a_fit_goes_on_from_its_store_and_computes_nothing_twice(tmp_path):
    formulas, found = [runs_by_formula.Counted() for _ in range(2)], []
    _, made = by_formula(tmp_path, "G", "G_c")
    for each in formulas:
        found.append(fit(made, runs=CutRuns(TaskPool(0), tmp_path / "runs", compute=each), refine=False))
    first, same = found
    assert first.status == same.status == "converged" and formulas[0].count > 10
    # Those with derivatives, which a formula leaves in no store.
    assert formulas[1].count == len(made.train)
    for e in same.estimates:
        assert e.value == pytest.approx(first.values[e.label], rel=1e-3)


@pytest.mark.slow
def test_derivatives_that_end_on_the_way_end_no_fit(tmp_path):
    formula, (truth, made) = runs_by_formula.Counted(), by_formula(tmp_path)

    def singular(*asked):
        made = formula(*asked)
        lost = made.course[0] > 2.0
        return replace(made, slopes={n: np.where(lost, np.nan, s) for n, s in made.slopes.items()})

    found = fit(made, runs=CutRuns(TaskPool(0), compute=singular), refine=False)
    assert found.status == "converged"
    assert found.estimate("G").value == pytest.approx(truth.values["G"], rel=0.1)


def test_cuts_of_which_none_can_be_computed_are_said(tmp_path):
    def fails(*asked):
        raise ComputationFailed("no way")

    _, made = by_formula(tmp_path, "G")
    with pytest.raises(ComputationFailed, match="no way"):
        fit(made, runs=CutRuns(TaskPool(0), compute=fails))


@pytest.mark.slow
def test_a_cut_that_cannot_be_computed_with_some_values_ends_no_fit(tmp_path):
    formula, (truth, made) = runs_by_formula.Counted(), by_formula(tmp_path, "G", "G_c")

    def fails(case, *asked):
        if case.values["G"] > 1.6 * truth.values["G"]:
            raise ComputationFailed("too stiff")
        return formula(case, *asked)

    runs = CutRuns(TaskPool(0), compute=fails)
    found = fit(made, runs=runs, refine=False)
    assert runs.failed and found.status == "converged"


@pytest.mark.slow
def test_with_the_error_of_the_mesh_and_two_processes():
    found = fit(cutting(seed=5), workers=2)
    assert found.status == "converged"
    assert any("finer numerics" in note for note in found.notes)
    for e in found.estimates:
        assert e.low < SOLID.values[e.label] < e.high, e.label
