"""Whole searches for what cuts lack, with forces by a formula."""

from __future__ import annotations

import pytest
from runs_by_formula import Counted, run_case

from benchmarks.blind import Answer, judge
from benchmarks.blind_campaigns import Planned, make
from cutbench.calibration.prediction import Predictor
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover
from cutbench.run.pool.pool import TaskPool

#: Runs that a search may take: at four seconds each, seven and a half minutes of two cores.
MOST = 220


def campaign_of(effect, folder, specimens=3):
    how = "cohesion as printed", "ellipse"
    planned = Planned(0, "cut", () if effect == "none" else (effect,), how)
    return make(planned, 2, folder, run=run_case, specimens=specimens)


def found_in(file, runs):
    return discover(load_campaign(file), run=Predictor(TaskPool(0), runs=runs))


@pytest.mark.parametrize(
    "effect",
    [
        *(pytest.param(e, marks=pytest.mark.slow) for e in ("toughness by speed", "adhesion by speed")),
        pytest.param("relaxing modulus", marks=pytest.mark.slow),
        pytest.param("late zero", marks=[pytest.mark.slow, pytest.mark.xfail(reason="it takes 382 runs")]),
        "none",
    ],
)
def test_a_search_ends_where_the_data_lead(effect, tmp_path):
    runs, truth = Counted(), campaign_of(effect, tmp_path)
    found = found_in(truth.file, runs)
    said = judge(truth, Answer.of(found))
    assert said["right"] and not said["wrong"], (found.verdict, found.found)
    assert max(found.final.misfit.values()) < 0.02
    assert runs.count < MOST


@pytest.mark.slow
@pytest.mark.xfail(reason="on this campaign the search takes the stretch for no event")
def test_a_cause_is_found_beside_what_happened_once(tmp_path):
    truth = campaign_of("toughness by speed", tmp_path, specimens=1)
    file = tmp_path / "fast.csv"
    head, *rows = file.read_text().splitlines()
    each = [[float(value) for value in row.split(",")] for row in rows]
    made = [f"0,{x:.6g},{(0.8 if 4.2 <= x <= 4.6 else 1.0) * F:.6g}" for _, x, F in each]
    file.write_text("\n".join([head, *made]) + "\n")
    found = found_in(truth.file, Counted())
    said = judge(truth, Answer.of(found))
    assert len(found.once) == 1 and "'fast'" in found.once[0]
    assert said["right"] and not said["wrong"], (found.verdict, found.found)
