"""What happens once in one cut is told, and no cause of it is looked for."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from formula_of_cuts import SPEEDS, TRUE, Formula, X, campaign_in, force
from test_discover_cuts import point_at

from cutbench.base.progress import silent
from cutbench.data.campaign import load_campaign
from cutbench.discovery import search
from cutbench.discovery.apart import _Own
from cutbench.discovery.event import _chi2, events
from cutbench.discovery.report import verdict_sentence
from cutbench.discovery.rounds import round_of


def off_between(tmp_path, first: float, last: float, part: float, ids=("fast",), tougher: float = 1.0):
    """The true campaign, but ``ids`` are ``tougher`` by that factor, and their force is changed by ``part``
    from ``first`` to ``last``."""
    campaign_in(tmp_path)
    true = {**TRUE, "G_c": tougher * TRUE["G_c"]}
    for id in ids:
        y = force(X, **true, speed=SPEEDS[id]) * (1 + part * ((first <= X) & (last >= X)))
        rows = [f"{x:.6g},{f:.6g}" for x, f in zip(X, y, strict=True)]
        (tmp_path / f"{id}.csv").write_text("\n".join(["u [mm],F [N]", *rows]) + "\n")
    return load_campaign(tmp_path / "campaign.toml")


@pytest.mark.parametrize("part", [-0.2, 0.2])
def test_what_happens_once_is_told_and_asked_nothing(part, tmp_path):
    run = Formula(error=AssertionError)
    point = point_at(off_between(tmp_path, 4.2, 4.6, part), run, **TRUE)
    without, said = events(point)
    assert len(said) == 1 and "'fast'" in said[0] and "repeat" in said[0]
    run.fails = run.places
    this = round_of(without, run, 0, silent)
    assert this.scores.p_residual > 0.1 and not this.tried


def test_its_readings_count_for_little(tmp_path):
    run = Formula()
    point = point_at(off_between(tmp_path, 4.2, 4.6, -0.2), run, **TRUE)
    without, every = events(point)[0], np.ones(point.residual["fast"].size, dtype=bool)
    assert _chi2(point, "fast", every) > 2 * _chi2(without, "fast", every)
    here, there = (_Own(p, p.inverse, np.eye(p.q.size), p.q) for p in (point, without))
    assert here._wrong(point.residual) > 2 * there._wrong(point.residual)


@pytest.mark.parametrize("tougher", [0.9, 0.95, 1.05])
def test_another_toughness_of_a_cut_does_not_hide_what_happens_once(tougher, tmp_path):
    point = point_at(off_between(tmp_path, 4.2, 4.6, -0.2, tougher=tougher), Formula(), **TRUE)
    assert len(events(point)[1]) == 1


@pytest.mark.parametrize(
    ("first", "last", "ids"),
    [
        (3.2, 5.0, ("fast",)),  # all that is behind the transition
        (1.0, 1.4, ("fast",)),  # before it, where nothing saws
        (4.2, 4.6, ("slow", "fast")),  # in each of the cuts
        (9.0, 9.0, ("fast",)),  # nothing at all
    ],
)
def test_what_is_longer_or_happens_again_is_not_one(first, last, ids, tmp_path):
    point = point_at(off_between(tmp_path, first, last, -0.2, ids), Formula(), **TRUE)
    assert events(point) == (point, ())


@pytest.mark.parametrize(("part", "wave", "thick"), [(0.1, 0.7, 0.3), (0.2, 2.0, 0.7)])
def test_what_swings_all_along_one_cut_is_none(part, wave, thick, tmp_path):
    campaign_in(tmp_path)
    file = tmp_path / "campaign.toml"
    file.write_text(file.read_text().replace('thickness = "0.7 mm"', f'thickness = "{thick} mm"'))
    y = force(X, **TRUE, speed=SPEEDS["fast"]) * (1 + part * np.sin(2 * np.pi * X / wave) * (X > 3.3))
    rows = [f"{x:.6g},{f:.6g}" for x, f in zip(X, y, strict=True)]
    (tmp_path / "fast.csv").write_text("\n".join(["u [mm],F [N]", *rows]) + "\n")
    point = point_at(load_campaign(file), Formula(), **TRUE)
    assert events(point) == (point, ())


def test_what_the_mean_of_two_specimens_shows_is_none(tmp_path):
    point = point_at(off_between(tmp_path, 4.2, 4.6, -0.2), Formula(), **TRUE)
    twice = {
        id: replace(grid, curves=np.vstack([grid.curves, grid.curves]))
        for id, grid in point.inverse.grids.items()
    }
    both = replace(point, inverse=point.inverse.weighing(twice))
    assert events(point)[1] and events(both) == (both, ())


@pytest.mark.parametrize("tougher", [0.7, 0.9, 1.1, 1.3])
def test_other_toughness_in_one_cut_is_none(tougher, tmp_path):
    point = point_at(campaign_in(tmp_path, {"fast": tougher * TRUE["G_c"]}), Formula(), **TRUE)
    assert events(point) == (point, ())


def test_a_search_ends_with_it(tmp_path, monkeypatch):
    campaign = off_between(tmp_path, 4.2, 4.6, -0.2)
    monkeypatch.setattr(search, "predictor", lambda *_: nullcontext(Formula()))
    found = search.discover(campaign, workers=0, refine=False)
    assert found.verdict == "none" and len(found.once) == 1 and found.once[0] in found.notes
    assert "once" in verdict_sentence(found) and found.next_experiment.startswith("Repeat")
