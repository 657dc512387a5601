"""Cases, studies, files and options that a person gets wrong in ways of their own: exit status 2, one message
with what it is about, no traceback."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cutbench.cli.main import app

CASE = """[material]
name = "mine"
[parameters]
G = "7.5 kPa"
nu = 0.49
G_c = "5.3 J/m^2"
delta_c = "0.07 mm"
eta_reg = "2.38 s"
tau_W = "0.8 kPa"
[specimen]
width = "30 mm"
length = "30 mm"
height = "21 mm"
[blade]
thickness = "0.7 mm"
tip = "1.05 mm"
[protocol]
speed = "0.021 mm/s"
"""
STUDY = """title = "mine"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 12.0
scale = "log"
points = 3
"""
SPEED, RANGE = 'speed = "0.021 mm/s"', 'from = 1.0\nto = 12.0\nscale = "log"\npoints = 3'

# What is written in place of what, and what the message names.
CASES = {
    "a table for a quantity": ('G = "7.5 kPa"', 'G = { value = 7.5, unit = "kPa" }', "G"),
    "a range": ('"7.5 kPa"', '"7 to 8 kPa"', "G"),
    "an error bar": ('"7.5 kPa"', '"7.5 ± 0.5 kPa"', "G"),
    "a decimal comma": ('"7.5 kPa"', '"7,5 kPa"', "G"),
    "a unit twice": ('"7.5 kPa"', '"7.5 kPa kPa"', "G"),
    "a section twice": ("[blade]", "[specimen]\n[blade]", "specimen"),
    "a motion in words": (SPEED, SPEED + '\nmotion = "down, then up"', "motion"),
    "a motion back in time": (
        SPEED, SPEED + '\nmotion = [["0 s", "0 mm"], ["9 s", "0.1 mm"], ["5 s", "0.2 mm"]]', "motion"
    ),
    "a motion of one point": (SPEED, SPEED + '\nmotion = [["0 s", "0 mm"]]', "motion"),
    "an end that there is not": (SPEED, SPEED + '\nuntil = "the end"', "until"),
    "cut deeper than it is high": ('height = "21 mm"', 'height = "21 mm"\nprecut = "25 mm"', "precut"),
    "as wide as the blade": ('width = "30 mm"', 'width = "0.7 mm"', "thickness"),
    "a kilometre wide": ('width = "30 mm"', 'width = "1 km"', "width"),
    "mechanisms that are numbers": ("[material]", "mechanisms = [1, 2]\n[material]", "mechanisms"),
    "no mechanism": ("[material]", "mechanisms = []\n[material]", "mechanisms"),
    "a base of itself": ("[material]", 'base = "mine.toml"\n[material]', "base"),
}  # fmt: skip
STUDIES = {
    "half a point": ("points = 3", "points = 2.5", "points"),
    "no point": ("points = 3", "points = 0", "points"),
    "points without end": ("points = 3", "points = 100000000", "points"),
    "from above to": ("to = 12.0", "to = 0.5", "to"),
    "a logarithm of nought": ("from = 1.0", "from = 0.0", "from"),
    "a word for a number": ("from = 1.0", 'from = "soft"', "from"),
    "an axis twice": ("[[axis]]", '[[axis]]\nname = "cohesion"\nvalues = [1, 2]\n[[axis]]', "cohesion"),
    "an axis that is a law": ('"cohesion"', '"contact"', "contact"),
    "single brackets": ("[[axis]]", "[axis]", "axis"),
    "a scale of its own": ('"log"', '"logarithmic"', "logarithmic"),
    "words among numbers": (RANGE, 'values = [1, "two"]', "two"),
    "a value twice": (RANGE, "values = [1, 1]", "values"),
    "a value that is none": (RANGE, "values = [1, nan]", "values"),
    "a mark that is not there": ("[[axis]]", 'plot = { mark = ["nothing.toml"] }\n[[axis]]', "nothing.toml"),
    "a drop of twice the force": ("[[axis]]", "regime = { drop = 2.0 }\n[[axis]]", "drop"),
    "a base that is a number": ('base = "gelatin"', "base = 5", "base"),
}
COMMANDS = {
    "a case swept": (["sweep", "mine.toml"], "mine.toml"),
    "a study run": (["run2d", "study.toml"], "study.toml"),
    "a study fitted": (["fit", "study.toml", "--out", "out"], "study.toml"),
    "a case discovered in": (["discover", "mine.toml", "--out", "out"], "mine.toml"),
    "a folder run": (["run2d", "."], "."),
    "a binary file": (["run2d", "binary.toml"], "binary.toml"),
    "frames less than none": (["run2d", "gelatin", "--frames", "-3"], "frames"),
    "a file for a folder": (["run2d", "gelatin", "--out", "mine.toml"], "--out"),
    "laws that cannot be read": (["run2d", "gelatin", "--mechanisms", "laws"], "broken.py"),
    "a folder without a map": (["guide", ".", "--material", "gelatin"], "map.nc"),
    "workers less than none": (["sweep", "study.toml", "--workers", "-2"], "--workers"),
    "a notch longer than the strip": (["tension", "gelatin", "--notch", "50"], "notch"),
    "a blade turned too far": (["run3d", "gelatin", "--set", "tilt=120 deg"], "tilt"),
    "a port that cannot be": (["app", "--port", "99999999"], "port"),
}


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(CASE, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "broken.py").write_text("def law(:\n")
    return tmp_path


def refused(words: list[str], named: str) -> None:
    before = sorted(os.listdir())
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2 and isinstance(done.exception, SystemExit), done.output
    assert named in done.output and "Traceback" not in done.output
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize("name", CASES)
def test_cases(name, here):
    old, new, named = CASES[name]
    assert CASE.count(old) == 1
    (here / "mine.toml").write_text(CASE.replace(old, new), encoding="utf-8")
    refused(["run2d", "mine.toml", "--depth", "0.2", "--h", "0.7"], named)


@pytest.mark.parametrize("name", STUDIES)
def test_studies(name, here):
    old, new, named = STUDIES[name]
    assert STUDY.count(old) == 1
    (here / "study.toml").write_text(STUDY.replace(old, new), encoding="utf-8")
    refused(["sweep", "study.toml"], named)


@pytest.mark.parametrize("name", COMMANDS)
def test_commands(name, here):
    refused(*COMMANDS[name])
