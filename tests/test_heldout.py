"""What held-out readings decide, and what a machine reads of a run."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind_campaigns import Planned, make
from cutbench.case.model import DEFAULT, Model
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover
from cutbench.discovery.held_out import TESTS, HeldOut

SOFTENING = Planned(22, "homogeneous", ("Zuniga-Beatty",), ("formula", "several conditions"))
BETTER = HeldOut(TESTS, 0.5, 0.1, 0.4, 2.0, 1.4, 0.5, "N", True)


def test_one_that_predicts_worse_in_both_ways_is_not_better():
    assert BETTER.better and BETTER.gains_much
    assert not replace(BETTER, gain=-0.3, gain_of_shape=-0.3).better


def test_a_specimen_that_differs_by_a_factor_does_not_contradict():
    unlucky = replace(BETTER, gain=-0.15)
    assert unlucky.better and not unlucky.gains_much


def test_predictions_that_hardly_differ_tell_nothing():
    alike = replace(BETTER, gain=-0.01, gain_of_shape=-0.01, tells=False)
    assert alike.better and not alike.gains_much


@pytest.mark.slow
def test_tests_in_which_a_law_does_nothing_do_not_tell_of_it(tmp_path):
    # Softening, and softer specimens in the tests, none of which goes back.
    campaign = load_campaign(make(SOFTENING, 5, tmp_path, specimens=3).file)
    d = discover(replace(campaign, candidates=("steep_mullins",)), workers=0)
    (law,) = (c for c in d.steps[0].compared if c.name == "steep_mullins")
    assert law.held_out.how != TESTS and law.held_out.better
    assert d.names == ("steep_mullins",)


def test_a_driven_machine_does_not_go_back():
    x = np.array([0.0, 1.0, 2.0, 1.5, 1.9, 2.0, 2.1, 3.0])
    model, course = Model(DEFAULT), np.stack([x, 2 * x, np.arange(8.0)])
    shown = model.shown(course, SimpleNamespace())
    assert shown[0].tolist() == [0.0, 1.0, 2.0, 2.1, 3.0]
    assert np.array_equal(shown[1], 2 * shown[0]) and shown[2].tolist() == [0, 1, 2, 6, 7]
    assert model.shown(course + 1e-30j, SimpleNamespace()).shape == (3, 5)
