"""The emulator: exact at its runs, as sure as it says between them, and blind to units."""

from __future__ import annotations

from dataclasses import replace

import emulator_runs
import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.emulator import CutEmulator, GaussianProcess, Groups, Kernel, RunDatabase
from cutbench.emulator.alignment import AlignedCurves, Course
from cutbench.emulator.gaussian_process import negative_log_posterior
from cutbench.run.runner import run_case

FREE = "G", "G_c", "tau_W", "eta_reg", "tip"


# -- the process --------------------------------------------------------------------------------------
def sampled(count, values=4, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(0, 1, (count, 3))
    return X, np.sin(3 * X) @ np.random.default_rng(9).standard_normal((3, values))


@pytest.mark.parametrize("sizes", [(0.0, np.inf), (3.0, 5.0)])
@pytest.mark.parametrize("trend", ["none", "linear"])
def test_the_likelihood_has_the_gradient_it_says(trend, sizes):
    X, Y = sampled(14)
    squares = (X.T[:, :, None] - X.T[:, None]) ** 2
    A = np.zeros((14, 0)) if trend == "none" else np.column_stack([np.ones(14), X])
    at, expected = np.array([0.2, -0.3, 0.1, -5.0]), np.zeros(4)
    slope = negative_log_posterior(at, squares, A, Y, expected, sizes)[1]
    for k, step in enumerate(1e-5 * np.eye(4)):
        ends = [negative_log_posterior(at + s * step, squares, A, Y, expected, sizes)[0] for s in (-1, 1)]
        assert slope[k] == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-5)


def test_it_goes_through_its_values_and_is_unsure_between_them():
    x = np.array([[0.0], [0.5], [1.0]])
    process = GaussianProcess(x, np.array([-1.0, 0.2, 1.0]), kernel=Kernel((0.3,), 1e-6), trend="none")
    np.testing.assert_allclose(process.mean(x), [-1.0, 0.2, 1.0], atol=1e-4)
    assert process.spread(x).max() < 5e-3 < process.spread(np.array([[0.25]]))[0]
    assert process.spread(x, runs=True).max() < 2e-3 * process.size


@pytest.mark.parametrize("trend", ["none", "constant", "linear"])
def test_fewer_places_than_a_trend_needs_are_refused(trend):
    few = {"none": 0, "constant": 1, "linear": 4}[trend]
    X, Y = sampled(few + 1)
    with pytest.raises(ValueError):
        GaussianProcess(X[:few], Y[:few], trend=trend)
    GaussianProcess(X, Y, trend=trend, lengths=(1.0, 1.0, 1.0))


def test_a_trend_is_found():
    rng = np.random.default_rng(0)
    X, there = rng.uniform(-1, 1, (20, 3)), rng.uniform(-3, 3, (4, 3))
    by = rng.standard_normal((3, 5))
    np.testing.assert_allclose(GaussianProcess(X, X @ by + 2).mean(there), there @ by + 2, atol=1e-6)


def test_a_coordinate_that_nothing_depends_on_says_nothing():
    X = np.random.default_rng(1).uniform(-1, 1, (30, 2))
    process = GaussianProcess(X, np.sin(3 * X[:, :1]))
    assert np.ptp(process.mean(np.array([[0.3, -50.0], [0.3, 50.0]]))) < 0.02


def test_rounding_changes_nothing():
    """The search for lengths ends at the same place."""
    (X, Y), there = sampled(40, 20), sampled(10, seed=2)[0]
    Y = Y + 0.02 * np.random.default_rng(3).standard_normal(Y.shape)
    one = GaussianProcess(X, Y).mean(there)
    other = GaussianProcess(X, Y * (1 + 1e-14 * np.random.default_rng(4).standard_normal(Y.shape))).mean(
        there
    )
    np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(Y).max())


# -- curves with a drop and without -------------------------------------------------------------------
END = 5.0
TRAVEL = np.linspace(0, END, 81)


