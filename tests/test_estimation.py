"""Prediction, likelihood and fit: cuts, tension and both at once go through the same lines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import runs_by_formula
from blind_cases import campaign, made

from benchmarks.blind_campaigns import Planned, make
from cutbench.base.errors import ComputationFailed
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.estimation import drop_unidentifiable, estimate, successive_estimates
from cutbench.calibration.fitting import fit
from cutbench.calibration.parameters import free_parameters
from cutbench.calibration.posterior import Posterior
from cutbench.calibration.prediction import Predictions
from cutbench.data.campaign import FitPlan, load_campaign
from cutbench.data.covariance import relative_discrepancy
from cutbench.run.pool.pool import TaskPool


def posterior_of(asked, runs=None, names=None) -> Posterior:
    runs = runs or CutRuns(TaskPool(0), compute=runs_by_formula.Counted())
    looked_for = [u for u in free_parameters(asked) if names is None or u.name in names]
    grids = {e.id: e.on_grid(40) for e in asked.experiments}
    predictions = Predictions(asked, asked.base, grids, runs, [u.name for u in looked_for])
    return Posterior.of(predictions, looked_for)


def fitted(asked, **how):
    """A fit, with cuts by a formula, and their runs."""
    runs = CutRuns(TaskPool(0), compute=runs_by_formula.Counted())
    return fit(asked, runs=runs, **how), runs


def of_cuts(folder: Path, family="cut", *beside, effects=()):
    planned = Planned(1, family, effects, ("coarse", "ellipse", *beside))
    truth = make(planned, 1, folder, run=runs_by_formula.run_case)
    return truth, load_campaign(truth.file)


def computed_about(posterior) -> np.ndarray:
    """Places (8, 2) about the start where all cuts are then computed."""
    places, p = np.random.default_rng(0).uniform(-0.5, 0.5, (8, 2)), posterior.predictions
    cuts = [e for e in posterior.tests if e.kind == "cut"]
    p.runs([p.case(e, posterior.values(e, q)) for q in places for e in cuts])
    return places


# -- prediction ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("shows", ["bulk", "joint", "sliding"])
def test_derivatives_are_those_of_the_prediction(shows):
    posterior, *_ = drop_unidentifiable(posterior_of(campaign("", shows)))
    q = np.full(len(posterior.parameters), 0.05)
    at = posterior.evaluate(q)
    for k, step in enumerate(1e-5 * np.eye(q.size)):
        before, after = (posterior.evaluate(q + s * step) for s in (-1, 1))
        for id, J in at.J.items():
            difference = (after.y[id] - before.y[id]) / 2e-5
            np.testing.assert_allclose(J[:, k], difference, atol=1e-5 * np.abs(at.y[id]).max())


def test_a_test_with_a_formula_is_exact_and_a_cut_has_an_error(tmp_path):
    _, asked = of_cuts(tmp_path, "mixed", "tension")
    posterior = posterior_of(asked, names=("G", "G_c"))
    cut, tension = asked.experiment("slow"), asked.experiment("tension")
    assert posterior.predictions.predict(tension, {}).root.size == 0
    assert posterior.predictions.predict(cut, {}).root.any()  # the atlas has it, before any run
    places = computed_about(posterior)
    between = posterior.predictions.predict(cut, posterior.values(cut, np.array([0.1, 0.2])), ("G",))
    there = posterior.predictions.predict(cut, posterior.values(cut, places[3]), ("G",))
    assert between.root.any() and not there.root.any()
    course, _ = runs_by_formula.course(posterior.predictions.case(cut, posterior.values(cut, places[3])))
    expected = posterior.predictions.read(cut, {}, course)
    np.testing.assert_allclose(there.y, expected, atol=0.01 * expected.max())


def with_machine(posterior, asked, name: str, free: str) -> Predictions:
    """The same predictions with a machine of which ``free`` is looked for."""
    p, (model, new) = posterior.predictions, asked.base.model.extended(name)
    base = replace(asked.base, mechanisms=model.mechanisms, values={**asked.base.values, **new})
    return p.extended(base, ["G", "G_c", free])


def test_a_machine_that_drifts_acts_on_what_is_predicted(tmp_path):
    """Without another run."""
    _, asked = of_cuts(tmp_path)
    posterior = posterior_of(asked, names=("G", "G_c"))
    p, cut = posterior.predictions, asked.experiment("slow")
    computed_about(posterior)
    drifting = with_machine(posterior, asked, "force_drift", "drift")
    count, duration = p.runs.count, p.grids["slow"].x / cut.speed
    found = drifting.predict(cut, {"drift": 1e-4}, ("drift",))
    np.testing.assert_allclose(found.y - p.predict(cut, {}).y, 1e-4 * duration, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(found.slopes[:, 0], duration, rtol=0.02, atol=1.0)
    assert p.runs.count == count


@pytest.mark.parametrize("compliance", [0.02, 0.4])
def test_a_machine_that_gives_needs_no_run_of_its_own(compliance, tmp_path):
    """It shows a longer way than the blade goes, by as much as the force bends it."""
    _, asked = of_cuts(tmp_path)
    posterior = posterior_of(asked, names=("G", "G_c"))
    p, cut = posterior.predictions, asked.experiment("slow")
    place, count = posterior.values(cut, computed_about(posterior)[3]), posterior.predictions.runs.count
    giving = with_machine(posterior, asked, "machine_compliance", "compliance")
    found = giving.predict(cut, {**place, "compliance": compliance}, ("compliance",))
    x, F, _ = p.runs.known(p.case(cut, place)).course
    # What is shown while the blade snaps forward is not read.
    shown, on = x + compliance * F, [0]
    for i in range(1, x.size):
        if shown[i] > shown[on[-1]]:
            on.append(i)
    expected = np.interp(p.grids["slow"].x, shown[on], F[on])
    assert np.median(np.abs(found.y - expected)) < 0.01 * F.max()
    assert np.abs(found.y - p.predict(cut, place).y).max() > 1e-3 * F.max()
    ends = [giving.predict(cut, {**place, "compliance": compliance + s}).y for s in (-1e-5, 1e-5)]
    difference = (ends[1] - ends[0]) / 2e-5
    assert np.median(np.abs(found.slopes[:, 0] - difference)) < 0.01 * np.abs(difference).max()
    assert p.runs.count == count


# -- runs ---------------------------------------------------------------------------------------------
def test_a_cut_is_computed_once_and_a_failure_is_remembered(tmp_path):
    _, asked = of_cuts(tmp_path)
    posterior = posterior_of(asked, names=("G",))
    p, cut = posterior.predictions, asked.experiment("slow")
    cases = [p.case(cut, {"G": G}) for G in (0.006, 0.008, 0.006)]
    assert len(p.runs(cases)) == 3 and p.runs.count == 2 and len(p.runs.database.runs) == 2
    p.runs(cases)
    assert p.runs.count == 2

    def fails(*asked):
        raise ComputationFailed("no way")

    broken = CutRuns(TaskPool(0), compute=fails)
    assert broken(cases) == [None, None, None] and broken.count == 2
    broken(cases)
    assert broken.count == 2 and {*broken.failed.values()} == {"no way"}


def test_what_is_in_the_store_is_known_from_the_start(tmp_path):
    _, asked = of_cuts(tmp_path)
    p, cut, store = posterior_of(asked, names=("G",)).predictions, asked.experiment("slow"), tmp_path / "runs"
    cases = [p.case(cut, {"G": G}) for G in (0.006, 0.008)]
    first = CutRuns(TaskPool(0), store, compute=runs_by_formula.Counted())(cases)
    again = CutRuns(TaskPool(0), store, compute=runs_by_formula.Counted())
    for case, run, same in zip(cases, first, again(cases), strict=True):
        np.testing.assert_array_equal(same.course, run.course)
        assert same.onset_mm == pytest.approx(run.onset_mm) and again.known(case) is same
    assert again.count == 0 and len(again.database.runs) == 2
    # One that cannot be read is computed again.
    (store / cases[0].id[:2] / cases[0].id / "run.json").write_text("{")
    broken = CutRuns(TaskPool(0), store, compute=runs_by_formula.Counted())
    assert broken.known(cases[0]) is None and broken(cases)[0] is not None and broken.count == 1


# -- likelihood and fit -------------------------------------------------------------------------------
@pytest.mark.parametrize(("shows", "number"), [("bulk", 1), ("joint", 1), ("sliding", 1)])
def test_true_values_lie_in_the_intervals(shows, number):
    found, _ = fitted(campaign("", shows, True, number))
    assert found.status == "converged" and found.estimates
    for e in found.estimates:
        truth = made("", shows, True, number).values[e.label]
        assert abs(e.value - truth) < 3 * e.sd < 0.3 * truth


def test_the_maximum_is_one():
    found = fitted(campaign("gent", "bulk"))[0].estimated
    posterior = found.posterior
    for step in 3 * np.sqrt(np.diag(found.covariance)) * np.array([[-1.0], [1.0]]):
        r = posterior.whitened(posterior.evaluate(found.q + step), found.w)[0]
        best = posterior.whitened(found.at, found.w)[0]
        assert float(r @ r) > float(best @ best) + 4


def test_a_wrong_model_has_a_discrepancy_and_less_evidence():
    """The same specimens and noise, with strain stiffening in one."""
    right, wrong = (fitted(campaign(effect, "bulk"))[0].estimated for effect in ("", "gent"))
    sizes = [
        max(relative_discrepancy(each.w, id, r) for id, r in each.at.residual.items())
        for each in (right, wrong)
    ]
    assert sizes[0] < 0.01 and sizes[1] > 4 * sizes[0]
    assert wrong.log_evidence < right.log_evidence - 10


def test_evidence_counts_a_parameter_that_does_nothing_for_nothing():
    # No traction depends on the bulk's modulus.
    asked = campaign("", "joint", True, 1)
    alone, both = (
        estimate(posterior_of(asked, names=n)) for n in (("G_c", "delta_c"), ("G", "G_c", "delta_c"))
    )
    assert len(both.q) == len(alone.q) + 1
    assert both.log_evidence == pytest.approx(alone.log_evidence, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("family", "beside"), [("cut", ()), ("mixed", ("tension",)), ("mixed", ("hold",))])
def test_cuts_and_what_is_beside_them_are_fitted_together(tmp_path, family, beside):
    truth, asked = of_cuts(tmp_path, family, *beside)
    found, _ = fitted(asked)
    assert found.status == "converged" and {"tilt", "incline", "overhang"} <= found.fixed.keys()
    for name in ("G", "G_c", "tau_W"):
        assert found.values[name] == pytest.approx(truth.values[name], rel=0.15)
    assert max(c.rmse / np.abs(c.mean).max() for c in found.compared if c.experiment.role == "train") < 0.03
    assert found.runs <= 75


@pytest.mark.slow
def test_cuts_are_fitted_from_few_runs(tmp_path):
    _, asked = of_cuts(tmp_path)
    asked = replace(asked, plan=FitPlan(free=("G", "G_c", "tau_W")))
    found, runs = fitted(asked, refine=False)
    assert found.status == "converged" and runs.count <= 40
    assert max(c.rmse for c in found.compared if c.experiment.role == "train") < 0.2
    # The cuts at the place that was found are computed, and what is said there is what they gave.
    known, best = len(runs.database.runs), found.estimated
    predictions = best.posterior.predictions
    for e in asked.train:
        (run,) = runs([predictions.case(e, best.posterior.values(e, best.q))])
        exact = predictions.read(e, best.posterior.values(e, best.q), run.course)
        np.testing.assert_allclose(best.at.y[e.id], exact, rtol=1e-6)
    assert len(runs.database.runs) == known


@pytest.mark.slow
def test_a_fit_is_better_and_better_and_says_when_it_has_settled(tmp_path):
    """Every place that it tells of was computed."""
    _, asked = of_cuts(tmp_path)
    posterior = posterior_of(asked, names=("G", "G_c", "tau_W"))
    every = list(successive_estimates(posterior, refine=False))
    assert every[-1].settled and len(every) > 1
    assert every[-1].log_posterior == max(each.log_posterior for each in every)
    for each in every:
        cases = [posterior.predictions.case(e, posterior.values(e, each.q)) for e in asked.train]
        assert all(posterior.predictions.runs.known(case) is not None for case in cases)
