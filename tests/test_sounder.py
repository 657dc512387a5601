"""A candidate's gain that other values of the model have without it, with forces by a formula."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from formula_of_cuts import TRUE, campaign_in
from test_discover_cuts import point_at
from test_emulated import Remembering, inverse_of

from cutbench.base.progress import silent
from cutbench.calibration import survey
from cutbench.discovery import sounder as module
from cutbench.discovery.point import Point

AWAY = {"G": TRUE["G"] * 1.1, "G_c": TRUE["G_c"] * 1.3}


@pytest.fixture
def cuts(tmp_path):
    """A campaign that the formula describes, and all that a look around it knows."""
    campaign, run = campaign_in(tmp_path), Remembering()
    inverse = inverse_of(campaign, run)
    survey.Survey(inverse, [np.zeros(2)]).look()
    return inverse


def at(inverse, **values: float) -> Point:
    q = np.array([u.q(values[u.name]) for u in inverse.unknowns])
    return replace(
        point_at(inverse.campaign, inverse.run, **values), inverse=inverse, q=q, w=inverse.guessed(q)
    )


def round_at(point: Point, candidate: Point | None) -> SimpleNamespace:
    """Of which ``candidate`` is the model with what was accepted."""
    tried = () if candidate is None else (SimpleNamespace(name="law", point=candidate),)
    return SimpleNamespace(point=point, tried=tried, accepted=None if candidate is None else "law")


def test_the_model_goes_where_the_candidate_has_led_if_it_is_likelier_there_without(cuts):
    point = at(cuts, **AWAY)
    fitted, there = module.sounder(round_at(point, at(cuts, **TRUE)), cuts.run, False, silent)
    assert there.likelihood > point.likelihood
    for name, value in TRUE.items():
        assert there.values[name] == pytest.approx(value, rel=0.02)
        assert fitted.case.values[name] == pytest.approx(value, rel=0.02)


def test_a_gain_of_its_own_is_the_candidates(cuts, monkeypatch):
    """It makes the data far likelier than the model is anywhere."""
    point, taken = at(cuts, **AWAY), at(cuts, **TRUE)
    whole = module._likely
    monkeypatch.setattr(module, "_likely", lambda p, q: 1e6 if p is taken else whole(p, q))
    places = cuts.run.places
    assert module.sounder(round_at(point, taken), cuts.run, False, silent) is None
    assert cuts.run.places == places


def test_nothing_is_fitted_where_nothing_was_accepted(cuts):
    point, places = at(cuts, **AWAY), cuts.run.places
    assert module.sounder(round_at(point, None), cuts.run, False, silent) is None
    assert cuts.run.places == places
