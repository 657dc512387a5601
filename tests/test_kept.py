"""Runs that a fit leaves in a folder: what was computed is never computed again."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from formula_of_cuts import campaign_in, force

from cutbench.base.errors import ComputationFailed
from cutbench.calibration import kept
from cutbench.calibration.fitting import fit
from cutbench.calibration.kept import ran
from cutbench.case.case import load_case
from cutbench.run.result import Outcome
from cutbench.run.sensitivity import Added, extended


class Counted:
    """Stands for ``run_case``: forces by a formula, in the blink of an eye. ``stops`` at that run."""

    def __init__(self, stops: int = 10**6, kind: str = "done"):
        self.runs, self.stops, self.kind = 0, stops, kind

    def __call__(self, case, *, sensitivities=(), added=(), on_step=None):
        self.runs += 1
        if self.runs > self.stops:
            raise KeyboardInterrupt
        v, x = case.values, np.linspace(0.0, case.values["depth"], 80)
        F = force(x, v["G"], v["G_c"], v["speed"])
        slopes = {name: np.zeros(x.size) for name in sensitivities}
        for name in {"G", "G_c"} & {*sensitivities}:
            moved = {n: v[n] * (1 + 1e-6 * (n == name)) for n in ("G", "G_c")}
            slopes[name] = (force(x, **moved, speed=v["speed"]) - F) / (1e-6 * v[name])
        by_added = [dict.fromkeys(each.names, i + x) for i, each in enumerate(added)]
        for row in x:
            on_step(row, None)
        curve = {"displacement_mm": x, "force_N": F, "time_s": x / v["speed"]}
        outcome = Outcome(self.kind, "as it was", "", float(x[-1]))
        return SimpleNamespace(
            curve=curve, outcome=outcome, measures={}, sensitivities=slopes, by_added=by_added, snapshots=()
        )


@pytest.fixture
def runs(monkeypatch):
    counted = Counted()
    monkeypatch.setattr(kept, "run_case", counted)
    return counted


def test_a_run_is_computed_once_and_again_for_more_derivatives(runs, tmp_path):
    case = load_case("gelatin")
    first, again = ran(case, ("G", "G_c"), (), tmp_path), ran(case, ("G",), (), tmp_path)
    assert runs.runs == 1
    np.testing.assert_array_equal(again.course, first.course)
    np.testing.assert_array_equal(again.slopes["G"], first.slopes["G"])
    assert again.outcome == first.outcome and np.isnan(again.onset_mm)
    ran(case, ("G", "nu"), (), tmp_path)
    ran(replace(case, values={**case.values, "G": 0.009}), ("G",), (), tmp_path)
    assert runs.runs == 3
    ran(case, ("G",), (), None)
    assert runs.runs == 4


def test_laws_that_a_run_lacks_are_told_apart(runs, tmp_path):
    case = load_case("gelatin")
    one, other = (Added(extended(case, [name]), names) for name, names in LAWS.items())
    both = ran(case, (), (one, other), tmp_path)
    alone = ran(case, (), (other,), tmp_path)
    assert runs.runs == 1
    np.testing.assert_array_equal(alone.by_added[0]["speed_toughening"], both.by_added[1]["speed_toughening"])


LAWS = {"fung": ("b_fung",), "speed_toughness": ("speed_toughening",)}


def test_what_a_rig_does_is_no_part_of_a_run(runs, tmp_path):
    case = load_case("gelatin")
    rigged = extended(case, ["contact_offset"])
    ran(case, ("G",), (), tmp_path)
    ran(rigged, ("G",), (), tmp_path)
    assert runs.runs == 1


def test_a_run_that_fell_short_is_kept_and_one_that_was_stopped_is_not(runs, tmp_path):
    case = load_case("gelatin")
    for kind, computed in (("stalled", 1), ("interrupted", 2)):
        runs.runs, runs.kind = 0, kind
        folder = tmp_path / kind
        assert [ran(case, (), (), folder).outcome.kind for _ in range(2)] == [kind] * 2
        assert runs.runs == computed


def test_a_run_that_takes_too_many_steps_falls_short(runs, tmp_path):
    case = load_case("gelatin")
    for folder in (None, tmp_path):
        with pytest.raises(ComputationFailed, match="79 steps"):
            ran(case, (), (), folder, longest=79)
    assert runs.runs == 2
    # That much is known of it from then on.
    with pytest.raises(ComputationFailed, match="50 steps"):
        ran(case, (), (), tmp_path, longest=50)
    assert runs.runs == 2
    assert ran(case, (), (), tmp_path, longest=80).course.shape == (3, 80)
    assert ran(case, (), (), tmp_path, longest=50).course.shape == (3, 80)
    assert runs.runs == 3


def test_what_cannot_be_read_is_computed_again(runs, tmp_path):
    case = load_case("gelatin")
    ran(case, (), (), tmp_path)
    (path,) = tmp_path.glob("*.npz")
    path.write_bytes(path.read_bytes()[:100])
    ran(case, (), (), tmp_path)
    ran(case, (), (), tmp_path)
    assert runs.runs == 2


def test_a_fit_that_was_stopped_goes_on_and_ends_as_if_it_had_not_been(monkeypatch, tmp_path):
    campaign = campaign_in(tmp_path)

    def fitted(folder, stops=10**6):
        counted = Counted(stops)
        monkeypatch.setattr(kept, "run_case", counted)
        found = fit(campaign, workers=0, kept=folder)
        return found, counted.runs

    whole, all_runs = fitted(tmp_path / "whole")
    stopped, _ = fitted(tmp_path / "stopped", stops=all_runs // 2)
    assert stopped.status == "interrupted"
    again, rest = fitted(tmp_path / "stopped")
    assert 0 < rest <= all_runs - all_runs // 2
    assert [e.value for e in again.estimates] == [e.value for e in whole.estimates]
    assert fitted(tmp_path / "stopped")[1] == 0
