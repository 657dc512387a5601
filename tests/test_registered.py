"""Curves that drop are foreseen by where they do, and how surely is told."""

from __future__ import annotations

import numpy as np
import pytest

from cutbench.calibration.registered import Registered

END = 5.0
X = np.linspace(0, END, 81)


def cut(place: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """A force that rises as x^1.5 until a depth that both coordinates set, and falls there to what lasts."""
    begins = 2.5 * np.exp(0.5 * place[0] + 0.2 * place[1] ** 2)
    x = np.linspace(0, END, 400)
    rising, lasting = x**1.5, (1 + 0.3 * place[1]) * (1 + 0.1 * x)
    after = lasting + (begins**1.5 - lasting) * np.exp(-(x - begins) / 0.15)
    return (x, np.where(x < begins, rising, after)), begins if begins < END else np.nan


def known(count: int, seed: int) -> tuple[np.ndarray, list, np.ndarray]:
    places = np.random.default_rng(seed).uniform(-1, 1, (count, 2)) * [1.5, 1]
    curves, begins = zip(*map(cut, places), strict=True)
    return places, list(curves), np.array(begins)


def off(made: Registered, places: np.ndarray) -> np.ndarray:
    """Root mean squares, as parts of the largest force."""
    real = np.stack([np.interp(X, *cut(place)[0]) for place in places])
    return np.sqrt(np.mean((made(places) - real) ** 2, axis=1)) / real.max(axis=1)


def test_a_drop_is_foreseen_where_it_will_be():
    places, curves, begins = known(40, 0)
    assert np.isnan(begins).any(), "some do not begin"
    there = known(30, 1)[0]
    by_drop = off(Registered(places, curves, begins, X), there)
    without = off(Registered(places, curves, np.full(40, np.nan), X), there)
    assert np.median(by_drop) < 0.01 and np.median(by_drop) < 0.2 * np.median(without)


def test_what_is_known_is_as_it_is_and_small_beside_its_own_doubt():
    places, curves, begins = known(40, 0)
    made = Registered(places, curves, begins, X)
    assert off(made, places).max() < 0.05
    doubt = np.array([np.sqrt(np.mean(made.error(p) ** 2 * made.error(p).shape[1])) for p in places])
    far = np.sqrt(np.mean(made.error(np.array([6.0, 4.0])) ** 2) * made.error(np.array([6.0, 4.0])).shape[1])
    assert doubt.max() < far


def test_doubts_are_as_large_as_errors():
    """In the mean over places that are not known."""
    places, curves, begins = known(40, 0)
    made, there = Registered(places, curves, begins, X), known(40, 2)[0]
    real = np.stack([np.interp(X, *cut(place)[0]) for place in there])
    errors = np.sum((made(there) - real) ** 2, axis=1)
    claimed = np.array([np.sum(made.error(place) ** 2) for place in there])
    assert 0.1 < np.mean(errors) / np.mean(claimed) < 3.0


def test_curves_without_a_beginning_are_foreseen_along_the_way():
    places, curves, _ = known(30, 3)
    smooth = [(x, (1 + 0.2 * p[0]) * x + 0.1 * p[1] * x**2) for p, (x, _) in zip(places, curves, strict=True)]
    made = Registered(places, smooth, np.full(30, np.nan), X)
    there = np.array([[0.3, -0.4]])
    assert made(there)[0] == pytest.approx((1 + 0.06) * X - 0.04 * X**2, abs=0.02)
