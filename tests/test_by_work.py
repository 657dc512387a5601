"""Where fits of cuts begin: the work finds a drop that the force does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from formula_of_cuts import TRUE, Formula, campaign_in, inverse_of

from cutbench.base.errors import ComputationFailed
from cutbench.calibration import by_work, lm
from cutbench.calibration.inverse import Inverse


@pytest.fixture
def cuts(tmp_path):
    return campaign_in(tmp_path)


def farthest(inverse: Inverse, q: np.ndarray) -> float:
    """Of the values at ``q`` from the true ones, as a logarithm."""
    found = zip(inverse.unknowns, inverse.values(q), strict=True)
    return max(abs(np.log(value / TRUE[u.label])) for u, value in found)


def test_the_work_leads_to_drops_that_forces_do_not_find(cuts):
    inverse = inverse_of(cuts, Formula())
    found = by_work.nearby(inverse, np.zeros(2))
    assert farthest(inverse, np.zeros(2)) > 0.3
    assert farthest(inverse, found.q) < 0.04
    plain = inverse_of(cuts, Formula(), across=False)
    w = plain.guessed(np.zeros(2))
    by_force = lm.minimise(lambda q: plain.whitened(q, w), np.zeros(2), *plain.bounds)
    assert farthest(plain, by_force.q) > 0.1


def test_derivatives_of_the_difference_are_those_of_the_works(cuts):
    inverse, q = inverse_of(cuts, Formula()), np.zeros(2)
    r, J = by_work.difference(inverse, q)
    assert r.shape == (80,) and J.shape == (80, 2)
    # Beyond both drops the work changes in proportion to the parameters, over the step that was taken.
    for k, step in ((0, 0.1), (1, 0.1)):
        there = q.copy()
        there[k] = step
        change = by_work.difference(inverse, there)[0] - r
        assert np.linalg.norm(change - J[:, k] * step) < 0.35 * np.linalg.norm(change)


def test_an_interruption_leaves_the_best_place_so_far(cuts):
    inverse = inverse_of(cuts, Formula(fails=3))
    found = by_work.nearby(inverse, np.zeros(2))
    assert found.interrupted
    assert farthest(inverse, found.q) <= farthest(inverse, np.zeros(2))
    found.inverse.predictions(found.q)  # is known


def test_one_at_once_computes_nothing_more(cuts):
    run = Formula()
    inverse = inverse_of(cuts, run, across=False)
    inverse.predictions(np.zeros(2))
    run.fails = run.places
    found = by_work.nearby(inverse, np.zeros(2))
    assert found.interrupted
    assert not found.q.any()
    found.inverse.predictions(found.q)


def test_a_start_that_cannot_be_computed_is_said(cuts):
    with pytest.raises(ComputationFailed):
        by_work.nearby(inverse_of(cuts, Formula(0, ComputationFailed)), np.zeros(2))


def test_negative_forces_count_too(cuts):
    """Of a blade that is drawn out."""
    inverse = inverse_of(cuts, Formula())
    for id, grid in inverse.grids.items():
        inverse.grids[id] = replace(grid, mean=grid.mean - 1.0)
    r, J = by_work.difference(inverse, np.zeros(2))
    assert np.isfinite(r).all() and np.isfinite(J).all()
