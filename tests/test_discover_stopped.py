"""Discovery that is ended before all was asked: by Ctrl-C, or by a time limit."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.hidden import make
from cutbench.base.errors import ComputationFailed
from cutbench.cli.main import app
from cutbench.data.campaign import Campaign
from cutbench.discovery import Discovery, discover, rounds, search
from cutbench.discovery.page import write_discovery
from cutbench.discovery.report import summary

STUDIES = Path(__file__).parents[1] / "studies"


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """In which gent is hidden; of three formulas that are asked."""
    return replace(make(3, "gent", "bulk", False, 11).campaign, candidates=("gent", "yeoh", "maxwell"))


@pytest.fixture(scope="module")
def whole(campaign) -> Discovery:
    """All of the search."""
    return discover(campaign, workers=0)


def stop(*args, **options):
    raise KeyboardInterrupt


def later(monkeypatch, module, name, then, count=1):
    """The function of that ``name`` does ``then`` from its ``count``-th call on, before anything else."""
    whole, calls = getattr(module, name), []

    def counted(*args, **options):
        calls.append(1)
        if len(calls) >= count:
            then()
        return whole(*args, **options)

    monkeypatch.setattr(module, name, counted)


def test_ctrl_c_in_a_later_round_keeps_what_was_found(campaign, monkeypatch, tmp_path):
    later(monkeypatch, search, "round_of", stop, count=2)
    d = search.discover(campaign, workers=0)
    assert d.stopped == "interrupted" and d.found and d.verdict == "mechanism"
    write_discovery(d, tmp_path)
    assert json.loads((tmp_path / "discovery.json").read_text())["status"] == "interrupted"


def test_ctrl_c_in_the_first_round_keeps_what_was_tried(campaign, whole, monkeypatch):
    later(monkeypatch, rounds, "extend", stop, count=2)
    d = discover(campaign, workers=0)
    (tried,) = d.rounds[0].tried
    assert d.stopped and tried.name in {t.name for t in whole.rounds[0].tried}
    assert d.found == ((tried.name,) if tried.convincing else ())
    assert d.first.values == whole.first.values


@pytest.mark.parametrize("of", ["sense", "extend"])
def test_ctrl_c_before_anything_was_tried_leaves_the_baseline_and_no_cause(campaign, monkeypatch, of):
    later(monkeypatch, rounds, of, stop)
    d = discover(campaign, workers=0)
    assert d.verdict == "undecided" and not d.found and d.wrong
    assert "interrupted" in summary(d)


@pytest.mark.parametrize("of", ["numerical_causes", "settled", "pruned", "_next"])
def test_ctrl_c_after_the_first_round_keeps_its_cause(campaign, whole, monkeypatch, of):
    later(monkeypatch, search, of, stop)
    d = discover(campaign, workers=0)
    assert d.verdict == "mechanism" and d.found[0] == whole.found[0]


def test_ctrl_c_before_the_baseline_is_fitted_leaves_nothing(campaign, monkeypatch):
    later(monkeypatch, search, "point_of", stop)
    with pytest.raises(KeyboardInterrupt):
        discover(campaign, workers=0)


def test_what_does_not_end_in_time_tells_what_was_found(campaign, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def wait():
        now[0] += 70.0

    later(monkeypatch, rounds, "extend", wait)
    d = discover(campaign, workers=0, limit_s=100.0)
    assert d.stopped == "out of time" and len(d.rounds[0].tried) == 1
    assert "out of time" in summary(d)


def test_a_limit_that_is_kept_changes_nothing(campaign, whole):
    d = discover(campaign, workers=0, limit_s=1e6)
    assert d.gain == whole.gain and d.stopped == whole.stopped == ""


def test_a_baseline_that_does_not_end_in_time_is_a_failure(campaign):
    with pytest.raises(ComputationFailed, match=r"not fitted after 0 s"):
        discover(campaign, workers=0, limit_s=0.0)


@pytest.mark.parametrize("limit", ["soon", "-1 s", "3 mm"])
def test_a_limit_that_is_no_time_is_refused(limit, tmp_path):
    study = str(STUDIES / "silicone" / "rtv615.toml")
    said = CliRunner().invoke(app, ["discover", study, "--out", str(tmp_path), "--limit", limit])
    assert said.exit_code == 2
