"""Whole runs in plane strain on a coarse mesh: curve, ledger, outcomes, and what must not matter."""

from __future__ import annotations

import numpy as np
import pytest
from coarse_runs import BRIEF, COARSE, CUTTING, PRESSED, QUICK, SOFT, blade_work, force_at, work

from cutbench.case.case import load_case
from cutbench.run.result import SELF_CONTACT, SNAP
from cutbench.run.runner import run_case
from cutbench.solver import march
from cutbench.solver.newton import newton as march_newton

#: Mechanisms that a number switches off, with the numbers.
SWITCHED = {m.name: m.off for m in CUTTING.model.all if m.off and m.slot != "bulk"}


# -- curve --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["pressed", "cutting"])
def test_a_curve_runs_from_the_origin_to_the_depth(name, request):
    result = request.getfixturevalue(name)
    assert result.outcome.done
    assert result.outcome.reached_mm == pytest.approx(result.case.p.depth, abs=1e-9)
    for column, values in result.curve.items():
        assert values[0] == 0, column
        assert np.isfinite(values).all(), column
    assert (np.diff(result.displacement_mm) > 0).all()
    assert result.displacement_mm[-1] == pytest.approx(result.case.p.depth, abs=1e-9)
    seconds = result.displacement_mm / result.case.p.speed
    np.testing.assert_allclose(result.curve["time_s"], seconds, rtol=1e-12)
    assert (result.force_N[1:] > 0).all()


def test_no_step_is_longer_than_asked_for(cutting):
    assert np.diff(cutting.displacement_mm).max() <= cutting.case.sizes.step_mm * (1 + 1e-9)


@pytest.mark.parametrize("name", ["pressed", "cutting"])
def test_the_bottom_carries_the_blade_at_every_step(name, request):
    curve = request.getfixturevalue(name).curve
    np.testing.assert_allclose(curve["reaction_N"][1:], curve["force_N"][1:], rtol=1e-6)


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_the_bottom_carries_the_blade_whatever_the_element(element):
    curve = run_case(BRIEF.set(element=element, depth="0.5 mm")).curve
    np.testing.assert_allclose(curve["reaction_N"][1:], curve["force_N"][1:], rtol=1e-6)


def test_pressing_cuts_nothing_and_cutting_follows_the_blade(pressed, cutting):
    assert pressed.curve["cut_length_mm"].max() == 0
    cut = cutting.curve["cut_length_mm"]
    assert (np.diff(cut) >= -1e-12).all(), "what is cut stays cut"
    assert 0.5 < cut[-1] < cutting.displacement_mm[-1] + CUTTING.sizes.h_mm


def test_the_force_of_a_cut_that_opens_is_below_that_of_pressing(cutting):
    whole = run_case(CUTTING.set(without=["stiff_cohesion", "viscous_degraded"]))
    assert force_at(cutting, 2.0) < 0.8 * force_at(whole, 2.0)
    assert whole.curve["cut_length_mm"].max() == 0


# -- ledger -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["pressed", "cutting"])
def test_the_ledger_adds_up_to_the_work_of_the_blade(name, request):
    result = request.getfixturevalue(name)
    assert result.ledger == (*result.case.mechanisms, SELF_CONTACT, SNAP)
    total = sum(work(result, entry) for entry in result.ledger)
    spent = blade_work(result)
    assert spent[-1] > 0
    assert total[-1] == pytest.approx(spent[-1], rel=0.01)
    np.testing.assert_allclose(result.curve["closure"][1:], (spent - total)[1:] / spent[1:], atol=1e-9)
    assert result.measures["closure"] == result.curve["closure"][-1]


def test_forces_by_mechanism_are_the_work_over_each_step(cutting):
    step = np.diff(cutting.displacement_mm)
    for entry in cutting.ledger:
        np.testing.assert_allclose(
            cutting.curve[f"force_{entry}_N"][1:] * step, np.diff(work(cutting, entry)), rtol=1e-7, atol=1e-12
        )


def test_halving_the_step_improves_the_closure():
    """The ledger integrates by the trapezoidal rule: a quarter of the error for half of the step."""
    coarse, fine = (
        abs(run_case(PRESSED.set(step=step)).curve["closure"][-1]) for step in ("0.2 mm", "0.1 mm")
    )
    assert fine < coarse / 2
    assert coarse < 2e-3


def test_what_dissipates_only_takes(cutting):
    # Friction not to the last digit: what sticks is held by springs, its work a trapezoid over a step.
    springs = {"coulomb": 1e-5, "adhesion": 1e-5}
    for entry in ("viscous_degraded", "coulomb", "adhesion", SNAP):
        least = -springs.get(entry, 1e-9) * blade_work(cutting)[-1]
        assert np.diff(work(cutting, entry)).min() >= least, entry
        assert work(cutting, entry)[-1] > 0, entry


