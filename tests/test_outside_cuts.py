"""The benchmark of blind cuts: what it hides is what it says, and nothing of it is a candidate's formula."""

from __future__ import annotations

from collections import Counter

import numpy as np

from benchmarks.outside_cuts import (
    CLASSES,
    NONE,
    OTHERWISE,
    SPEEDS,
    SWING,
    plan,
    recorded,
    summary,
    true_case,
)


def test_a_sixth_hides_nothing_and_every_effect_comes_in_turn():
    counts = Counter(effect for effect, _ in plan(24, seed=3))
    assert counts[NONE] == 4 and counts[SWING] == 1
    assert all(counts[effect] >= 2 for effect in CLASSES)
    assert plan(24, seed=3) == plan(24, seed=3) != plan(24, seed=4)


def test_a_record_has_its_error_and_no_other():
    x, F = np.linspace(0.1, 5, 50), np.linspace(0, 1, 50)
    for effect in ("toughness by speed", NONE):
        np.testing.assert_array_equal(recorded(effect, 1.0, x, F, 0.01), (x, F))
    longer, same = recorded("compliance", 1.0, x, F, 0.01)
    gives = longer - x
    # The same machine in a cut that bears less, and no spring: at twice the force it gives less than twice.
    np.testing.assert_allclose(recorded("compliance", 1.0, x[:25], F[:25], 0.01)[0] - x[:25], gives[:25])
    assert 1.5 < gives[48] / gives[24] < 1.9
    np.testing.assert_array_equal(same, F)
    late, kept = recorded("late zero", 1.0, x, F, 0.01)
    assert late.min() > 0 and late.max() == x.max() - 0.5 and kept.size == late.size
    slow, fast = (recorded("drift", 1.0, x, F, v)[1] - F for v in (0.005, 0.05))
    np.testing.assert_allclose(slow, 10 * fast)


def test_a_compliant_machine_stands_still_where_the_specimen_snaps():
    x = np.linspace(0.05, 5, 100)
    F = np.where(x < 3, 0.4 * x, 0.3)
    at, force = recorded("compliance", 1.0, x, F, 0.01)
    assert np.all(np.diff(at) > 0) and at.size == force.size < x.size
    # Nothing but what was read at the stand is lost.
    assert force[0] == F[0] and force[-1] == F[-1]


def test_toughness_is_a_power_of_the_speed_and_the_law_is_not_told():
    cases = [true_case("toughness by speed", v, 1.0, OTHERWISE[0][1]) for v in SPEEDS.values()]
    growth = np.log([c.values["G_c"] / cases[0].values["G_c"] for c in cases])
    np.testing.assert_allclose(
        growth, 0.25 * np.log([v / SPEEDS["slow"] for v in SPEEDS.values()]), atol=1e-12
    )
    assert all("rate_toughness" not in c.mechanisms for c in cases)


def test_the_truth_has_other_numerics_than_a_fit():
    plain = true_case(NONE, 0.02, 1.0, {})
    others = [true_case(NONE, 0.02, 1.0, choices) for _, choices in OTHERWISE]
    assert len({c.id for c in [plain, *others]}) == len(OTHERWISE) + 1


def test_what_the_baseline_takes_up_is_counted_by_itself():
    head = {"wrong": [], "seconds": 1.0}
    rows = [
        {**head, "effect": "drift", "right": False, "seen": False, "found": []},
        {**head, "effect": "drift", "right": True, "seen": True, "found": ["force_drift"]},
        {**head, "effect": "blunt tip", "right": False, "seen": True, "found": []},
        {**head, "effect": NONE, "right": True, "seen": False, "found": []},
    ]
    assert list(summary(rows).values())[:4] == ["1 of 3", "1 of 2", "1 of 1", "1 of 1"]
