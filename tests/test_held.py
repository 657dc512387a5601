"""Damage and multipliers that are held: mixing only shortens the way to where they stand still."""

from dataclasses import replace

import numpy as np

from cutbench.case.case import load_case
from cutbench.run.build import build
from cutbench.solver.held import DEPTH, Mixing


def test_mixing_gets_to_a_fixed_point_that_a_loop_only_creeps_to():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((40, 40)))[0]
    A = turn @ np.diag(np.linspace(0.0, 0.95, 40) ** 4) @ turn.T
    b = rng.standard_normal(40)
    end, left = np.linalg.solve(np.eye(40) - A, b), {}
    for mixes in (False, True):
        x, mixing = np.zeros(40), Mixing()
        for _ in range(20):
            found = A @ x + b
            x = mixing.mixed(found, found - x) if mixes else found
        left[mixes] = np.abs(x - end).max() / np.abs(end).max()
    assert left[True] < 1e-4 < 0.1 * left[False]


def test_mixing_begins_anew_where_changes_leap_or_are_of_something_else():
    mixing, x = Mixing(), np.ones(3)
    for k in range(2 * DEPTH):
        mixing.mixed(x * k, 0.5**k * np.eye(3)[k % 3])
    leapt = 10 * x
    assert mixing.mixed(leapt, x) is leapt
    mixing.mixed(x, x / 2)
    assert mixing.mixed(leapt, np.ones(2)) is leapt


def test_mixing_ends_where_the_loop_does(monkeypatch):
    case = load_case("gelatin", {"numerics": "paper"}).set(h="1 mm", depth="1.6 mm")
    case = case.set(penalty=case.numerics.penalty / 20)  # soft beside the body, as a block's is
    finer = {"multipliers": 1e-5, "staggered_change": 1e-6}

    def marched():
        march = build(case).march
        march = replace(march, newton=replace(march.newton, **finer))
        march = replace(march, rules=replace(march.rules, augmentations=1000))
        steps = list(march)
        return [step.force for step in steps], sum(len(step.solves) for step in steps)

    forces, solutions = marched()
    monkeypatch.setattr(Mixing, "mixed", lambda self, found, change: found)
    expected, plain = marched()
    np.testing.assert_allclose(forces, expected, rtol=1e-6)
    assert solutions < 0.7 * plain
