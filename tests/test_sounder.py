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
from cutbench.calibration.identifiability import Unknown
from cutbench.discovery import rounds, sounder
from cutbench.discovery.point import Point
from cutbench.discovery.sounder import does_nothing, moved, without

LAW = SimpleNamespace(parameters=(), cause="mechanism", slot="bulk")
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


def test_the_model_goes_where_the_candidate_has_led_if_it_is_likelier_there_without(cuts):
    point = at(cuts, **AWAY)
    q, part = without(point, at(cuts, **TRUE))
    assert part > 0.9
    fitted, there = moved(point, q, cuts.run, False, silent)
    assert there.likelihood > point.likelihood
    for name, value in TRUE.items():
        assert there.values[name] == pytest.approx(value, rel=0.02)
        assert fitted.case.values[name] == pytest.approx(value, rel=0.02)


def test_a_gain_of_its_own_is_the_candidates(cuts, monkeypatch):
    """It makes the data far likelier than the model is anywhere."""
    point, after = at(cuts, **AWAY), at(cuts, **TRUE)
    whole = sounder._likely
    monkeypatch.setattr(sounder, "_likely", lambda one, *by: 1e6 if one is after else whole(one, *by))
    _, part = without(point, after)
    assert part < 0.01


@pytest.mark.parametrize("strength, nothing", [(0.0, True), (0.2, False)])
def test_a_law_that_ends_at_nothing_has_gained_nothing(cuts, strength, nothing):
    point, after = at(cuts, **AWAY), at(cuts, **TRUE)
    model, off = after.case.model.extended("fung")
    case = replace(after.case, mechanisms=model.mechanisms, values={**after.case.values, **off})
    law = Unknown(model.parameters()["b_fung"], 0.2, 0.0, 1.0)
    inverse = after.inverse.other([*after.inverse.unknowns, law], case)
    after = replace(after, inverse=inverse, q=np.append(after.q, law.q(strength)))
    assert does_nothing(point, after) == nothing
    assert not does_nothing(point, point)


def test_a_model_that_is_where_it_is_likeliest_stays(cuts):
    point = at(cuts, **TRUE)
    assert without(point, at(cuts, **AWAY)) is None
    assert moved(point, at(cuts, **AWAY).q, cuts.run, False, silent) is None


def test_a_round_ends_where_a_candidate_has_led_elsewhere(cuts, monkeypatch):
    point = at(cuts, **AWAY)
    monkeypatch.setattr(rounds, "extend", lambda *given, **how: at(cuts, **TRUE))
    monkeypatch.setattr(rounds, "sense", lambda *given: None)
    law = SimpleNamespace(name="law", p=0.0, gain=100.0, z=5.0, column=SimpleNamespace(candidate=LAW))
    asking = rounds._Asking(point, cuts.run, 0, silent, again=True)
    scores = SimpleNamespace(scores=[law], expected=None)
    with pytest.raises(rounds.Elsewhere):
        [*asking._trying(rounds.Place.of(point), scores, {}, ["law"], {})]
    assert np.abs(asking.elsewhere - at(cuts, **TRUE).q).max() < 0.05
