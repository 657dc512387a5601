"""Whole searches for what cuts lack, with forces by a formula."""

from __future__ import annotations

import pytest
import runs_by_formula

from benchmarks import outside_cuts
from cutbench.calibration import prediction
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover

pytestmark = pytest.mark.slow

#: Runs that a search may take: at four seconds each, seven and a half minutes of two cores.
MOST = 220


@pytest.mark.parametrize(
    "effect", ["toughness by speed", "adhesion by speed", "relaxing modulus", "late zero", "none"]
)
def test_a_search_ends_where_the_data_lead(effect, tmp_path, monkeypatch):
    runs = runs_by_formula.Counted()
    monkeypatch.setattr(prediction, "ran", runs)
    monkeypatch.setattr(outside_cuts, "run_case", runs_by_formula.run_case)
    truth = outside_cuts.make(0, effect, 2, 2, tmp_path)
    found = discover(load_campaign(truth.file), workers=0)
    said = outside_cuts.judge(truth, found)
    assert said["right"] and not said["wrong"], (found.verdict, found.found)
    assert said["left"] < 0.02
    assert runs.count < MOST


def test_a_cause_is_found_beside_what_happened_once(tmp_path, monkeypatch):
    monkeypatch.setattr(prediction, "ran", runs_by_formula.Counted())
    monkeypatch.setattr(outside_cuts, "run_case", runs_by_formula.run_case)
    monkeypatch.setattr(outside_cuts, "REPETITIONS", 1)
    truth = outside_cuts.make(0, "toughness by speed", 2, 2, tmp_path)
    file = tmp_path / "fast.csv"
    head, *rows = file.read_text().splitlines()
    each = [[float(value) for value in row.split(",")] for row in rows]
    made = [f"0,{x:.6g},{(0.8 if 4.2 <= x <= 4.6 else 1.0) * F:.6g}" for _, x, F in each]
    file.write_text("\n".join([head, *made]) + "\n")
    found = discover(load_campaign(truth.file), workers=0)
    said = outside_cuts.judge(truth, found)
    assert len(found.once) == 1 and "'fast'" in found.once[0]
    assert said["right"] and not said["wrong"], (found.verdict, found.found)
