"""Curves between places that are known: a trend, what is alike nearby, and how far that is."""

from __future__ import annotations

import numpy as np

from cutbench.calibration.kriging import Kriging


def test_a_trend_is_found_and_places_that_are_known_are_as_they_are():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (20, 3))
    linear = X @ rng.standard_normal((3, 5)) + 2.0
    there = rng.uniform(-3, 3, (4, 3))
    np.testing.assert_allclose(Kriging(X, linear)(X), linear, atol=1e-9)
    trend = np.linalg.lstsq(np.column_stack([np.ones(20), X]), linear, rcond=None)[0]
    np.testing.assert_allclose(
        Kriging(X, linear)(there), np.column_stack([np.ones(4), there]) @ trend, atol=1e-6
    )
    curved = np.sin(2 * X)
    A = np.column_stack([np.ones(20), X])
    by_trend = A @ np.linalg.lstsq(A, curved, rcond=None)[0]
    assert np.abs(Kriging(X, curved)(X) - curved).max() < 0.2 * np.abs(by_trend - curved).max()


def test_rounding_changes_nothing_that_is_foreseen():
    """The search for lengths ends at the same place."""
    rng = np.random.default_rng(2)
    X = rng.uniform(-1, 1, (40, 4))
    Y = np.sin(2 * X) @ rng.standard_normal((4, 20)) + 0.02 * rng.standard_normal((40, 20))
    there = rng.uniform(-1, 1, (10, 4))
    one, other = Kriging(X, Y)(there), Kriging(X, Y * (1 + 1e-14 * rng.standard_normal(Y.shape)))(there)
    np.testing.assert_allclose(one, other, atol=1e-7 * np.abs(Y).max())


def test_a_coordinate_that_nothing_depends_on_says_nothing():
    rng = np.random.default_rng(1)
    X = rng.uniform(-1, 1, (30, 2))
    Y = np.sin(3 * X[:, :1])
    there = np.array([[0.3, -50.0], [0.3, 50.0]])
    assert np.ptp(Kriging(X, Y)(there)) < 0.02