def test_the_cut_costs_its_surface(cutting):
    """Work of separation: G_c on what is cut through, and at most that plus the process zone."""
    p = cutting.case.p
    spent = work(cutting, "stiff_cohesion")[-1] / p.length
    length = cutting.curve["cut_length_mm"][-1]
    assert 0.9 * p.G_c * length < spent < p.G_c * (length + 2)


def test_the_snap_viscosity_is_small_while_nothing_snaps(pressed):
    assert work(pressed, SNAP)[-1] < 1e-3 * blade_work(pressed)[-1]
    without = run_case(PRESSED.set(damping_mm=0.0))
    assert SNAP not in without.ledger
    assert force_at(without, 1.5) == pytest.approx(force_at(pressed, 1.5), rel=1e-3)


@pytest.mark.slow
def test_a_snap_is_damped_over_a_short_way():
    """Damping raised over a longer one would be a force on the blade: a false peak and a false drop."""
    snapping = run_case(COARSE.set(depth="4 mm", normal="material", with_="smith_ferrante", **SOFT))
    assert snapping.measures["drop_rel"] > 0.2
    assert 0 < work(snapping, SNAP)[-1] < 0.005 * blade_work(snapping)[-1]


# -- mechanisms ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", sorted(SWITCHED))
def test_switched_off_is_absent_to_the_bit(name):
    units = {key: q.unit.removeprefix("1") for key, q in BRIEF.model.parameters().items()}
    written = {key: f"{value} {units[key]}".strip() for key, value in SWITCHED[name].items()}
    zero, absent = (run_case(QUICK.set(depth="0.7 mm").set(**by)) for by in (written, {"without": name}))
    assert zero.outcome.done
    assert (work(zero, name) == 0).all()
    for column, values in absent.curve.items():
        np.testing.assert_array_equal(zero.curve[column], values, err_msg=column)


@pytest.mark.parametrize("name", sorted(SWITCHED))
def test_switched_on_is_felt(quick, name):
    present, absent = quick, run_case(QUICK.set(without=name))
    at = np.linspace(0.1, 0.9, 20)
    assert np.abs(force_at(absent, at) / force_at(present, at) - 1).max() > 1e-3


def test_a_smooth_blade_does_no_work_of_shear():
    result = run_case(QUICK.set(depth="0.9 mm", mu=0.0, tau_W="0 kPa"), snapshots_mm=(0.9,))
    for name in ("coulomb", "adhesion"):
        assert (work(result, name) == 0).all()
    for face in result.snapshots[0].faces.values():
        assert (face["tangential_traction_MPa"] == 0).all()
    assert result.snapshots[0].faces["cut"]["contact_state"].any()


def test_the_undegraded_viscosity_costs_more(quick):
    """It goes on loading what is cut already."""
    other = run_case(QUICK.set(with_="viscous"))
    assert other.outcome.done
    assert work(other, "viscous")[-1] > 1.2 * work(quick, "viscous_degraded")[-1]


# -- outcomes -----------------------------------------------------------------------------------------
def test_ctrl_c_keeps_the_curve(quick):
    seen = []

    def stop(travel, total, text):
        seen.append(travel)
        if len(seen) == 5:
            raise KeyboardInterrupt

    result = run_case(QUICK, on_progress=stop)
    assert result.outcome.kind == "interrupted"
    assert seen[-1] == pytest.approx(result.outcome.reached_mm)
    assert seen[-1] < QUICK.p.depth
    assert result.displacement_mm[1:] == pytest.approx(seen)
    for name, column in result.curve.items():
        np.testing.assert_array_equal(column, quick.curve[name][:6], err_msg=name)


def test_an_interrupted_run_leaves_a_picture_where_one_was_wanted():
    def stop(travel, total, text):
        if travel > 0.2:
            raise KeyboardInterrupt

    result = run_case(QUICK, on_progress=stop, snapshots_mm=(0.9,))
    assert [s.displacement_mm for s in result.snapshots] == [result.displacement_mm[-1]]


def test_steps_are_told_as_they_come():
    seen, case = [], QUICK.set(depth="0.3 mm")
    result = run_case(case, on_progress=lambda *at: seen.append(at))
    assert [done for done, _, _ in seen] == pytest.approx(result.displacement_mm[1:])
    assert {total for _, total, _ in seen} == {case.p.depth}
    assert [text for _, _, text in seen] == [f"{force:.3g} N" for force in result.force_N[1:]]


