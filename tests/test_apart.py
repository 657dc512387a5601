"""What each cut says on its own, with forces by a formula."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from formula_of_cuts import TRUE, Formula, campaign_in
from test_discover_cuts import point_at

from cutbench.base.progress import silent
from cutbench.calibration import by_work
from cutbench.discovery import rounds
from cutbench.discovery.apart import alike, apart, by_rate, told
from cutbench.discovery.candidates import candidates
from cutbench.discovery.columns import Column
from cutbench.discovery.extending import Place
from cutbench.discovery.score import Score

OWN = {"slow": 0.004, "fast": 0.0064}


@pytest.fixture
def point(tmp_path):
    """The best that one toughness can do for cuts that have two."""
    campaign, run = campaign_in(tmp_path, OWN), Formula()
    start = point_at(campaign, run, **TRUE)
    near = by_work.nearby(start.inverse, start.q)
    values = dict(zip([u.name for u in start.inverse.unknowns], start.inverse.values(near.q), strict=True))
    return point_at(campaign, run, **values)


def test_a_toughness_of_its_own_in_each_cut_is_found(point):
    (place,) = apart(point, silent)
    values = place.values
    for id, G_c in OWN.items():
        assert values[id]["G_c"] == pytest.approx(G_c, rel=0.06)
        assert values[id]["G"] == pytest.approx(TRUE["G"], rel=0.06)
    # Candidates begin with one toughness for all, in between.
    shared = {u.name: u.start for u in place.shared}
    assert OWN["slow"] < shared["G_c"] < OWN["fast"]
    assert place.case.values["G_c"] == pytest.approx(shared["G_c"])
    assert place.owned == "G_c"
    slow, fast = (float(part.split()[1]) for part in told(place).partition(": ")[2].split(", "))
    assert slow == pytest.approx(4, rel=0.06) and fast == pytest.approx(6.4, rel=0.06)


def test_what_one_value_would_leave_is_what_derivatives_say(point):
    (place,) = apart(point, silent)
    q = np.array([place.inverse.unknowns[i].q(u.start) for i, u in _rows(place)])
    found = place.inverse.predictions(place.q)
    for e in point.campaign.train:
        y = found[e.id].y + point.w.tests[e.id].shift
        moved = y + place.inverse.slopes(e, found[e.id], place.q) @ (q - place.q)
        np.testing.assert_allclose(place.residual[e.id], moved - point.inverse.grids[e.id].mean, atol=1e-12)


def _rows(place: Place):
    return [(i, place.shared[int(np.argmax(row))]) for i, row in enumerate(place.S)]


def test_where_one_value_does_as_well_none_has_its_own(tmp_path):
    run = Formula()
    point = point_at(campaign_in(tmp_path), run, **TRUE)
    asked = run.places
    assert apart(point, silent) == []
    assert run.places == asked


def test_cuts_that_differ_by_speed_ask_what_knows_of_time(point):
    chosen, _ = candidates(point.inverse, point.case)
    some, idle = by_rate(point, chosen)
    assert {"maxwell", "rate_toughness", "adhesion_speed", "force_drift"} == {c.name for c in some}
    assert {c.name for c in chosen} == {c.name for c in some} | set(idle)


@pytest.mark.parametrize(("name", "same"), [("depth", True), ("tip", False)])
def test_so_do_those_of_which_one_ends_deeper_but_not_of_which_one_has_another_blade(point, name, same):
    def case(e, q):
        values = point.inverse.case(e, q).values
        return SimpleNamespace(values={**values, name: values[name] * (1.1 if e.id == "slow" else 1.0)})

    chosen, _ = candidates(point.inverse, point.case)
    other = SimpleNamespace(q=point.q, campaign=point.campaign, inverse=SimpleNamespace(case=case))
    assert (by_rate(other, chosen) == by_rate(point, chosen)) is same
    assert same or by_rate(other, chosen) == (chosen, {})


def a_score(point, place, amounts: dict[str, float], beside: float = 0.0) -> Score:
    """Of a candidate that raises the toughness of each cut by so much, as a logarithm, a unit of strength,
    and ``beside`` all forces by that."""
    chosen, _ = candidates(point.inverse, point.case)
    candidate = next(c for c in chosen if c.name == "rate_toughness")
    own = {u.experiment: k for k, u in enumerate(place.inverse.unknowns) if u.experiment}
    found, by = place.inverse.predictions(place.q), {}
    for e in point.campaign.train:
        slopes = place.inverse.slopes(e, found[e.id], place.q)
        by[e.id] = amounts[e.id] * slopes[:, [own[e.id]]] + beside
    column = Column(candidate, candidate.grid[0], by)
    return Score(column, 0.0, np.zeros(1), np.zeros(len(place.shared)), np.zeros(1))


def test_what_changes_the_cuts_as_their_own_values_do_is_alike(point):
    (place,) = apart(point, silent)
    part, score = alike(point, place, a_score(point, place, {"slow": 0.1, "fast": 0.5}))
    assert part == pytest.approx(1.0, abs=1e-6)
    # As much as makes one toughness those of both.
    wanted = np.log(place.values["fast"]["G_c"] / place.values["slow"]["G_c"]) / 0.4
    assert score.strengths[0] == pytest.approx(wanted, rel=1e-3)
    shared = {u.name: k for k, u in enumerate(place.shared)}
    G_c = place.shared[shared["G_c"]].value(score.free[shared["G_c"]])
    assert G_c * np.exp(0.1 * score.strengths[0]) == pytest.approx(place.values["slow"]["G_c"], rel=1e-3)


def test_what_does_the_opposite_or_something_else_is_not(point):
    (place,) = apart(point, silent)
    # A strength that cannot be negative.
    assert alike(point, place, a_score(point, place, {"slow": 0.5, "fast": 0.1}))[0] == 0
    other = a_score(point, place, {"slow": 0.1, "fast": 0.5}, beside=1.0)
    assert alike(point, place, other)[0] < 0.5


@pytest.mark.parametrize("whole, asked", [(True, ["G_c"]), (False, ["G_c", "tau_W"])])
def test_nothing_more_is_asked_of_cuts_once_a_cause_explains_all(monkeypatch, point, whole, asked):
    places, found = [], SimpleNamespace(
        accepted="a", tried=[SimpleNamespace(name="a", whole=whole)], scores=SimpleNamespace(scores=[])
    )  # fmt: skip

    def at(self, place, *others):
        places.append(place)
        return found

    monkeypatch.setattr(rounds._Asking, "at", at)
    monkeypatch.setattr(rounds, "resembling", lambda *_: ([], {}))
    monkeypatch.setattr(rounds, "together", lambda made: made[0])
    asking = rounds._Asking(point, Formula(), 0, silent)
    assert asking.beside(["G_c", "tau_W"], [], [], {}, found.scores) is found
    assert places == asked


def test_what_is_foreseen_to_explain_nothing_or_was_fitted_is_not_fitted(monkeypatch, point):
    """Where no law is foreseen to explain anything."""
    chosen, _ = candidates(point.inverse, point.case)
    asked = []
    monkeypatch.setattr(rounds, "looked", lambda *_: ([], ["fung"]))
    monkeypatch.setattr(rounds._Asking, "at", lambda self, place, some, why: asked.extend(some) or why)
    asking = rounds._Asking(point, Formula(), 0, silent)
    asking.left = {"contact_offset": 0.99, "force_drift": 0.7}
    asking.made = [SimpleNamespace(tried=[SimpleNamespace(name="machine_compliance")])]
    why = asking.anywhere(chosen, {"fung": ""}, {})
    gone, names = {"fung", "contact_offset", "machine_compliance"}, {c.name for c in chosen}
    assert {*gone, "force_drift"} <= names
    assert {c.name for c in asked} == names - gone
    assert set(why) == {"fung", "contact_offset"}
