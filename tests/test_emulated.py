"""Cuts foreseen from those that were computed, with forces by a formula."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from formula_of_cuts import TRUE, X, campaign_in
from test_discover_cuts import point_at

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import silent
from cutbench.calibration import lm, survey
from cutbench.calibration.emulated import Emulated, Foreseeing
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.memory import Memory, Scale
from cutbench.calibration.prediction import Prediction, Reading, Task
from cutbench.calibration.side_by_side import side_by_side
from cutbench.discovery import search
from cutbench.discovery.apart import apart, resembling
from cutbench.discovery.candidates import candidates
from cutbench.discovery.equivalent import by_formula, equivalent, strength_of
from cutbench.discovery.foreseen import Foreseen
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import STEP

G_C, G = registry()["stiff_cohesion"].parameters[0], registry()["neo_hookean"].parameters[0]
OWN = {"slow": 0.004, "fast": 0.0064}


def force(x: np.ndarray, values: dict) -> np.ndarray:
    """Of a blade whose cut begins at a depth ∝ (G_c/G)^½, later the faster it goes."""
    G, G_c, eta = values["G"], values["G_c"], values["eta_reg"] * values["speed"]
    begins = 3.0 * np.sqrt((G_c / 0.005) / (G / 0.008)) * (1 + eta)
    part = 1 / (1 + np.exp(np.clip((begins - x) / 0.2, -50, 50)))
    return (1 - part) * 0.3 * G / 0.008 * x**1.5 + part * 0.5 * G_c / 0.005


class Remembering:
    """Runs by the formula, which stay in its memory; ``fails`` where the toughness is beyond."""

    def __init__(self, fails: float = np.inf):
        self.memory, self.places, self.fails = Memory(), 0, fails

    def side_by_side(self, searches):
        return side_by_side(searches, self)

    def __call__(self, tasks: list[Task]) -> list[Prediction]:
        self.places += 1
        return [self._one(task) for task in tasks]

    def _one(self, task: Task) -> Prediction:
        values = dict(task.case.values)
        if values["G_c"] > self.fails:
            raise ComputationFailed("too tough")
        x = np.linspace(0, values["depth"], 200)
        course = np.stack([x, force(x, values), x / values["speed"]])
        self.memory.add(task.case, course)
        slopes = {}
        for name in (n for n in task.names if n in ("G", "G_c")):
            moved = {**values, name: values[name] * 1.0001}
            slopes[name] = (force(x, moved) - course[1]) / (moved[name] - values[name])
        y, by = Reading(task, course).by(vars(task.case.p), slopes)
        return Prediction(y, by, task.names, course=course)


@pytest.fixture
def cuts(tmp_path):
    return campaign_in(tmp_path)


def inverse_of(campaign, run, offset: float = 0.0) -> Inverse:
    inverse = Inverse(campaign, unknowns(campaign), run)
    true = inverse.start.set(G="8 kPa", G_c="5 J/m^2")
    for e in campaign.train:
        case, grid = campaign.case(e, true), inverse.grids[e.id]
        mean = np.interp(grid.x - offset, X, force(X, dict(case.values)), left=0.0)
        inverse.grids[e.id] = replace(grid, mean=mean)
    return inverse


def farthest(inverse: Inverse, q: np.ndarray) -> float:
    found = zip(inverse.unknowns, inverse.values(q), strict=True)
    return max(abs(np.log(value / TRUE[u.label])) for u, value in found)


def test_a_softer_gel_cut_slowly_is_the_same_cut(cuts):
    """All stresses halved, the blade twice as fast and all times halved: nothing else is changed."""
    one = cuts.case(cuts.train[0], cuts.base)
    halved = {n: one.values[n] / 2 for n in ("G", "G_c", "tau_W", "eta_reg")}
    other = replace(one, values={**one.values, **halved, "speed": 2 * one.values["speed"]})
    scale = Scale.of(one)
    assert scale.reduced(one.values) == pytest.approx(scale.reduced(other.values), rel=1e-12)


def test_what_was_not_computed_is_foreseen(cuts):
    run = Remembering()
    inverse = inverse_of(cuts, run)
    assert not Emulated(inverse).able
    for a in np.linspace(-0.6, 0.6, 4):
        for b in np.linspace(-0.6, 0.6, 4):
            inverse.predictions(np.array([a, b]))
    places, q = run.places, np.array([0.11, -0.23])
    foreseen = Foreseeing(inverse).predictions(q)
    assert run.places == places
    real = Emulated(inverse).predictions(q)
    assert run.places == places + 1
    for e in cuts.train:
        largest = real[e.id].y.max()
        assert np.abs(foreseen[e.id].y - real[e.id].y).max() < 0.05 * largest
        # Derivatives are slopes over a step; of what is foreseen, too.
        for k, name in enumerate(real[e.id].names):
            ends = []
            for step in (-0.05, 0.05):
                there = q.copy()
                there[k] += step
                ends.append(inverse.predictions(there)[e.id].y)
            change = inverse.unknowns[k].value(q[k] + 0.05) - inverse.unknowns[k].value(q[k] - 0.05)
            slope = (ends[1] - ends[0]) / change
            column = real[e.id].slopes[:, real[e.id].names.index(name)]
            assert np.linalg.norm(column - slope) < 0.25 * np.linalg.norm(slope)


def led(inverse) -> np.ndarray:
    """Where a look around leads: first where works agree, from there where forces do."""
    near = survey.nearby(inverse, np.zeros(2)).q
    w, _ = inverse.measured(near)
    return survey.Survey(inverse, [near]).minimum(w, near, lm.Settings()).q


def test_a_look_around_leads_to_what_agrees(cuts):
    run = Remembering()
    inverse = inverse_of(cuts, run)
    q = led(inverse)
    assert farthest(inverse, q) < 0.01 < 0.3 < farthest(inverse, np.zeros(2))
    places = run.places
    inverse.predictions(q)  # is known
    assert run.places == places


def test_places_that_cannot_be_computed_are_left_out(cuts):
    inverse = inverse_of(cuts, Remembering(fails=0.0052))
    assert farthest(inverse, led(inverse)) < 0.01


def test_a_reading_that_begins_late_is_foreseen_without_a_run(tmp_path):
    campaign, run = campaign_in(tmp_path), Remembering()
    point = point_at(campaign, run, **TRUE)
    inverse = inverse_of(campaign, run, offset=0.5)
    point.inverse.grids.update(inverse.grids)
    point.inverse.predictions(np.zeros(2))
    survey.Survey(point.inverse, [np.zeros(2)]).look()
    chosen, _ = candidates(point.inverse, point.case)
    places, foreseen = run.places, Foreseen(point)
    left = foreseen.rigs(chosen)
    assert run.places == places and foreseen.able
    assert min(left, key=lambda name: left[name]) == "contact_offset"
    assert left["contact_offset"] < 0.2 < 0.5 < left["force_drift"]


def test_values_of_each_cuts_own_are_found_from_what_is_known(tmp_path):
    """With few runs beside those of a fit; the law that does that to a toughness is the one that is asked."""
    campaign, run = campaign_in(tmp_path), Remembering()
    point = point_at(campaign, run, **TRUE)
    inverse = point.inverse
    true = inverse.start.set(G="8 kPa")
    for e in campaign.train:
        case = campaign.case(e, true.set(G_c=f"{OWN[e.id]} kN/m"))
        mean = np.interp(inverse.grids[e.id].x, X, force(X, dict(case.values)))
        inverse.grids[e.id] = replace(inverse.grids[e.id], mean=mean)
    survey.Survey(inverse, [np.zeros(2)]).look()
    found = survey.Survey(inverse, [np.zeros(2)])
    q = found.minimum(point.w, np.zeros(2), lm.Settings()).q
    start = replace(
        point_at(campaign, run, **dict(zip(("G", "G_c"), inverse.values(q), strict=True))),
        inverse=inverse,
        q=q,
    )
    places = run.places
    place = apart(start, silent)[0]
    assert place.owned == "G_c"
    assert run.places - places <= 16
    for id, G_c in OWN.items():
        assert place.values[id]["G_c"] == pytest.approx(G_c, rel=0.1)
    chosen, _ = candidates(start.inverse, start.case)
    every, _ = candidates(start.inverse, start.case, one_a_class=False)
    asked, left_out = resembling(place, chosen, every)
    assert {c.name for c in asked} == {"rate_toughness", "speed_toughness"}
    assert {*left_out} == {c.name for c in chosen} - {"rate_toughness"}
    assert all("G_c" in reason for reason in left_out.values())


def test_real_matrices_of_readings_keep_complex_steps(cuts):
    e, case = cuts.train[0], cuts.case(cuts.train[0], cuts.base)
    task = Task(e, case, e.on_grid(20), ("G",))
    x = np.linspace(0, 5, 60)
    course = np.stack([x, x**2, x / case.values["speed"]])
    read = Reading(task, course).of(case.p, 2 * x**2)
    np.testing.assert_allclose(read.imag / STEP, 2 * read.real, rtol=1e-12)


def test_what_a_fit_has_computed_is_known_to_what_is_asked_then(monkeypatch, cuts):
    run, asked = Remembering(), []

    def round_of(point, *others):
        asked.append(point)
        raise KeyboardInterrupt

    monkeypatch.setattr(search, "predictor", lambda *given: nullcontext(run))
    monkeypatch.setattr(search, "round_of", round_of)
    with pytest.raises(KeyboardInterrupt):
        search.discover(cuts, refine=False)
    assert asked[0].inverse.run is run
    assert Foreseen(asked[0]).able


def test_a_laws_strength_is_the_one_that_does_what_the_cuts_own_values_do():
    """τ + s r and, step by step, G_c (1 + k r), with r of its own for each test."""
    r = np.array([0.2, 0.5, 1.4])
    assert strength_of(2.0 + 1.5 * r, 3.0 + 7.0 * r, 3.0, 7.0) == pytest.approx((2.0, 1.5))
    found = 3.0, 7.0
    for _ in range(3):
        found = strength_of(2.0 * (1 + 1.5 * r), found[0] * (1 + found[1] * r), *found)
    assert found == pytest.approx((2.0, 1.5))
    # What no shared value and strength give has the nearest.
    shared, strength = strength_of(np.array([1.0, 4.0, 20.0]), 3.0 + 7.0 * r, 3.0, 7.0)
    assert shared > 0 and strength > 0


@pytest.mark.parametrize(
    ("law", "of", "values"),
    [
        ("speed_toughness", G_C, {"speed_toughening": 0.3, "toughness_speed": 0.01}),
        ("speed_modulus", G, {"speed_stiffening": 0.3, "stiffening_speed": 0.01}),
    ],
)
def test_a_law_that_says_what_it_is_like_needs_no_runs(cuts, law, of, values):
    """Of the shared value, the strength and a speed, and of what the cuts would be."""
    law, speeds = registry()[law], (0.005, 0.02, 0.08)
    run = Remembering()
    inverse = inverse_of(cuts, run)
    survey.Survey(inverse, [np.zeros(2)]).look()
    model, off = inverse.start.model.extended(law.name)
    on = {of.name: 0.8 * TRUE[of.name], **values}
    values = {**inverse.start.values, **off, **on}
    start = replace(inverse.start, mechanisms=model.mechanisms, values=values)
    other = inverse.other(inverse.unknowns, start)
    known = run.memory.emulator(other.case(cuts.train[0], np.zeros(2)), ["G", "G_c", *on], X[-1])
    for speed in speeds:
        with_law = {**values, "speed": speed}
        without = {**with_law, **law.like(SimpleNamespace(**with_law)), law.parameters[0].name: 0.0}
        one, same = known.forces([with_law, without])
        np.testing.assert_allclose(one, same, rtol=0.02, atol=0.02 * same.max())
    mine = [Unknown(q, on[q.name], *q.bounds) for q in (of, *law.parameters)]
    each = [SimpleNamespace(**{**values, "speed": v}) for v in speeds]
    wanted = np.array([law.like(p)[of.name] for p in each])
    found = by_formula(law, wanted, each, mine, np.array([0.4, 0.5, 0.5]))
    got = {u.name: u.value(x) for u, x in zip(mine, found, strict=True)}
    like = [law.like(SimpleNamespace(**{**vars(p), **got}))[of.name] for p in each]
    np.testing.assert_allclose(like, wanted, rtol=0.02)


def test_a_law_is_held_against_cuts_without_it(cuts):
    run = Remembering()
    inverse = inverse_of(cuts, run)
    split = [replace(u, experiment=e.id) for e in cuts.train for u in inverse.unknowns if u.name == "G_c"]
    inverse = inverse.other([u for u in inverse.unknowns if u.name == "G"] + split, inverse.start)
    survey.Survey(inverse, [np.zeros(3)]).look()
    own = {u.experiment: k for k, u in enumerate(inverse.unknowns) if u.experiment}
    wanted = np.array([0.2, -0.3])
    # What a law does that changes the toughness of both.
    law = inverse.predictions(np.array([0.0, *wanted]))
    found = equivalent(Foreseeing(inverse), np.zeros(3), own, law)
    expected = [inverse.unknowns[k].value(x) for k, x in zip(own.values(), wanted, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize("law", ["fung", "speed_toughness", "contact_offset", "compressible", "blunt_tip"])
def test_cuts_without_a_law_tell_of_cuts_with_it(cuts, law):
    """Also of one that takes another's place: at "off" it is that one."""
    run = Remembering()
    inverse, other = inverse_of(cuts, run), inverse_of(cuts, run)
    for a in np.linspace(-0.6, 0.6, 4):
        for b in np.linspace(-0.6, 0.6, 3):
            inverse.predictions(np.array([a, b]))
    model, off = other.start.model.extended(law)
    values = {**other.start.values, **off}
    other = inverse.other(inverse.unknowns, replace(other.start, mechanisms=model.mechanisms, values=values))
    assert Emulated(other).able
    for e in cuts.train:
        known = run.memory.emulator(other.case(e, np.zeros(2)), ["G", "G_c"], X[-1])
        assert known is not None and len(known.known._before.Z) == 12 * len(cuts.train)


