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

from cutbench.base.errors import ComputationFailed
from cutbench.cli.main import app
from cutbench.data.campaign import Campaign
from cutbench.discovery import discover
from cutbench.discovery.page import write_discovery

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
    """The search with Ctrl-C at what it says then; None where that leaves nothing."""
    left = [after]

    def stop(*at):
        left[0] -= 1
        if left[0] <= 0:
            raise KeyboardInterrupt

    try:
        return discover(campaign, workers=0, on_progress=stop)
    except KeyboardInterrupt:
        return None


def tried(d) -> set[str]:
    return {t.name for each in d.rounds for t in each.tried}


def test_ctrl_c_keeps_what_was_found_until_then(campaign, whole, tmp_path):
    """Before the baseline is fitted that is nothing, then no cause, then what was tried."""
    d, count = whole
    assert d.stopped == "" and d.verdict == "mechanism"
    every = [ended(campaign, k) for k in (*range(2, count, 3), count)]
    stopped = [s for s in every if s is not None]
    assert every[0] is None and every[-len(stopped) :] == stopped
    baselines = [s for s in stopped if not tried(s)]
    assert all(s.verdict == "undecided" and not s.found for s in baselines)
    found = [s for s in stopped if tried(s)]
    assert found and all(s.verdict == "mechanism" and set(s.found) <= tried(s) <= tried(d) for s in found)
    assert found[-1].found == d.found
    for s in stopped:
        assert (s.stopped or not s.proposed) and s.first.values == d.first.values
    write_discovery(found[0], tmp_path)
    assert (
        found[0].stopped
        and json.loads((tmp_path / "discovery.json").read_text())["status"] == found[0].stopped
    )


@pytest.mark.slow
def test_what_does_not_end_in_time_tells_what_was_found(campaign, whole, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def slow(done, total, text):
        now[0] += 10.0

    d = discover(campaign, workers=0, limit_s=80.0, on_progress=slow)
    assert d.stopped and tried(d) < tried(whole[0])
    kept = discover(campaign, workers=0, limit_s=1e6, on_progress=slow)
    assert kept.gain == whole[0].gain and kept.stopped == ""


def test_a_baseline_that_does_not_end_in_time_is_a_failure(campaign):
    with pytest.raises(ComputationFailed):
        discover(campaign, workers=0, limit_s=0.0)


@pytest.mark.parametrize("limit", ["soon", "-1 s", "3 mm"])
def test_a_limit_that_is_no_time_is_refused(limit, tmp_path):
    study = str(STUDIES / "silicone" / "rtv615.toml")
    refusal(CliRunner().invoke(app, ["discover", study, "--out", str(tmp_path), "--limit", limit]), "limit")
