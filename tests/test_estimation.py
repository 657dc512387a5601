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
from cutbench.calibration.estimation import DESIGN, choose, estimate
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.posterior import Posterior
from cutbench.calibration.predict import NotKnown, Predictions
from cutbench.data.campaign import load_campaign
from cutbench.data.discrepancy import misfit
from cutbench.run.pool.pool import TaskPool


def posterior_of(asked, runs=None, names=None) -> Posterior:
    runs = runs or CutRuns(TaskPool(0), compute=runs_by_formula.Counted())
    looked_for = [u for u in unknowns(asked) if names is None or u.name in names]
    grids = {e.id: e.on_grid(40) for e in asked.experiments}
    predictions = Predictions(asked, asked.base, grids, runs, [u.name for u in looked_for])
    return Posterior.of(predictions, looked_for)


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
    posterior, _ = choose(posterior_of(campaign("", shows)))
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
    with pytest.raises(NotKnown):
        posterior.predictions.predict(cut, {})
    places = computed_about(posterior)
    between = posterior.predictions.predict(cut, posterior.values(cut, np.array([0.1, 0.2])), ("G",))
    there = posterior.predictions.predict(cut, posterior.values(cut, places[3]), ("G",))
    assert between.root.any() and not there.root.any()
    course, _ = runs_by_formula.course(posterior.predictions.case(cut, posterior.values(cut, places[3])))
    expected = posterior.predictions.read(cut, {}, course)
    np.testing.assert_allclose(there.y, expected, atol=0.01 * expected.max())


def test_a_machine_that_gives_acts_on_what_is_predicted(tmp_path):
    """Without another run, on cuts as on tension."""
    _, asked = of_cuts(tmp_path)
    posterior = posterior_of(asked, names=("G", "G_c"))
    p, cut = posterior.predictions, asked.experiment("slow")
    computed_about(posterior)
    model, new = asked.base.model.extended("force_drift")
    base = replace(asked.base, mechanisms=model.mechanisms, values={**asked.base.values, **new})
    drifting = Predictions(asked, base, p.grids, p.runs, ["G", "G_c", "drift"])
    count, duration = p.runs.count, p.grids["slow"].x / cut.speed
    found = drifting.predict(cut, {"drift": 1e-4}, ("drift",))
    np.testing.assert_allclose(found.y - p.predict(cut, {}).y, 1e-4 * duration, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(found.slopes[:, 0], duration, rtol=0.02, atol=1.0)
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


# -- likelihood and fit -------------------------------------------------------------------------------
@pytest.mark.parametrize(("shows", "number"), [("bulk", 1), ("joint", 1), ("sliding", 1)])
def test_true_values_lie_in_the_intervals(shows, number):
    posterior, _ = choose(posterior_of(campaign("", shows, True, number)))
    found = estimate(posterior)
    deviations = np.sqrt(np.diag(found.covariance))
    for (label, value), sd in zip(found.values().items(), deviations, strict=True):
        truth = made("", shows, True, number).values[label]
        assert abs(np.log(value / truth)) < 3 * sd < 0.3


def test_the_maximum_is_one():
    posterior, _ = choose(posterior_of(campaign("gent", "bulk")))
    found = estimate(posterior)
    for step in 3 * np.sqrt(np.diag(found.covariance)) * np.array([[-1.0], [1.0]]):
        r = posterior.whitened(posterior.evaluate(found.q + step), found.w)[0]
        best = posterior.whitened(found.at, found.w)[0]
        assert float(r @ r) > float(best @ best) + 4


def test_a_wrong_model_has_a_discrepancy_and_less_evidence():
    """The same specimens and noise, with strain stiffening in one."""
    right, wrong = (estimate(choose(posterior_of(campaign(effect, "bulk")))[0]) for effect in ("", "gent"))
    sizes = [max(misfit(each.w, id, r) for id, r in each.at.residual.items()) for each in (right, wrong)]
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
    posterior, left = choose(posterior_of(asked))
    assert {"tilt", "incline", "overhang"} <= left.keys()
    found = estimate(posterior)
    values, count = found.values(), posterior.predictions.runs.count
    for name in ("G", "G_c", "tau_W"):
        assert values[name] == pytest.approx(truth.values[name], rel=0.15)
    assert max(np.sqrt(np.mean(r**2)) / asked.experiment(id).on_grid(40).mean.max()
               for id, r in found.at.residual.items()) < 0.03  # fmt: skip
    assert count <= 75


@pytest.mark.slow
def test_cuts_are_fitted_from_few_runs(tmp_path):
    _, asked = of_cuts(tmp_path)
    posterior = posterior_of(asked, names=("G", "G_c", "tau_W"))
    found = estimate(posterior, refine=False)
    runs = posterior.predictions.runs
    assert runs.count <= 3 * DESIGN.first + 3 * DESIGN.each + 3 * DESIGN.rounds
    assert max(np.sqrt(np.mean(r**2)) for r in found.at.residual.values()) < 0.2
    # The cuts at the place that was found are computed, and what is said there is what they gave.
    known = len(runs.database.runs)
    runs([posterior.predictions.case(e, posterior.values(e, found.q)) for e in posterior.tests])
    assert len(runs.database.runs) == known