def test_a_law_in_the_place_of_another_tells_nothing_of_that(cuts):
    run = Remembering()
    plain = inverse_of(cuts, run)
    model, off = plain.start.model.extended("fung")
    case = replace(plain.start, mechanisms=model.mechanisms, values={**plain.start.values, **off})
    other = plain.other(plain.unknowns, case)
    for a in np.linspace(-0.6, 0.6, 12):
        other.predictions(np.array([a, a / 2]))
    assert not Emulated(plain).able


def test_a_search_goes_where_more_is_promised_and_on_below_what_is_known(cuts, monkeypatch):
    """Of worse places two are enough, and four where the model without had more than noise; what promises far
    less than the best is not computed, but where the last one was foreseen as badly."""
    run = Remembering()
    inverse, noise = inverse_of(cuts, run), point_at(cuts, run, G=8e-3, G_c=5e-3).w.noise
    monkeypatch.setattr(survey, "likely", lambda problem, noise, q: -float(q @ q))
    lows = [0.0] * 50, [0.0] * 50, [0.0] * 50, [-500.0], [1000.0, *[-500.0] * 50]
    for promised, least, computed in zip(
        lows, (-np.inf, np.inf, 3.0, -np.inf, -np.inf), (2, 4, 2, 0, 2), strict=True
    ):
        made, places = survey.Survey(inverse, [np.zeros(2)]), iter(np.linspace(0.1, 0.9, 50))
        found = partial(next, zip(([x, x] for x in places), promised, strict=False))
        monkeypatch.setattr(made, "_likelier", lambda *_, found=found: tuple(map(np.array, found())))
        made.likeliest(noise, np.zeros(2), least=least)
        assert made.evaluations == computed
