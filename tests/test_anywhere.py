"""Laws looked at wherever the model that lacks them has ended, with forces by a formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from formula_of_cuts import TRUE, X, campaign_in
from test_discover_cuts import point_at
from test_emulated import Remembering, force

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import silent
from cutbench.calibration import lm, survey
from cutbench.calibration.prediction import Prediction, Reading
from cutbench.discovery.anywhere import PLACES, looked
from cutbench.discovery.candidates import candidates
from cutbench.mechanisms import registry

B = 0.15


def stiffened(x: np.ndarray, values: dict) -> np.ndarray:
    """Force of a gel that a strain-stiffening law makes stiffer the deeper the blade is."""
    return force(x, values) * (1 + 2 * values.get("b_fung", 0.0) * x)


class Stiffening(Remembering):
    def _one(self, task):
        values = dict(task.case.values)
        x = np.linspace(0, values["depth"], 200)
        course = np.stack([x, stiffened(x, values), x / values["speed"]])
        self.memory.add(task.case, course)
        slopes = {}
        for name in (n for n in task.names if n in ("G", "G_c", "b_fung")):
            moved = {**values, name: values[name] * 1.0001 + 1e-9}
            slopes[name] = (stiffened(x, moved) - course[1]) / (moved[name] - values[name])
        y, by = Reading(task, course).by(vars(task.case.p), slopes)
        return Prediction(y, by, task.names, course=course)


@pytest.fixture
def point(tmp_path):
    """The best that the model without the law makes of cuts with it."""
    campaign, run = campaign_in(tmp_path), Stiffening()
    start = point_at(campaign, run, **TRUE)
    inverse = start.inverse
    true = inverse.start.set(G="8 kPa", G_c="5 J/m^2")
    for e in campaign.train:
        values = {**campaign.case(e, true).values, "b_fung": B}
        mean = np.interp(inverse.grids[e.id].x, X, stiffened(X, values))
        inverse.grids[e.id] = replace(inverse.grids[e.id], mean=mean)
    survey.Survey(inverse, [np.zeros(2)]).look()
    q = survey.Survey(inverse, [np.zeros(2)]).minimum(start.w, np.zeros(2), lm.Settings()).q
    return replace(point_at(campaign, run, **named(inverse, q)), inverse=inverse, q=q)


def named(inverse, q) -> dict[str, float]:
    return dict(zip([u.name for u in inverse.unknowns], inverse.values(q), strict=True))


def laws(point, *names):
    every, _ = candidates(point.inverse, point.case, one_a_class=False)
    return [c for c in every if c.name in names], every


def test_the_law_that_is_lacked_is_foreseen_with_its_strength(point):
    chosen, every = laws(point, "compressible", "fung", "blunt_tip")
    run, places = point.inverse.run, point.inverse.run.places
    found, vain = looked(point, chosen, every, silent)
    first = found[0]
    assert first.candidate.name not in vain
    assert first.candidate.name == "fung" and first.paid > 0
    values = dict(
        zip(
            [u.name for u in first.survey.inverse.unknowns], first.survey.inverse.values(first.q), strict=True
        )
    )
    assert values["b_fung"] == pytest.approx(B, rel=0.2)
    assert values["G"] == pytest.approx(TRUE["G"], rel=0.1)
    # The other formulas of its class are looked at, too, and laws that do nothing here do not gain.
    assert {one.candidate.name for one in found} <= {
        name for name in registry() if registry()[name].family == "strain stiffening"
    }
    tests = len(point.campaign.train)
    assert run.places - places <= 8 * PLACES * tests
    inverse, q = first.extended(point.w.noise)
    assert named(inverse, q)["b_fung"] == pytest.approx(B, rel=0.1)


def test_laws_that_cannot_be_computed_are_left_out(point, monkeypatch):
    chosen, every = laws(point, "fung")

    def fails(self, tasks):
        raise ComputationFailed("no")

    monkeypatch.setattr(Stiffening, "__call__", fails)
    assert looked(point, chosen, every, silent) == ([], [])


def test_nothing_is_looked_at_where_there_is_nothing_to_look_at(point):
    places = point.inverse.run.places
    assert looked(point, [], [], silent) == ([], [])
    assert point.inverse.run.places == places
