"""What held-out readings decide, and what of a rig is known without another run."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind_campaigns import Planned, make
from cutbench.calibration.fitting import fit
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.prediction import Task, predict, predictor, recorded
from cutbench.case.case import load_case
from cutbench.case.model import DEFAULT, Model
from cutbench.data.campaign import load_campaign
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition
from cutbench.discovery.candidates import baseline_of
from cutbench.discovery.heldout import TESTS, Heldout, compare, decide
from cutbench.discovery.point import point_of, refitted
from cutbench.mechanisms import registry

SOFTENING = Planned(22, "homogeneous", ("Zuniga-Beatty",), ("formula", "several conditions"))
BETTER = Heldout(TESTS, 50.0, 10.0, 0.3, 0.1, 2.0, 1.4, 0.5, "N", 0.4)


def test_better_in_both_ways_is_accepted():
    assert BETTER.accepted and BETTER.tells
    assert not replace(BETTER, better=5.0).accepted
    assert not replace(BETTER, gain=-0.3, gain_of_shape=-0.3).accepted


def test_a_specimen_that_differs_by_a_factor_does_not_contradict():
    unlucky = replace(BETTER, gain=-0.2)
    assert unlucky.accepted and unlucky.tells


def test_predictions_that_hardly_differ_tell_nothing():
    assert not replace(BETTER, better=-0.5, better_se=0.4).tells
    assert replace(BETTER, better=-50.0).tells


@pytest.mark.slow
def test_tests_in_which_a_law_does_nothing_do_not_tell_of_it(tmp_path):
    # Softening, and softer specimens in the tests, none of which goes back.
    campaign = load_campaign(make(SOFTENING, 5, tmp_path, specimens=3).file)
    with predictor(0) as run:
        before = point_of(fit(baseline_of(campaign), run=run), run)
        model, off = before.case.model.extended("steep_mullins")
        case = replace(before.case, mechanisms=model.mechanisms, values={**before.case.values, **off})
        case = replace(case, values={**case.values, "softening": 0.3, "softening_energy": 0.1})
        new = [Unknown(q, case.values[q.name], *q.bounds) for q in registry()["steep_mullins"].parameters]
        after = refitted(before, [*before.inverse.at(before.q), *new], case, run)
    assert compare(before, after).better < 0, "the specimens in the tests are softer"
    held = decide(before, after)
    assert held.how != TESTS and held.accepted


def test_a_driven_machine_does_not_go_back():
    x = np.array([0.0, 1.0, 2.0, 1.5, 1.9, 2.0, 2.1, 3.0])
    model, course = Model(DEFAULT), np.stack([x, 2 * x, np.arange(8.0)])
    shown = model.shown(course, SimpleNamespace())
    assert shown[0].tolist() == [0.0, 1.0, 2.0, 2.1, 3.0]
    assert np.array_equal(shown[1], 2 * shown[0]) and shown[2].tolist() == [0, 1, 2, 6, 7]
    assert model.shown(course + 1e-30j, SimpleNamespace()).shape == (3, 5)


@pytest.mark.slow
@pytest.mark.parametrize("strength", [0.02, pytest.param(0.4, marks=pytest.mark.slow)])
def test_a_compliance_needs_no_run_of_its_own(strength):
    small = {
        "G_c": "0.3 J/m^2", "mu": 0.1, "eta_reg": "8 s", "tip": "2 mm", "width": "8 mm", "height": "5 mm",
        "depth": "1 mm", "h": "0.7 mm", "penalty": 200, "stick": 100, "multiplier": "none",
        "corner": 0.0625, "shallow": 1.0, "step": "0.1 mm",
    }  # fmt: skip
    off = load_case("gelatin", small, dim=2)
    model, new = off.model.extended("machine_compliance")
    off = replace(off, mechanisms=model.mechanisms, values={**off.values, **new})
    x = np.linspace(0.1, 0.9, 17)
    e = Experiment("press", "cut", (Repetition(x, x, x / off.p.speed),), speed=off.p.speed)
    (task,) = [Task(e, off, e.on_grid(17))]
    soft = replace(off, values={**off.values, "compliance": strength})
    expected = predict(replace(task, case=soft)).y
    found = predict(task)
    assert recorded(task, found, compliance=strength) == pytest.approx(expected, rel=1e-12)
    assert recorded(task, found) == pytest.approx(found.y, rel=1e-12)
    assert np.abs(expected - found.y).max() > 1e-3 * found.y.max()
