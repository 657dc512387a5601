"""From readings to runs: what a fit and a discovery found is a case file for all that begins from one."""

from __future__ import annotations

import json
from pathlib import Path

import instrument
import numpy as np
import pytest
from typer.testing import CliRunner

from cutbench.calibration.case_file import runnable
from cutbench.case.case import Case, load_case
from cutbench.case.case_file_text import case_text
from cutbench.cli.main import app
from cutbench.data.campaign import load_campaign

AS_EXPORTED = 'zero = "auto"\nforce_zero = "auto"\nuntil = "return"\n'
STUDY = """title = "Two stiffnesses"
base = "fit/fitted.toml"

[protocol]
depth = "0.2 mm"

[numerics]
h = "1 mm"

[[axis]]
name = "G"
values = ["6 kPa", "9 kPa"]
"""
CASES = {
    "as it comes": {},
    "a sharper tip": {"tip": "1.4 mm", "depth": "3 mm", "G": "7.4375125 kPa"},
    "numerics": {"h": "0.4 mm", "element": "P2P1", "around": 0, "step_min_mm": 1e-5},
    "held": {"motion": [("0 s", "0 mm"), ("100 s", "2 mm"), ("300 s", "2 mm")], "depth": "2 mm"},
    "another model": {"with": ["gent", "maxwell"], "until": "transition"},
}


def entered(*words: object) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("name", CASES)
def test_a_case_as_text_is_the_case(name, tmp_path):
    case = load_case("gelatin", CASES[name])
    path = tmp_path / "case.toml"
    path.write_text(case_text(case, {"note": 'said "so"'}, {"G": "measured"}), encoding="utf-8")
    again = load_case(path)
    assert again.id == case.id and again.name == case.name


def same_but(case: Case, other: Case, *names: str) -> None:
    assert case.mechanisms == other.mechanisms
    for name, value in other.values.items():
        if name not in names:
            assert case.values[name] == pytest.approx(value, rel=1e-8), name


def test_a_cut_without_its_machine(tmp_path):
    (tmp_path / "cut.csv").write_text(
        "u [mm],F [N]\n" + "".join(f"{k / 10},{k / 20}\n" for k in range(1, 61)), encoding="utf-8"
    )
    path = tmp_path / "campaign.toml"
    path.write_text(
        """material = "gelatin"
baseline = ["neo_hookean", "volumetric", "smith_ferrante", "contact", "machine_compliance"]
[numerics]
h = "0.5 mm"
[[experiment]]
id = "cut"
kind = "cut"
data = "cut.csv"
columns = { displacement = "u", force = "F" }
specimen = { width = "25 mm", length = "20 mm", height = "15 mm" }
blade = { thickness = "0.5 mm", tip = "0.8 mm" }
speed = "0.5 mm/s"
""",
        encoding="utf-8",
    )
    campaign = load_campaign(path)
    case = runnable(campaign, campaign.base.set(compliance="0.2 mm/N"))
    assert case.mechanisms == campaign.model.without("machine_compliance").mechanisms
    shown = case.shown()
    wanted = {"width": "25 mm", "length": "20 mm", "height": "15 mm", "thickness": "0.5 mm", "tip": "0.8 mm"}
    assert wanted.items() <= shown.items()
    assert (shown["speed"], shown["depth"], case.sizes.h_mm) == ("0.5 mm/s", "6 mm", 0.5)


@pytest.mark.slow
def test_from_an_exported_file_to_what_a_map_begins_from(tmp_path, monkeypatch):
    """All that a user does and sees, from a texture analyser's file on."""
    monkeypatch.chdir(tmp_path)
    instrument.write_campaign(tmp_path, returned=True, stiffening=1.0, more=AS_EXPORTED)
    said = entered("data", "campaign.toml")
    assert all(f"gelatin {k}" in said for k in (1, 2, 3))
    entered("fit", "campaign.toml", "--out", "fit")
    fitted = json.loads(Path("fit/fit.json").read_text(encoding="utf-8"))
    assert fitted["status"] == "converged"
    assert 7.5 < fitted["parameters"]["G"]["value"] < 11  # kPa; the curve is steeper than neo-Hooke's
    assert any("contact found" in note for note in fitted["notes"])
    contact = fitted["experiments"]["press"]["contact"]["gelatin 2"]
    assert abs(contact["at"] - instrument.AIR_MM) < 3 * contact["sd"] < 0.1
    case, gelatin = load_case("fit/fitted.toml"), load_case("gelatin")
    same_but(case, gelatin, "G")
    assert case.values["G"] == pytest.approx(1e-3 * fitted["parameters"]["G"]["value"], rel=1e-8)

    Path("study.toml").write_text(STUDY, encoding="utf-8")
    assert "2 runs" in entered("sweep", "study.toml", "--out", "map", "--dry-run")


