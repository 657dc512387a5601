"""Whole searches for what cuts lack, with forces by a formula."""

from __future__ import annotations

import json

import pytest
from runs_by_formula import Counted, run_case

from benchmarks.blind import Answer, judge
from benchmarks.blind_campaigns import Planned, make
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.settings import SETTINGS
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover
from cutbench.discovery.report import to_dict, write_discovery
from cutbench.run.pool.pool import TaskPool

#: Runs that a search may take: those of its budget, of the last models, and of tests that are predicted.
MOST = SETTINGS.search_runs + 30


def campaign_of(effect, folder, specimens=3):
    how = "cohesion as printed", "ellipse"
    planned = Planned(0, "cut", () if effect == "none" else (effect,), how)
    return make(planned, 2, folder, run=run_case, specimens=specimens)


def found_in(file, compute, folder=None, **how):
    return discover(load_campaign(file), runs=CutRuns(TaskPool(0), folder, compute=compute), **how)


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect", ["none", "toughness by speed", "adhesion by speed", "relaxing modulus", "late zero"]
)
def test_a_search_ends_where_the_data_lead(effect, tmp_path):
    runs, truth = Counted(), campaign_of(effect, tmp_path)
    found = found_in(truth.file, runs)
    said = judge(truth, Answer.of(found))
    assert said["right"] and not said["wrong"], (found.verdict, found.names)
    assert max(to_dict(found)["misfit"]["extended"].values()) < 0.02
    assert runs.count < MOST


@pytest.mark.slow
def test_a_search_goes_on_from_its_store(tmp_path):
    """It knows more when it begins again, so that its way may differ."""
    truth, first, second = campaign_of("none", tmp_path / "made"), Counted(), Counted()
    found, again = (found_in(truth.file, each, tmp_path / "runs") for each in (first, second))
    # Derivatives are asked again, which a formula leaves in no store.
    assert second.count < first.count / 2
    assert (again.verdict, again.names) == (found.verdict, found.names)
    assert again.first.values()["G"] == pytest.approx(found.first.values()["G"], rel=0.05)


def test_a_search_that_is_stopped_among_its_first_cuts_looked_for_no_cause(tmp_path):
    formula, truth = Counted(), campaign_of("none", tmp_path, specimens=1)

    def stops(*asked):
        if formula.count >= 8:
            raise KeyboardInterrupt
        return formula(*asked)

    found = found_in(truth.file, stops)
    assert formula.count == 8 and found.stopped == "interrupted"
    assert found.verdict == "undecided" and not found.steps
    write_discovery(found, tmp_path)
    assert json.loads((tmp_path / "discovery.json").read_text())["status"] == "interrupted"
    assert (tmp_path / "discovery.html").exists() and not (tmp_path / "case.toml").exists()