@pytest.mark.parametrize(
    ("reason", "advice"),
    [
        ("elements invert along the Newton direction", "inside out"),
        ("damage grew by 1.00", "the cut jumps"),
        ("singular tangent: zero pivot", "lost their solution"),
        ("15 iterations, residual 1.0e-03 of the forces", "does not converge"),
    ],
)
def test_a_run_that_stalls_says_where_and_what_to_try(newton_by, quick, reason, advice):
    """From 0.3 mm of travel on no step converges."""

    def newton(problem, u, states, step, settings, **near):
        if step.centre[1] < QUICK.p.height - 0.3:
            raise march.NoConvergence(reason)
        return march_newton(problem, u, states, step, settings, **near)

    newton_by(newton)
    result = run_case(QUICK.set(step_min="0.005 mm"), snapshots_mm=(0.5,))
    assert (result.outcome.kind, result.outcome.done) == ("stalled", False)
    for part in ("no step above 0.005 mm converges", "of 1.1 mm", reason):
        assert part in result.outcome.message
    assert advice.lower() in result.outcome.advice.lower()
    assert "try" in result.outcome.advice
    # All that was reached is kept, up to the smallest step before the end, with a picture of it.
    assert result.outcome.reached_mm == result.displacement_mm[-1]
    assert 0.29 < result.outcome.reached_mm <= 0.3 + 1e-9
    assert [s.displacement_mm for s in result.snapshots] == [result.outcome.reached_mm]
    assert result.counts["rejected_steps"] >= 3
    assert force_at(result, 0.2) == pytest.approx(force_at(quick, 0.2), rel=1e-2)


# -- what must not matter -----------------------------------------------------------------------------
def test_the_same_case_gives_the_same_bits(quick):
    again = run_case(load_case("gelatin").set(
        h="0.6 mm", corner=0.0625, shallow=1.0, detail=1.0, step="0.1 mm", cohesion=0.5, tip="3.5 mm", mu=0.2,
        depth="1.1 mm", element="P1", penalty="1000 1/mm", stick="400 1/mm", multiplier="none",
    ))  # fmt: skip
    assert again.case.id == quick.case.id
    for name, column in quick.curve.items():
        np.testing.assert_array_equal(again.curve[name], column, err_msg=name)
    steady = {"steps", "iterations", "rejected_steps", "degrees_of_freedom"}
    assert {k: again.counts[k] for k in steady} == {k: quick.counts[k] for k in steady}


def test_twice_the_length_takes_twice_the_force(quick):
    double = run_case(QUICK.set(length="60 mm"))
    for name, column in quick.curve.items():
        factor = 1 if name in ("displacement_mm", "time_s", "cut_length_mm", "closure") else 2
        np.testing.assert_allclose(double.curve[name], factor * column, rtol=1e-12, err_msg=name)


@pytest.mark.slow
def test_speed_counts_only_with_the_viscous_time(quick):
    fast = run_case(QUICK.set(speed="0.21 mm/s", eta_reg="0.238 s"))
    # The length of a step follows from what the one before has left open: differences of nearly equal works.
    np.testing.assert_allclose(fast.displacement_mm, quick.displacement_mm, rtol=1e-9)
    np.testing.assert_allclose(fast.force_N, quick.force_N, rtol=1e-6)
    np.testing.assert_allclose(fast.curve["time_s"], quick.curve["time_s"] / 10, rtol=1e-9)
    faster = run_case(QUICK.set(speed="0.21 mm/s"))
    # Held together for longer, the faster cut is still whole where the slower one has begun.
    assert force_at(faster, 1.1) > 1.2 * force_at(quick, 1.1)


SMALL = BRIEF.set(depth="0.4 mm", step="0.02 mm", corner=0.5)


def compare(one, other, *, length, stress):
    """``other`` is ``one`` with all lengths times ``length`` and all stresses times ``stress``."""
    force = length**2 * stress
    factors = {"displacement_mm": length, "cut_length_mm": length, "time_s": None, "closure": 1.0}
    for name, column in one.curve.items():
        factor = factors.get(name, force * length if name.startswith("work_") else force)
        if factor is not None:
            atol = 1e-6 * np.abs(column).max() * factor
            np.testing.assert_allclose(other.curve[name], factor * column, rtol=1e-6, atol=atol, err_msg=name)


def test_stiffer_in_proportion_is_the_same_test():
    """Every stress times four, G_c too: every force times four."""
    v = SMALL.values
    stiff = SMALL.set(
        G=f"{4 * v['G']} MPa", G_c=f"{4 * v['G_c']} N/mm", tau_W=f"{4 * v['tau_W']} MPa",
    )  # fmt: skip
    compare(run_case(SMALL), run_case(stiff), length=1, stress=4)