def cut(place):
    """A force that rises as x^1.5 until a depth that both coordinates set, and falls there to what lasts."""
    begins = 2.5 * np.exp(0.5 * place[0] + 0.2 * place[1] ** 2)
    x = np.linspace(0, END, 400)
    rising, lasting = x**1.5, (1 + 0.3 * place[1]) * (1 + 0.1 * x)
    after = lasting + (begins**1.5 - lasting) * np.exp(-(x - begins) / 0.15)
    return Course(x, np.where(x < begins, rising, after), begins if begins < END else np.nan)


def known(count, seed):
    places = np.random.default_rng(seed).uniform(-1, 1, (count, 2)) * [1.5, 1]
    return places, [cut(place) for place in places]


def off(made, places):
    """Root mean squares, as parts of the largest force."""
    real = np.stack([np.interp(TRAVEL, cut(p).x, cut(p).force) for p in places])
    return np.sqrt(np.mean((made.mean(places) - real) ** 2, axis=1)) / real.max(axis=1)


def test_a_drop_is_where_it_will_be():
    places, courses = known(40, 0)
    assert any(np.isnan(c.onset) for c in courses), "some do not begin"
    there = known(30, 1)[0]
    aligned = off(AlignedCurves(places, courses, TRAVEL), there)
    unaligned = [replace(c, onset=np.nan) for c in courses]
    without = off(AlignedCurves(places, unaligned, TRAVEL), there)
    assert np.median(aligned) < 0.01 and np.median(aligned) < 0.2 * np.median(without)


def test_what_follows_an_onset_may_bend_with_the_place():
    """Where it begins and what it bears then change little; what is beyond is no straight function, though of
    one curve nothing of that is known."""
    travel = np.linspace(0, 4, 81)

    def course(place: float) -> Course:
        onset = 2 + 0.2 * place
        beyond = np.maximum(travel - onset, 0)
        fall = 0.5 * (1 + np.sin(4 * place)) * (1 - np.exp(-2 * beyond))
        return Course(travel, (1 + 0.1 * place) * np.minimum(travel, onset) - fall, onset)

    places, there = np.linspace(-1, 1, 13)[:, None], np.array([[-0.6], [0.1], [0.75]])
    courses = [course(p) for p in places[:, 0]]
    begun = travel <= courses[3].onset + 0.04
    courses[3] = Course(travel[begun], courses[3].force[begun], courses[3].onset)
    made = AlignedCurves(places, courses, travel).mean(there)
    real = np.array([course(p).force for p in there[:, 0]])
    np.testing.assert_allclose(made[:, :74], real[:, :74], atol=0.03)  # what few reach is said of those


def test_curves_without_a_drop_need_no_onset():
    places = np.random.default_rng(5).uniform(-1, 1, (20, 2))
    courses = [Course(TRAVEL, (2 + p[0]) * TRAVEL ** (1.5 + 0.1 * p[1]), np.nan) for p in places]
    made, there = AlignedCurves(places, courses, TRAVEL), np.array([[0.2, -0.3]])
    np.testing.assert_allclose(made.mean(there)[0], 2.2 * TRAVEL**1.47, rtol=0.01, atol=0.02)
    assert made.onset(there)[0] == END


def test_errors_are_as_large_as_they_are_said_to_be():
    """In the mean over places that are not known, of curves that drop at many depths."""
    places, courses = known(40, 0)
    made, there = AlignedCurves(places, courses, TRAVEL), known(40, 2)[0]
    real = np.stack([np.interp(TRAVEL, cut(p).x, cut(p).force) for p in there])
    errors = np.sum((made.mean(there) - real) ** 2, axis=1)
    said = np.array([np.sum(made.root(place) ** 2) for place in there])
    assert 0.1 < np.mean(errors) / np.mean(said) < 3.0


# -- runs ---------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def runs():
    rows, forces, onsets = emulator_runs.kept()
    return [emulator_runs.case_of(row) for row in rows], forces, onsets


