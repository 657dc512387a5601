"""What is asked before physics: record, machine, what was held fixed. And what must not change a verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from invented import AREA_MM2, G_MPA, LENGTH_MM

from cutbench.calibration.fitting import fit
from cutbench.data.campaign import Campaign, FitPlan, start_case
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition
from cutbench.discovery import discover
from cutbench.discovery.report import to_dict, verdict_sentence
from cutbench.homogeneous import predict, slopes

#: Without those that remember, which take long.
SUSPECTS = (
    "gent", "yeoh", "compressible", "machine_compliance", "gauge_length", "contact_offset", "force_zero"
)  # fmt: skip
seeds = pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
SIZES = {"length": LENGTH_MM, "area": AREA_MM2}


def pulled(id: str, reach: float, role: str = "train", *, count=120, gives=0.0, stiffening=0.0, seed=0):
    """Five strips of constant volume that a machine of compliance ``gives`` (mm/N) pulls."""
    rng, stretch = np.random.default_rng([seed, len(id), round(100 * reach)]), np.linspace(1, reach, count)
    stress = G_MPA * (stretch - stretch**-2) * (1 + stiffening * (stretch**2 + 2 / stretch - 3))
    made = []
    for k in range(5):
        read = stress * (1 + 0.03 * rng.standard_normal())
        u = LENGTH_MM * (stretch - 1) + gives * read * AREA_MM2
        noisy = read + 0.01 * stress.max() * rng.standard_normal(count)
        made.append(Repetition(1 + u / LENGTH_MM, noisy, None, str(k)))
    return Experiment(id, "uniaxial", tuple(made), role, SIZES)


def of(tests, *, nu: float = 0.4999, candidates=None, G_MPa=0.02) -> Campaign:
    start, _ = start_case(
        None,
        baseline=["neo_hookean", "volumetric"],
        kinds=("uniaxial",),
        parameters={"G": f"{G_MPa} MPa", "nu": nu},
    )
    plan = FitPlan(free=("G",))
    return Campaign("invented", start, tuple(tests), SUSPECTS if candidates is None else candidates, plan)


def strips(**how):
    return [pulled("far", 2.6, **how), pulled("near", 1.6, **how), pulled("other", 2.2, "test", **how)]


@seeds
def test_a_wrong_fixed_value_is_no_stiffening(seed):
    d = discover(of(strips(seed=seed), nu=0.47), workers=0)
    assert d.names == ("nu",), verdict_sentence(d)
    assert to_dict(d)["kinds"] == {"nu": "parameter"} and d.final.values()["nu"] > 0.49
    assert "nu" in verdict_sentence(d)


@seeds
def test_nothing_is_named_where_it_is_right(seed):
    assert discover(of(strips(seed=seed)), workers=0).verdict == "none"


@pytest.mark.slow
@seeds
def test_a_machine_that_gives_is_a_rig(seed):
    d = discover(of(strips(seed=seed, gives=9.0)), workers=0)
    assert d.verdict == "mechanism" and to_dict(d)["kinds"] == {d.names[0]: "rig"}, verdict_sentence(d)
    assert "machine_compliance" in d.found[0].group


def all_evidence(stiffer: float) -> dict[str, float]:
    """Of strips with all forces times as much, and a machine that gives as much less."""
    tests = []
    for e in strips(gives=9.0, count=40):
        forces = [replace(r, y=stiffer * r.y) for r in e.repetitions]
        tests.append(replace(e, repetitions=tuple(forces)))
    few = ("machine_compliance", "contact_offset", "force_zero")
    d = discover(of(tests, candidates=few, G_MPa=0.02 * stiffer), workers=0)
    assert "machine_compliance" in d.found[0].group
    return {c.name: c.evidence for step in d.steps for c in step.compared}


def test_no_evidence_depends_on_the_unit_of_force():
    one = all_evidence(1.0)
    assert len(one) > 2
    assert all_evidence(100.0) == pytest.approx(one, abs=0.1)


@pytest.mark.slow
def test_stiffening_is_no_machine():
    d = discover(of(strips(stiffening=0.1)), workers=0)
    assert d.verdict == "mechanism" and d.names[0] in ("gent", "yeoh"), verdict_sentence(d)


def test_a_machine_is_no_suspect_where_nobody_knows_the_specimen():
    bare = [replace(e, specimen={}) for e in strips()]
    left_out = discover(of(bare, candidates=("machine_compliance", "gent")), workers=0).steps[0].left_out
    assert "length" in left_out["machine_compliance"]


@pytest.mark.parametrize(("name", "low", "high"), [("inv_J_m", 0.0, 0.004), ("nu", 0.4, 0.4999)])
def test_bounds_of_the_plan_hold_for_what_is_added_too(name, low, high):
    """Those that a person writes, and those that the contact in a record leaves."""
    asked = of(strips(stiffening=0.1), nu=0.48, candidates=("gent",))
    bounded = replace(asked, plan=replace(asked.plan, bounds={name: (low, high)}))
    values = [each.fitted.values() for each in discover(bounded, workers=0).steps[0].compared]
    assert any(name in each for each in values)
    assert all(low <= each.get(name, low) <= high for each in values)


@pytest.mark.parametrize("laws", [(), ("maxwell",)])
def test_derivatives_by_the_rig_are_exact(laws):
    rigs = ("machine_compliance", "contact_offset", "force_zero", "force_drift", "gauge_length")
    values = {"G": "0.03 MPa", "compliance": "2 mm/N", "offset": "0.3 mm", "zero": "0.01 N",
              "drift": "1e-3 N/s", "longer": 0.1}  # fmt: skip
    values |= {"g_1": 0.4, "tau_1": "3 s"} if laws else {}
    case, _ = start_case(
        None, baseline=["neo_hookean", "volumetric", *laws, *rigs], kinds=("uniaxial",), parameters=values
    )
    e = pulled("far", 2.0)
    timed = [replace(r, time_s=np.arange(r.x.size, dtype=float)) for r in e.repetitions]
    e = replace(e, repetitions=tuple(timed))
    grid, names = e.on_grid(20), ["compliance", "offset", "zero", "drift", "longer", "G"]
    _, J = slopes(e, case.model, case.p, names, grid)
    for k, name in enumerate(names):
        step = 1e-4 * case.values[name]
        moved = [{**case.values, name: case.values[name] + s} for s in (step, -step)]
        y = [predict(e, case.model, replace(case, values=v).p, grid) for v in moved]
        np.testing.assert_allclose(J[:, k], (y[0] - y[1]) / (2 * step), atol=1e-4 * np.abs(J[:, k]).max())


# -- what must not change a verdict -----------------------------------------------------------------
@pytest.fixture(scope="module")
def softer():
    tests = strips(gives=9.0, seed=3)
    return tests, discover(of(tests), workers=0)


def same(d, other) -> None:
    assert (other.verdict, other.names) == (d.verdict, d.names)
    assert other.held_out.gain == pytest.approx(d.held_out.gain, abs=0.05)


@pytest.mark.slow
def test_the_order_of_experiments_does_not(softer):
    tests, d = softer
    same(d, discover(of(tests[::-1]), workers=0))


@pytest.mark.slow
def test_a_test_that_was_done_twice_does_not(softer):
    tests, d = softer
    again = replace(pulled("far", 2.6, gives=9.0, seed=9), id="again")
    same(d, discover(of([*tests, again]), workers=0))


@pytest.mark.slow
def test_finer_readings_do_not(softer):
    _, d = softer
    same(d, discover(of(strips(gives=9.0, seed=3, count=300)), workers=0))


@pytest.mark.slow
def test_forces_a_thousand_times_as_large_do_not(softer):
    tests, d = softer
    larger = [replace(e, repetitions=tuple(replace(r, y=1000 * r.y) for r in e.repetitions)) for e in tests]
    start, _ = start_case(
        None,
        baseline=["neo_hookean", "volumetric"],
        kinds=("uniaxial",),
        parameters={"G": "20 MPa", "nu": 0.4999},
    )
    other = discover(replace(of(tests), base=start, experiments=tuple(larger)), workers=0)
    same(d, other)
    assert other.first.values()["G"] == pytest.approx(1000 * d.first.values()["G"], rel=1e-3)


@pytest.mark.slow
def test_a_test_that_tells_nothing_changes_no_name(softer):
    tests, d = softer
    found = discover(of([*tests, pulled("short", 1.1, gives=9.0, seed=5)]), workers=0)
    assert (found.verdict, found.names) == (d.verdict, d.names)


# -- one estimate, robust to a wrong model ----------------------------------------------------------
def test_what_the_model_misses_is_said_test_by_test_in_parts_of_the_curve():
    found = fit(of(strips(stiffening=0.3)), workers=0)
    parts = {c.experiment.id: c for c in found.compared}
    for id in ("far", "near"):
        c = parts[id]
        gap = c.discrepancy / np.abs(c.mean).max()
        assert c.misfit == pytest.approx(np.sqrt(np.mean(gap**2)))
    assert parts["far"].misfit > 0.03 > 0.01 > fit(of(strips()), workers=0).compared[0].misfit
    assert found.reduced_chi2 < 2


@pytest.mark.parametrize("G", ["0.002 MPa", "0.3 MPa"])
def test_the_start_does_not_matter(G):
    campaign = of(strips(stiffening=0.3))
    elsewhere = replace(campaign, base=campaign.base.set(G=G))
    one, other = (fit(c, workers=0) for c in (campaign, elsewhere))
    assert other.estimate("G").value == pytest.approx(one.estimate("G").value, rel=0.01)


def test_a_bad_minimum_says_so():
    found = fit(of(strips(stiffening=0.6)), workers=0)
    worst = max(c.misfit for c in found.compared)
    assert worst > 0.05 and f"{100 * worst:.0f} %" in found.message
