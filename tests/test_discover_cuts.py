"""What discovery asks of cuts, with forces by a formula."""

from __future__ import annotations

import numpy as np
import pytest
from formula_of_cuts import TRUE, Formula, campaign_in, inverse_of

from cutbench.base.progress import silent
from cutbench.discovery.point import Point
from cutbench.discovery.rounds import round_of


def point_at(campaign, run: Formula, **values: float) -> Point:
    inverse = inverse_of(campaign, run)
    q = np.array([u.q(values[u.name]) for u in inverse.unknowns])
    found, w = inverse.predictions(q), inverse.guessed(q)
    y = {id: p.y + w.tests[id].shift for id, p in found.items()}
    J = {e.id: inverse.slopes(e, found[e.id], q) for e in campaign.train}
    return Point(inverse, q, w, y, J, {}, (), {}, {})


def test_a_model_that_describes_the_cuts_is_asked_nothing(tmp_path):
    run = Formula(error=AssertionError)
    point = point_at(campaign_in(tmp_path), run, **TRUE)
    run.fails = run.places
    this = round_of(point, run, 0, silent)
    assert this.scores.p_residual > 0.1
    assert not this.tried and this.accepted is None and not this.failed


def test_one_that_does_not_is(tmp_path):
    run = Formula(error=AssertionError)
    point = point_at(campaign_in(tmp_path), run, G=1.5 * TRUE["G"], G_c=0.4 * TRUE["G_c"])
    run.fails = run.places
    with pytest.raises(AssertionError):
        round_of(point, run, 0, silent)