def made_of(runs, count) -> CutEmulator:
    cases, forces, onsets = runs
    database = RunDatabase()
    for case, force, onset in zip(cases[:count], forces, onsets, strict=False):
        database.add(case, np.stack([emulator_runs.X, force]), onset)
    found = database.emulator(cases[-1:], FREE)
    assert found is not None and found.count == count
    return found


def test_it_knows_its_runs_exactly_and_is_unsure_of_others(runs):
    cases, forces, _ = runs
    made = made_of(runs, 34)
    for case, force in zip(cases[:34:5], forces[::5], strict=False):
        x, exact = made.computed(case.values)
        np.testing.assert_allclose(x, emulator_runs.X, atol=1e-9)
        np.testing.assert_allclose(exact, force, rtol=1e-9)
    assert made.computed(cases[40].values) is None and made.root(cases[40].values).any()


def test_at_runs_that_it_has_not_seen_it_errs_as_it_says(runs):
    """At 30 runs, of nine in ten forces the error is within what it says for nine in ten."""
    cases, forces, onsets = runs
    made, inside, errors, onset = made_of(runs, 34), [], [], []
    for case, force, begins in zip(cases[34:], forces[34:], onsets[34:], strict=True):
        x = made.travel(case.values)
        error = made.forces([case.values])[0] - np.interp(x, emulator_runs.X, force)
        deviation = np.sqrt((made.root(case.values) ** 2).sum(axis=1))
        inside.append(np.mean(np.abs(error)[2:] < 1.645 * deviation[2:]))
        errors.append(np.sqrt(np.mean(error**2)) / force.max())
        onset.append(made.onset_mm(case.values) / begins - 1)
    assert len(inside) == 30 and 0.80 <= np.mean(inside) <= 0.97
    assert np.median(errors) < 0.04 and np.nanmedian(np.abs(onset)) < 0.01


def test_more_runs_err_less(runs):
    cases, forces, _ = runs
    errors = {}
    for count in (12, 48):
        made = made_of(runs, count)
        gaps = [
            made.forces([case.values])[0] - np.interp(made.travel(case.values), emulator_runs.X, force)
            for case, force in zip(cases[48:], forces[48:], strict=True)
        ]
        errors[count] = np.median(np.sqrt(np.mean(np.square(gaps), axis=1)))
    assert errors[48] < 0.7 * errors[12]


def test_two_gels_at_two_speeds_are_samples_of_one_function(runs):
    """In units of the modulus and the speed: what one is said to give the other does, in proportion."""
    made, values = made_of(runs, 34), dict(runs[0][40].values)
    other = {**values, **{n: 2 * values[n] for n in ("G", "G_c", "tau_W")}}
    other |= {"speed": 3 * values["speed"], "eta_reg": values["eta_reg"] / 3}
    np.testing.assert_allclose(made.forces([other]), 2 * made.forces([values]), rtol=1e-9)
    groups = Groups.of(runs[0][40])
    one, two = groups.reduced(values), groups.reduced(other)
    assert all(one[n] == pytest.approx(two[n], rel=1e-12) for n in ("G_c", "tau_W", "eta_reg", "tip"))
    # A thicker blade in a specimen that is as much larger.
    larger = {n: 2 * values[n] for n in ("thickness", "tip", "delta_c", "surface_length", "height", "width")}
    larger |= {"G_c": 2 * values["G_c"], "eta_reg": 2 * values["eta_reg"]}
    three = groups.reduced({**values, **larger})
    assert all(one[n] == pytest.approx(three[n], rel=1e-12) for n in one)


