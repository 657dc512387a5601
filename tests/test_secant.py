"""Derivatives that are updated by secants: they say what a curve did, and fits end where exact ones do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from formula_of_cuts import Formula, campaign_in

from cutbench.calibration import lm
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.prediction import Prediction, Task, predict
from cutbench.calibration.secant import force_powers
from cutbench.calibration.sparing import Sparing
from cutbench.case.case import load_case
from cutbench.data.campaign import FitPlan, start_case
from cutbench.discovery.synthetic import Test, campaign
from cutbench.run.runner import run_case

TIGHT = lm.Settings(promise=1e-10, evaluations=200, failures=20, jags=1.0)


class Counting:
    """Predicts, and knows how many curves were asked for with and without derivatives."""

    def __init__(self):
        self.with_, self.without = 0, 0

    def __call__(self, tasks: list[Task]):
        self.with_ += sum(bool(task.names) for task in tasks)
        self.without += sum(not task.names for task in tasks)
        return [predict(task) for task in tasks]


@pytest.fixture
def problem() -> tuple[Inverse, Counting]:
    truth, _ = start_case(
        None, baseline=["gent", "volumetric"], kinds=("uniaxial",),
        parameters={"G": "40 kPa", "nu": 0.4999, "inv_J_m": 0.05},
    )  # fmt: skip
    tests = Test("tension", "uniaxial", speed=0.1, reach=2.5), Test("shear", "pure_shear", 0.1, 2.2)
    start = replace(truth, values={**truth.values, "G": 0.06, "inv_J_m": 0.02})
    made = campaign(truth, tests, start, seed=3, plan=FitPlan(free=("G", "inv_J_m")))
    run = Counting()
    return Inverse(made, unknowns(made), run), run


def test_the_slopes_give_the_change_of_the_curve(problem):
    inverse, run = problem
    here, there = np.zeros(2), np.array([-0.3, 0.4])
    before = inverse.predictions(here)
    after = Sparing(inverse).predictions(there)
    assert (run.with_, run.without) == (2, 2)
    for e in inverse.campaign.train:
        step = np.array([u.value(b) - u.start for u, b in zip(inverse.unknowns, there, strict=True)])
        change = after[e.id].y - before[e.id].y
        np.testing.assert_allclose(after[e.id].slopes @ step, change, atol=1e-12 * np.abs(change).max())
        # And along the step alone: they are those of before across it.
        size = np.array([u.slope(x) for u, x in zip(inverse.unknowns, there, strict=True)])
        across = np.array([-step[1] / size[1], step[0] / size[0]]) * size
        kept = before[e.id].slopes @ across
        np.testing.assert_allclose(after[e.id].slopes @ across, kept, rtol=1e-9, atol=1e-12)


def test_where_derivatives_are_known_they_are_taken(problem):
    inverse, run = problem
    q = np.array([0.1, 0.2])
    known = inverse.predictions(q)
    assert Sparing(inverse).predictions(q) is known
    assert run.without == 0


def test_a_minimum_is_that_of_exact_derivatives(problem):
    inverse, run = problem
    w, q = inverse.guessed(np.zeros(2)), np.zeros(2)
    exact = lm.minimise(lambda q: inverse.whitened(q, w), q, *inverse.bounds, TIGHT)
    other = inverse.other(inverse.unknowns, inverse.start)
    other.predictions(q)
    asked, sparing = run.with_, Sparing(other)
    found = lm.minimise(lambda q: sparing.whitened(q, w), q, *inverse.bounds, TIGHT)
    assert run.with_ == asked and run.without > 0
    np.testing.assert_allclose(found.q, exact.q, atol=1e-3)


def test_without_any_known_place_the_first_is_computed_with_derivatives(problem):
    inverse, run = problem
    Sparing(inverse).predictions(np.zeros(2))
    assert (run.with_, run.without) == (2, 0)


def test_a_cut_without_derivatives_is_the_same_curve(problem):
    case = load_case("gelatin", {"numerics": "fast", "depth": "0.2 mm"})
    (made,) = campaign(case, [Test("cut", reach=0.2, readings=8)], case, seed=1).train
    grid = made.on_grid(8)
    plain, known = (predict(Task(made, case, grid, names)) for names in ((), ("G",)))
    np.testing.assert_array_equal(plain.y, known.y)
    assert plain.slopes.shape == (8, 0) and known.slopes.shape == (8, 1)


class Stairs:
    """Predicts forces that follow (1 + x) G_c in small jumps, with derivatives of the levels between."""

    def __init__(self, lost: bool):
        self.lost, self.asked = lost, []

    def __call__(self, tasks: list[Task]) -> list[Prediction]:
        found = []
        for task in tasks:
            self.asked.append(task)
            x, G_c = task.grid.x, task.case.values["G_c"]
            y = (1 + x) * np.round(G_c / 5e-3, 2)
            slopes = np.full((x.size, len(task.names)), 0.1)
            slopes[x.size // 2 :] = np.nan if self.lost else 0.1
            found.append(Prediction(y, slopes, task.names))
        return found


@pytest.mark.parametrize("lost", [False, True])
def test_a_cuts_derivatives_are_slopes_across_its_jumps(lost):
    case = load_case("gelatin", {"numerics": "fast", "depth": "0.2 mm", "G_c": "5 J/m^2"})
    made = campaign(case, [Test("cut", reach=0.2, readings=8)], case, seed=1, plan=FitPlan(free=("G_c",)))
    run = Stairs(lost)
    inverse = Inverse(made, unknowns(made), run, 8, across=True)
    (e,) = made.train
    (p,) = inverse.predictions(np.zeros(1)).values()
    x = inverse.grids[e.id].x
    # Per unit of q = ln G_c the force changes by (1 + x) and, over one level, by a tenth of it at the most.
    np.testing.assert_allclose(inverse.slopes(e, p, np.zeros(1))[:, 0], 1 + x, rtol=0.25)
    assert [bool(task.names) for task in run.asked] == [True, False]


def test_what_a_fit_has_computed_is_not_computed_again():
    case = load_case("gelatin", {"numerics": "fast", "depth": "0.2 mm", "G_c": "5 J/m^2"})
    made = campaign(case, [Test("cut", reach=0.2, readings=8)], case, seed=1, plan=FitPlan(free=("G_c",)))
    run = Stairs(lost=False)
    fitted = Inverse(made, unknowns(made), run, 8)
    q = np.array([0.1])
    fitted.predictions(q)
    moved = fitted.moved(q, across=True)
    moved.predictions(np.zeros(1))
    assert [bool(task.names) for task in run.asked] == [True, False]


def test_forces_are_proportional_to_all_that_has_the_dimension_of_a_stress():
    case = load_case("gelatin", {"numerics": "fast", "depth": "2.5 mm", "speed": "0.05 mm/s"})
    names = tuple(force_powers(case))
    assert set(names) == {"G", "G_c", "tau_W"} and set(force_powers(case).values()) == {1.0}
    result = run_case(case, sensitivities=names)
    known = np.all([np.isfinite(result.sensitivities[n]) for n in names], axis=0)
    assert known.sum() > 20
    total = sum(case.values[n] * result.sensitivities[n] for n in names)
    force = result.curve["force_N"]
    np.testing.assert_allclose(total[known], force[known], atol=1e-5 * force.max())


def test_the_derivative_that_is_spared_follows_from_the_others(tmp_path):
    campaign = campaign_in(tmp_path)
    start = replace(campaign.base, values={**campaign.base.values, "tau_W": 0.0})
    asked: list[Task] = []

    def run(tasks):
        asked.extend(tasks)
        return Formula()(tasks)

    inverse = Inverse(campaign, unknowns(campaign), run, start=start, across=True)
    q = np.zeros(2)
    found = inverse.predictions(q)
    # Two cuts, and one difference each: by the toughness.
    assert len(asked) == 4
    for p in found.values():
        values = np.array([start.values[name] for name in p.names])
        np.testing.assert_allclose(p.slopes @ values, p.y, atol=1e-12)
    # An adhesion that nothing is known of by derivatives takes part in the force: all differences are made.
    asked.clear()
    Inverse(campaign, unknowns(campaign), run, across=True).predictions(q)
    assert len(asked) == 6
