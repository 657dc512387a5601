"""Fits that end at a bound, or before a minimum: what they say, and what they leave."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cutbench
from cutbench.calibration.fitting import LATE
from cutbench.data.campaign import load_campaign

#: kPa, of the strip that was measured.
TRUTH = 80.0

CAMPAIGN = """baseline = ["neo_hookean", "volumetric"]
[parameters]
G = "{start}"
nu = 0.4999
[fit]
free = ["G"]
{bounds}
[[experiment]]
id = "strip"
kind = "uniaxial"
data = "strip.csv"
columns = {{ displacement = "u [mm]", force = "F [N]" }}
specimen = {{ length = "40 mm", area = "20 mm^2" }}
"""


def campaign(folder: Path, start: str, bounds: str = ""):
    stretch = np.linspace(1.0, 1.5, 41)[1:]
    force = 20e-3 * TRUTH * (stretch - stretch**-2) * (1 + 0.003 * np.sin(7 * np.arange(40)))
    rows = [f"{40 * (s - 1):.5f},{f:.6f}" for s, f in zip(stretch, force, strict=True)]
    (folder / "strip.csv").write_text("\n".join(["u [mm],F [N]", *rows]))
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(start=start, bounds=f"bounds = {{ G = {bounds} }}" if bounds else ""))
    return load_campaign(path)


def test_a_start_beyond_its_bounds_and_a_bound_that_holds_the_fit_are_said_with_the_misfit(tmp_path):
    found = cutbench.fit(campaign(tmp_path, "80 kPa", '["100 kPa", "200 kPa"]'))
    (G,) = found.estimates
    assert G.at_bound and G.value == pytest.approx(0.1)
    misfit = found.compared[0].rmse / found.compared[0].mean.max()
    notes = " ".join(found.notes)
    assert {"80 kPa", "100 kPa"} <= {f"{word} kPa" for word in notes.replace("kPa", "").split()}
    assert f"{100 * misfit:.1f} %" in notes and misfit > 0.1


def test_a_fit_inside_its_bounds_says_nothing_of_them(tmp_path):
    found = cutbench.fit(campaign(tmp_path, "60 kPa", '["10 kPa", "200 kPa"]'))
    assert found.status == "converged" and not found.estimates[0].at_bound
    assert found.values["G"] == pytest.approx(TRUTH / 1000, rel=0.01)
    assert not any("10 kPa" in note for note in found.notes)


def test_one_that_is_interrupted_gives_no_estimate_no_interval_and_no_case_file(tmp_path):
    made = campaign(tmp_path, "20 kPa")

    def stops(done, total, text):
        raise KeyboardInterrupt

    (tmp_path / "fitted.toml").write_text("# of an earlier fit")
    found = cutbench.fit(made, on_progress=stops)
    found.save(tmp_path)
    assert found.status == "interrupted"
    record = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    assert record["status"] == "interrupted"
    (G,) = record["parameters"].values()
    assert G["low"] is None and G["high"] is None and G["sd"] is None and G["value"] > 0
    assert all(math.isnan(e.sd) for e in found.estimates)
    assert not (tmp_path / "fitted.toml").exists()
    assert (tmp_path / "fit.png").exists()
    # What is known of every test until then is said: how far its curve is off.
    assert record["experiments"]["strip"]["rmse"] > 0
    assert "nan" not in repr(found)


def test_tests_with_a_formula_know_a_limit_of_time_too(tmp_path):
    found = cutbench.fit(campaign(tmp_path, "20 kPa"), limit_s=0.0)
    assert found.status == LATE and not found.done


def test_a_limit_ends_the_run_that_is_under_way_with_one_process_too():
    made = load_campaign(Path(__file__).parents[1] / "studies" / "published" / "gelatin.toml")
    made = replace(made, base=made.base.set(h="0.03 mm", step="0.01 mm"))  # minutes a run
    began = time.monotonic()
    found = cutbench.fit(made, workers=1, limit_s=4.0)
    assert found.status == LATE and time.monotonic() - began < 30