def test_such_gels_are_computed_alike():
    small = {"width": "8 mm", "length": "8 mm", "height": "5 mm", "depth": "0.5 mm", "h": "0.8 mm"}
    small |= {"corner": 0.25, "shallow": 1}
    case = load_case("gelatin", small)
    scaled = {n: 2 * case.values[n] for n in ("G", "G_c", "tau_W")}
    scaled |= {"speed": 3 * case.values["speed"], "eta_reg": case.values["eta_reg"] / 3}
    scaled["length"] = 3 * case.values["length"]  # along the blade; how wide it is, is another matter
    wider = {**case.values, "width": 2 * case.values["width"]}
    F, more, of_wider = (
        run_case(replace(case, values=v)).curve["force_N"]
        for v in (case.values, {**case.values, **scaled}, wider)
    )
    np.testing.assert_allclose(more, 6 * F, rtol=1e-6)
    assert 1.02 < of_wider[-1] / F[-1] < 1.6


def test_cuts_of_a_longer_specimen_are_said_from_those_of_a_shorter_one_and_of_a_wider_one_not(runs):
    values = dict(runs[0][40].values)
    made = made_of(runs, 34)
    longer = made.forces([{**values, "length": 2 * values["length"]}])
    np.testing.assert_allclose(longer, 2 * made.forces([values]), rtol=1e-9)
    groups = Groups.of(runs[0][40])
    assert "width" in groups.powers and "length" not in groups.powers


def test_slopes_are_those_of_the_forces(runs):
    made, values = made_of(runs, 34), runs[0][40].values
    slopes = made.slopes(values, ["G", "eta_reg"])
    for k, name in enumerate(["G", "eta_reg"]):
        step = 1e-4 * values[name]
        ends = made.forces([{**values, name: values[name] + s * step} for s in (-1, 1)])
        difference = (ends[1] - ends[0]) / (2 * step)
        assert np.median(np.abs(slopes[:, k] - difference)) < 0.02 * np.abs(difference).max()


def test_a_law_that_is_off_is_one_more_coordinate(runs):
    """Runs without it are runs with its strength at off; those with it say what it does."""
    cases, forces, onsets = runs
    database = RunDatabase()
    for case, force, onset in zip(cases[:40], forces, onsets, strict=False):
        database.add(case, np.stack([emulator_runs.X, force]), onset)
    model, new = cases[0].model.extended("fung")
    extended = [replace(c, mechanisms=model.mechanisms, values={**c.values, **new}) for c in cases]
    assert database.emulator(extended[40:41], [*FREE, "b_fung"]) is None, "no run tells what it does"
    stiffer = [
        replace(c, values={**c.values, "b_fung": 0.02 * (i + 1)}) for i, c in enumerate(extended[40:52])
    ]
    for case, force, onset in zip(stiffer, forces[40:], onsets[40:], strict=False):
        raised = force * (1 + case.values["b_fung"])
        database.add(case, np.stack([emulator_runs.X, raised]), onset)
    made = database.emulator(extended[52:53], [*FREE, "b_fung"])
    assert made.count == 52
    off_, on = made.forces([{**extended[52].values, "b_fung": b} for b in (0.0, 0.15)])
    assert np.median(on[40:] / off_[40:]) == pytest.approx(1.15, abs=0.05)


def test_too_few_runs_and_other_models_make_no_emulator(runs):
    cases, forces, onsets = runs
    database = RunDatabase()
    for case, force, onset in zip(cases[:6], forces, onsets, strict=False):
        database.add(case, np.stack([emulator_runs.X, force]), onset)
    assert database.emulator(cases[40:41], FREE) is None
    assert made_of(runs, 20) is not None
    finer = cases[40].set(h="0.05 mm")
    full = RunDatabase()
    for case, force, onset in zip(cases, forces, onsets, strict=True):
        full.add(case, np.stack([emulator_runs.X, force]), onset)
    assert full.emulator([finer], FREE) is None


@pytest.mark.slow
def test_the_kept_runs_are_what_the_package_computes():
    rows, forces, onsets = emulator_runs.kept()
    force, onset = emulator_runs.computed(rows[1])
    assert onset == pytest.approx(onsets[1], rel=0.02)
    assert np.abs(force - forces[1]).max() < 0.02 * forces[1].max()


# -- where to compute ---------------------------------------------------------------------------------
