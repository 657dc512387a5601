"""Measures of a curve: exact on polygons, independent of the steps, proportional to the force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cutbench.run.measures import MEASURES, label, measures

WINDOW = 0.7


def curve(d, F, c):
    return {"displacement_mm": np.array(d), "force_N": np.array(F), "cut_length_mm": np.array(c)}


#: Indentation to 1 N at 4 mm, a drop by 40 % within 0.35 mm, then a rise of 0.05 N/mm up to 20 mm.
SHARP = curve([0, 4, 4.35, 20], [0, 1, 0.6, 0.6 + 0.05 * 15.65], [0, 0, 2, 17])


def resampled(base, extra):
    d = np.union1d(base["displacement_mm"], extra)
    return {"displacement_mm": d} | {
        name: np.interp(d, base["displacement_mm"], base[name]) for name in ("force_N", "cut_length_mm")
    }


def test_values_of_a_polygon_known_by_hand():
    m = measures(SHARP, window_mm=WINDOW)
    assert m["peak_mm"] == 4 and m["peak_N"] == 1
    # The mean over half a window: its largest fall begins a quarter before the peak.
    assert 0.35 < m["drop_rel"] < 0.4
    assert m["onset_mm"] == pytest.approx(4 + 0.1 / 2 * 0.35)
    assert m["slope_N_per_mm"] == pytest.approx(0.05)
    assert m["steady_N"] == pytest.approx(0.6 + 0.05 * (16 - 4.35))
    assert m["energy_mJ"] == pytest.approx(2 + 0.8 * 0.35 + (0.6 + 0.05 * 15.65 / 2) * 15.65)
    # The window holds all of the jump by 2 mm and 0.35 mm of the pace 15/15.65 after it.
    assert m["surge"] == pytest.approx((2 + 0.35 * 15 / 15.65) / WINDOW)
    assert list(m) == list(MEASURES)


def test_a_drop_slower_than_the_window_counts_only_in_part():
    slow = curve([0, 4, 6, 20], [0, 1, 0.5, 0.5], [0, 0, 2, 16])
    # Just before the plateau the mean falls from 0.5 + 0.25 WINDOW less what the blur takes.
    whole = 0.25 * WINDOW / (0.5 + 0.25 * WINDOW)
    assert 0.9 * whole < measures(slow, window_mm=WINDOW)["drop_rel"] < whole


def test_a_jump_at_one_travel_is_seen_whole():
    snap = curve([0, 4, 4, 20], [0, 1, 0.3, 1.0], [0, 0, 3, 19])
    m = measures(snap, window_mm=WINDOW)
    before, after = 1 - 0.25 * WINDOW / 4, 0.3 + 0.7 / 16 * WINDOW / 4
    assert m["drop_rel"] == pytest.approx(1 - after / before, abs=2e-3)
    assert m["surge"] >= 3 / WINDOW


def test_serrations_shorter_than_half_a_blade_are_no_drop():
    d = np.linspace(0, 20, 4001)
    wavy = curve(d, 1 + 0.1 * d + 0.2 * np.sin(2 * np.pi * d / (WINDOW / 2)), np.maximum(d - 2, 0))
    assert measures(wavy, window_mm=WINDOW)["drop_rel"] < 1e-2


def test_steady_cutting_ends_above_the_base():
    clamped = curve([0, 4, 4.35, 16, 20], [0, 1, 0.6, 1, 9], [0, 0, 2, 14, 17])
    m = measures(clamped, window_mm=WINDOW, height_mm=20 - 4 + 4 * WINDOW)
    assert m["slope_N_per_mm"] == pytest.approx(0.4 / 11.65)
    assert m["steady_N"] == pytest.approx(0.6 + 0.4 / 11.65 * (12.8 - 4.35))


#: The force of SHARP, with other ways of the cut.
STEADY = {
    "a cut as fast as the blade": ([0, 0, 2, 17], 20, True),
    "no cut": ([0, 0, 0.05, 0.05], 20, False),
    "a cut that stays behind": ([0, 0, 0.3, 4], 20, False),
    "a blade that stops within the transition": ([0, 0, 2, 17], 6.5, False),
    "a blade that stops a thickness behind it": ([0, 0, 2, 17], 8, True),
}


@pytest.mark.parametrize("name", STEADY)
def test_a_force_is_steady_where_the_cut_advances_with_the_blade_behind_the_transition(name):
    cut, end, steady = STEADY[name]
    base = curve([0, 4, 4.35, 20], SHARP["force_N"], cut)
    upto = resampled(base, [end])
    ends = upto["displacement_mm"] <= end
    m = measures({key: values[ends] for key, values in upto.items()}, window_mm=WINDOW)
    assert math.isfinite(m["steady_N"]) == math.isfinite(m["slope_N_per_mm"]) == steady
    if steady:
        assert m["slope_N_per_mm"] == pytest.approx(0.05)
        # No force behind the transition is below 0.74 N.
        assert m["steady_N"] > 0.6 + 0.05 * (4.02 + 4 * WINDOW - 4.35)


def test_a_monotone_force_has_no_peak_and_no_drop():
    m = measures(curve([0, 10, 20], [0, 2, 3], [0, 8, 18]), window_mm=WINDOW)
    assert math.isnan(m["peak_mm"]) and math.isnan(m["peak_N"])
    assert m["drop_rel"] == 0 and m["max_N"] == 3


def test_what_happens_before_the_cut_is_no_transition():
    early = curve([0, 1, 1.2, 10, 20], [0, 1, 0.5, 4, 5], [0, 0, 0, 0, 10])
    m = measures(early, window_mm=WINDOW)
    assert m["drop_rel"] == 0
    assert m["peak_mm"] == 1  # still a peak of the curve


def test_what_slips_long_after_the_onset_is_no_transition():
    slip = curve([0, 4, 7, 7.05, 12], [0, 1, 1.6, 1.2, 2], [0, 0, 3, 3.1, 8])
    assert measures(slip, window_mm=WINDOW)["drop_rel"] == 0.0


def test_a_curve_without_cut_has_no_transition():
    m = measures(curve([0, 20], [0, 3], [0, 0.05]), window_mm=WINDOW)
    assert math.isnan(m["onset_mm"]) and math.isnan(m["drop_rel"]) and m["surge"] == pytest.approx(0.05 / 20)
    assert label(m["drop_rel"], m["surge"]) == "uncut"


def test_a_ripple_below_the_prominence_is_no_peak():
    d = np.linspace(0, 20, 401)
    F = d + 0.02 * np.sin(6 * d)
    assert math.isnan(measures(curve(d, F, d), window_mm=WINDOW)["peak_mm"])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 20), max_size=60))
def test_points_added_along_the_polygon_change_nothing(extra):
    base = measures(SHARP, window_mm=WINDOW)
    other = measures(resampled(SHARP, extra), window_mm=WINDOW)
    for name in MEASURES:
        assert other[name] == pytest.approx(base[name], rel=1e-7, abs=1e-9), name


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-4, 1e4), st.lists(st.just(0.0) | st.floats(1e-9, 5), min_size=4, max_size=30))
def test_forces_scale_and_ratios_stay(factor, forces):
    d = np.linspace(0, 20, len(forces))
    base = curve(d, forces, d)
    scaled = base | {"force_N": factor * base["force_N"]}
    a, b = measures(base, window_mm=WINDOW), measures(scaled, window_mm=WINDOW)
    for name in ("peak_N", "max_N", "steady_N", "slope_N_per_mm", "energy_mJ"):
        assert b[name] == pytest.approx(factor * a[name], rel=1e-6, abs=1e-9 * factor, nan_ok=True)
    for name in ("onset_mm", "surge", "peak_mm"):
        assert b[name] == pytest.approx(a[name], nan_ok=True)
    assert b["drop_rel"] == pytest.approx(a["drop_rel"], abs=1e-6)


def smooth_drop(d):
    """An analytic cut: rise to 1 N, fall by a quarter around 4 mm, slow rise; the cut starts at 4 mm."""
    fall = 0.25 / (1 + np.exp(-(d - 4.0) / 0.08))
    return curve(d, np.tanh(d / 2) - fall + 0.02 * d, np.clip(d - 4, 0, None) * 1.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_random_steps_see_the_same_curve(seed):
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.004, 0.1, size=2000)
    d = np.concatenate([[0], np.cumsum(steps)])
    d = np.append(d[d < 20], 20.0)
    fine = measures(smooth_drop(np.linspace(0, 20, 20001)), window_mm=WINDOW)
    got = measures(smooth_drop(d), window_mm=WINDOW)
    assert fine["drop_rel"] == pytest.approx(0.21, abs=0.04)
    for name in ("drop_rel", "peak_N", "max_N", "steady_N", "surge", "energy_mJ"):
        assert got[name] == pytest.approx(fine[name], rel=0.02), name
    assert got["peak_mm"] == pytest.approx(fine["peak_mm"], abs=0.1)
    assert got["onset_mm"] == pytest.approx(fine["onset_mm"], abs=0.05)


def test_halving_the_step_changes_little_and_ever_less():
    fine = measures(smooth_drop(np.linspace(0, 20, 40001)), window_mm=WINDOW)["drop_rel"]
    errors = [
        abs(measures(smooth_drop(np.arange(0, 20 + h / 2, h)), window_mm=WINDOW)["drop_rel"] - fine)
        for h in (0.2, 0.05, 0.0125)
    ]
    assert errors[2] < 1e-3 and errors[2] < errors[0]


@pytest.mark.parametrize(
    ("drop", "surge", "kwargs", "expected"),
    [
        (0.1, 1.0, {}, "abrupt"),
        (0.0999, 9.0, {}, "smooth"),
        (0.5, 1.5, {"surge_min": 2.0}, "smooth"),
        (0.5, 2.5, {"surge_min": 2.0}, "abrupt"),
        (0.2, 1.0, {"drop": 0.3}, "smooth"),
        (math.nan, 1.0, {}, "uncut"),
    ],
)
def test_label(drop, surge, kwargs, expected):
    assert label(drop, surge, **kwargs) == expected


@pytest.mark.parametrize(
    "broken",
    [
        curve([0, 2, 1], [0, 1, 2], [0, 0, 0]),
        curve([0, 1, 2], [0, np.nan, 2], [0, 0, 0]),
        {"displacement_mm": np.zeros(3), "force_N": np.zeros(2), "cut_length_mm": np.zeros(3)},
    ],
)
def test_a_curve_that_is_none_is_refused(broken):
    with pytest.raises(ValueError):
        measures(broken, window_mm=WINDOW)


def test_one_point_is_no_curve_yet():
    assert all(math.isnan(v) for v in measures(curve([0], [0], [0]), window_mm=WINDOW).values())
