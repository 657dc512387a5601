"""Where the fit of a model with a candidate begins, with forces by a formula."""

from __future__ import annotations

import numpy as np
import pytest
from formula_of_cuts import TRUE, Formula, campaign_in
from test_discover_cuts import point_at

from cutbench.calibration.sparing import Sparing
from cutbench.discovery.candidates import candidates
from cutbench.discovery.columns import Column
from cutbench.discovery.extending import Place, _at_off, _extended, _stepped
from cutbench.discovery.score import Score


@pytest.fixture
def point(tmp_path):
    return point_at(campaign_in(tmp_path), Formula(), **TRUE)


def asked(point, by: dict[str, np.ndarray]) -> tuple[Sparing, Score]:
    """The problem of a model with a candidate that changes readings ``by`` so much a unit of strength."""
    chosen, _ = candidates(point.inverse, point.case)
    candidate = next(c for c in chosen if c.name == "maxwell")
    column = Column(candidate, candidate.grid[0], {id: v[:, None] for id, v in by.items()})
    score = Score(column, 1.0, np.array([0.05]), np.zeros(2), np.zeros(1))
    place = Place.of(point)
    inverse, off = _extended(point, place, score)
    return Sparing(inverse, *_at_off(place, score, off)), score


def test_a_step_by_the_works_costs_no_run_and_makes_them_agree(point):
    run = point.inverse.run
    ramp = {id: np.linspace(0, 0.1, p.y.size) for id, p in point.inverse.predictions(point.q).items()}
    for id, v in ramp.items():
        point.inverse.grids[id].mean[:] += 0.4 * v
    inverse, score = asked(point, ramp)
    places = run.places
    stepped = _stepped(inverse, score)
    assert run.places == places
    assert stepped.strengths[0] == pytest.approx(0.4, rel=0.15)
    assert np.abs(stepped.free).max() < 0.05


def test_one_that_would_have_to_be_negative_keeps_its_score(point):
    ramp = {id: np.linspace(0, 0.1, p.y.size) for id, p in point.inverse.predictions(point.q).items()}
    for id, v in ramp.items():
        point.inverse.grids[id].mean[:] -= 0.4 * v
    inverse, score = asked(point, ramp)
    assert _stepped(inverse, score) is score
