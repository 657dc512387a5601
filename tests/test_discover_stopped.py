"""Discovery that is ended before all was asked: by Ctrl-C, or by a time limit."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import blind_cases
import pytest
from refusals import refusal
from typer.testing import CliRunner

from cutbench.calibration.fitting import LATE
from cutbench.cli.main import app
from cutbench.data.campaign import Campaign
from cutbench.discovery import discover
from cutbench.discovery.report import verdict_sentence, write_discovery

STUDIES = Path(__file__).parents[1] / "studies"


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """In which gent is hidden; of three formulas that are asked."""
    return replace(blind_cases.campaign("gent", "bulk", False), candidates=("gent", "yeoh", "maxwell"))


@pytest.fixture(scope="module")
def whole(campaign):
    """All of the search, and how often it says what it does."""
    told = []
    return discover(campaign, workers=0, on_progress=lambda *at: told.append(at)), len(told)


def ended(campaign, after: int):
    """The search with Ctrl-C at what it says then."""
    left = [after]

    def stop(*at):
        left[0] -= 1
        if left[0] <= 0:
            raise KeyboardInterrupt

    return discover(campaign, workers=0, on_progress=stop)


def tried(d) -> set[str]:
    return {c.name for step in d.steps for c in step.compared}


def test_ctrl_c_keeps_what_was_found_until_then(campaign, whole, tmp_path):
    """Before the baseline is fitted that is nothing, then no cause, then what was tried."""
    d, count = whole
    assert d.stopped == "" and d.verdict == "mechanism"
    every = [ended(campaign, k) for k in (*range(2, count, 3), count)]
    assert all(s.stopped and s.verdict in ("undecided", "mechanism") for s in every)
    assert all(bool(s.found) == (s.verdict == "mechanism") for s in every)
    assert all(set(s.names) <= tried(s) <= tried(d) for s in every)
    # What one was stopped later knows no less.
    known = [(len(s.names), len(tried(s))) for s in every]
    assert known == sorted(known)
    assert every[-1].names == d.names
    for s in every:
        assert s.first is None or s.first.values() == pytest.approx(d.first.values(), rel=1e-3)
    write_discovery(every[-1], tmp_path)
    assert json.loads((tmp_path / "discovery.json").read_text())["status"] == every[-1].stopped


def test_a_cause_that_was_found_is_kept_while_another_is_looked_for(campaign, whole):
    told = []

    def stop(done, total, text):
        told.append(text)
        if "gent" in text and "beside" in text:
            raise KeyboardInterrupt

    s = discover(campaign, workers=0, on_progress=stop)
    assert "beside" in told[-1] and s.stopped
    assert s.verdict == "mechanism" and s.names == whole[0].names[:1]
    assert s.final.values() != s.first.values()


@pytest.mark.slow
def test_what_does_not_end_in_time_tells_what_was_found(campaign, whole, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def slow(done, total, text):
        now[0] += 10.0

    d = discover(campaign, workers=0, limit_s=30.0, on_progress=slow)
    assert d.stopped == LATE and tried(d) < tried(whole[0])
    kept = discover(campaign, workers=0, limit_s=1e6, on_progress=slow)
    assert kept.held_out == whole[0].held_out and kept.stopped == ""


def test_a_baseline_that_does_not_end_in_time_is_undecided(campaign, tmp_path):
    d = discover(campaign, workers=0, limit_s=0.0)
    assert d.stopped == LATE and d.verdict == "undecided" and not d.found and not d.steps
    write_discovery(d, tmp_path)
    assert json.loads((tmp_path / "discovery.json").read_text())["status"] == LATE
    page = (tmp_path / "discovery.html").read_text(encoding="utf-8")
    assert LATE in page and "<html" in page
    assert not (tmp_path / "case.toml").exists()


@pytest.mark.parametrize("limit", ["soon", "-1 s", "3 mm"])
def test_a_limit_that_is_no_time_is_refused(limit, tmp_path):
    study = str(STUDIES / "silicone" / "rtv615.toml")
    refusal(CliRunner().invoke(app, ["discover", study, "--out", str(tmp_path), "--limit", limit]), "limit")


def test_what_was_fitted_in_a_round_that_was_stopped_is_kept(campaign):
    """Also where what is fitted anew takes too long."""
    told = []

    def stop(done, total, text):
        told.append(text)
        if sum("fitting the model with" in each for each in told) == 2:
            raise KeyboardInterrupt

    s = discover(campaign, workers=0, on_progress=stop)
    assert s.verdict == "undecided" and s.stopped and len(tried(s)) == 1
    said = verdict_sentence(s)
    assert s.stopped in said and all(name in said for name in tried(s))
    assert told[-1] in s.next_experiment
