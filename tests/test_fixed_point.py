"""Damage and multipliers that are held: mixing only shortens the way to where they stand still."""

import numpy as np

from cutbench.solver.fixed_point import MIXING_DEPTH, AndersonMixing


def test_mixing_gets_to_a_fixed_point_that_a_loop_only_creeps_to():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((40, 40)))[0]
    A = turn @ np.diag(np.linspace(0.0, 0.95, 40) ** 4) @ turn.T
    b = rng.standard_normal(40)
    end, left = np.linalg.solve(np.eye(40) - A, b), {}
    for mixes in (False, True):
        x, mixing = np.zeros(40), AndersonMixing()
        for _ in range(20):
            found = A @ x + b
            x = mixing.mixed(found, found - x) if mixes else found
        left[mixes] = np.abs(x - end).max() / np.abs(end).max()
    assert left[True] < 1e-4 < 0.1 * left[False]


def test_mixing_begins_anew_where_changes_leap_or_are_of_something_else():
    mixing, x = AndersonMixing(), np.ones(3)
    for k in range(2 * MIXING_DEPTH):
        mixing.mixed(x * k, 0.5**k * np.eye(3)[k % 3])
    leapt = 10 * x
    assert mixing.mixed(leapt, x) is leapt
    mixing.mixed(x, x / 2)
    assert mixing.mixed(leapt, np.ones(2)) is leapt