@pytest.mark.slow
def test_a_run_a_map_and_its_guide_begin_from_what_was_fitted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    instrument.write_campaign(tmp_path, returned=True, more=AS_EXPORTED)
    entered("fit", "campaign.toml", "--out", "fit")
    Path("study.toml").write_text(STUDY, encoding="utf-8")
    entered("run2d", "fit/fitted.toml", "--set", "h=1 mm", "--set", "depth=0.2 mm", "--out", "run")
    assert Path("run/curve.csv").is_file()
    assert "2 of 2 runs" in entered("sweep", "study.toml", "--out", "map", "--workers", 1)
    shipped = Path(__file__).parents[1] / "studies" / "results" / "boundary"
    said = entered("guide", shipped, "--material", "fit/fitted.toml")
    assert "cohesion" in said


@pytest.mark.slow
def test_from_an_exported_file_to_what_its_model_lacks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    instrument.write_campaign(tmp_path, returned=True, stiffening=1.0, more=AS_EXPORTED)
    entered("discover", "campaign.toml", "--out", "found")
    found = json.loads(Path("found/discovery.json").read_text(encoding="utf-8"))
    assert found["verdict"] == "mechanism" and found["ranking"][0]["kind"] == "mechanism"
    assert "contact found" in Path("found/discovery.html").read_text(encoding="utf-8")
    extended = load_case("found/case.toml")
    assert set(found["found"]) < set(extended.mechanisms) and extended.model.tool is not None
    offset = next(one for one in found["ranking"] if one["mechanism"] == "contact_offset")
    for value in offset["parameters"].values():
        assert abs(value["value"]) < 0.1  # no more than the contact that was found leaves open
    entered("run2d", "found/case.toml", "--set", "h=1 mm", "--set", "depth=0.2 mm", "--out", "run")


@pytest.mark.slow
def test_a_cut_that_begins_in_air_gives_its_stiffness_back(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    entered("run2d", "gelatin", "--set", "h=0.7 mm", "--set", "depth=2 mm", "--out", "run")
    curve = np.genfromtxt("run/curve.csv", delimiter=",", names=True)
    rng, air_mm, speed = np.random.default_rng(2), 2.0, 0.021
    u = np.arange(0, air_mm + 2, 0.02)
    force = np.interp(u - air_mm, np.append(0, curve["displacement_mm"]), np.append(0, curve["force_N"]))
    rows = ["Force,Distance,Time,Force,Distance,Time", "(g),(mm),(sec),(g),(mm),(sec)"]
    for at, F in zip(u, force / instrument.GRAM_N, strict=True):
        one, two = (scale * F + 1.5 + 0.1 * rng.standard_normal() for scale in (0.98, 1.02))
        rows.append(",".join(f"{grams:.2f},{at:.2f},{at / speed:.3f}" for grams in (one, two)))
    Path("cut.csv").write_text("\n".join(rows), encoding="utf-8")
    Path("cut.toml").write_text(
        """material = "gelatin"
[parameters]
G = "11 kPa"
[numerics]
h = "0.7 mm"
[fit]
free = ["G"]
[[experiment]]
id = "cut"
kind = "cut"
data = "cut.csv"
columns = { displacement = "Distance", force = "Force", time = "Time" }
specimen = { width = "30 mm", length = "30 mm", height = "21 mm" }
blade = { thickness = "0.7 mm", tip = "1.05 mm" }
zero = "auto"
force_zero = "auto"
""",
        encoding="utf-8",
    )
    for r in load_campaign("cut.toml").experiment("cut").repetitions:
        assert abs(r.contact.at - air_mm) < max(3 * r.contact.sd, 0.02)
    entered("fit", "cut.toml", "--out", "fit", "--no-refine", "--workers", 0)
    found = json.loads(Path("fit/fit.json").read_text(encoding="utf-8"))["parameters"]["G"]
    assert found["low"] < 7.5 < found["high"] and abs(found["value"] / 7.5 - 1) < 0.05
    entered("run2d", "fit/fitted.toml", "--set", "depth=0.3 mm", "--out", "again")
