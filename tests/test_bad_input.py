"""Whatever a person gets wrong: exit status 2, one message with file, key, value and what would be right."""

from __future__ import annotations

from pathlib import Path

import pytest
import study_texts
from refusals import refusal
from typer.testing import CliRunner

from cutbench.cli.main import app

STUDY = Path(__file__).parents[1] / "studies" / "transition.toml"

GOOD = """[parameters]
G = "7.5 kPa"
nu = 0.49
G_c = "5.3 J/m^2"
delta_c = "0.07 mm"
eta_reg = "2.38 s"
tau_W = "0.8 kPa"

[specimen]
width = "30 mm"

[protocol]
speed = "0.021 mm/s"
"""


def run(*args: object):
    return CliRunner().invoke(app, [str(a) for a in args])


# What is given besides the material, then what the message must hold: key, value, hint.
OPTIONS = {
    "unknown key": (["--set", "eta_rg=0.5 s"], "eta_rg", "0.5 s", "'eta_reg'"),
    "wrong case": (["--set", "g=7 kPa"], "g", "7 kPa", "'G'"),
    "unknown numerics": (["--set", "elemnt=P1"], "elemnt", "P1", "'element'"),
    "wrong unit": (["--set", "G=5 mm"], "G", "5 mm", "kPa"),
    "unknown unit": (["--set", "G=5 kPaa"], "G", "5 kPaa", "kPa"),
    "bare number": (["--set", "G=7.5"], "G", "7.5", "… kPa"),
    "bare speed": (["--set", "speed=0.021"], "speed", "0.021", "mm/s"),
    "unit on a plain number": (["--set", "nu=0.49 mm"], "nu", "0.49 mm", "without unit"),
    "words": (["--set", "G=soft"], "G", "soft", "1 kPa"),
    "negative modulus": (["--set", "G=-1 kPa"], "G", "-1 kPa", "0 kPa < G"),
    "zero modulus": (["--set", "G=0 kPa"], "G", "0 kPa", "0 kPa < G"),
    "incompressible": (["--set", "nu=0.5"], "nu", "0.5", "nu < 0.5"),
    "beyond incompressible": (["--set", "nu=0.7"], "nu", "0.7", "nu < 0.5"),
    "negative friction": (["--set", "mu=-0.1"], "mu", "-0.1", "0 <= mu"),
    "negative adhesion": (["--set", "tau_W=-1 kPa"], "tau_W", "-1 kPa", "0 kPa <= tau_W"),
    "negative viscosity": (["--set", "eta_reg=-1 s"], "eta_reg", "-1 s", "0 s <= eta_reg"),
    "zero speed": (["--set", "speed=0 mm/s"], "speed", "0 mm/s", "0 mm/s < speed"),
    "nan": (["--set", "G=nan kPa"], "G", "nan", "0 kPa < G"),
    "inf": (["--set", "G_c=inf J/m^2"], "G_c", "inf", "0 J/m^2 < G_c"),
    "nan without unit": (["--set", "nu=nan"], "nu", "nan", "0 <= nu < 0.5"),
    "negative group": (["--set", "cohesion=-3"], "cohesion", "-3", "0 <= cohesion"),
    "zero group": (["--set", "cohesion=0"], "G_c", "0 J/m^2", "0 J/m^2 < G_c"),
    "group with unit": (["--set", "adhesion=1 kPa"], "adhesion", "1 kPa", "without unit"),
    "set by two names": (["--set", "G_c=5 J/m^2", "--set", "cohesion=9"], "cohesion", "9", "not both"),
    "set by eta_v too": (["--set", "eta_v=0.05 mm", "--set", "eta_reg=1 s"], "eta_reg", "1 s", "'eta_v'"),
    "eta_v as a time": (["--set", "eta_v=0.05 s"], "eta_v", "0.05 s", "mm"),
    "set twice": (["--set", "mu=0.1", "--set", "mu=0.2"], "mu", "0.2", "once"),
    "option and set": (["--h", "0.4", "--set", "h=0.2 mm"], "--h", "0.4", "not both"),
    "short and long name": (["--set", "h=0.4 mm", "--set", "h_mm=0.2"], "h_mm", "0.2", "the same"),
    "no equals sign": (["--set", "mu"], "--set", "mu", "name=value"),
    "no value": (["--set", "mu="], "--set", "mu=", "name=value"),
    "no name": (["--set", "=3"], "--set", "=3", "name=value"),
    "element size zero": (["--h", "0"], "h", "0 mm", "mm <= h"),
    "element size negative": (["--h", "-0.1"], "h", "-0.1 mm", "above 0"),
    "element size in words": (["--h", "fine"], "h", "fine", "1 mm"),
    "element size in kPa": (["--h", "3 kPa"], "h", "3 kPa", "1 mm"),
    "element size nan": (["--h", "nan"], "h", "nan", "above 0"),
    "element coarser than the blade": (["--h", "2.5"], "h", "2.5 mm", "2.1 mm"),
    "tip too sharp for the mesh": (
        ["--set", "tip=12 mm", "--h", "0.25"], "tip", "12 mm", "'0.2 mm'"
    ),
    "tip of no length": (["--set", "tip=0 mm"], "tip", "0 mm", "0 mm < tip"),
    "blade wider than the block": (["--set", "thickness=40 mm"], "thickness", "40 mm", "30 mm"),
    "depth beyond the block": (["--depth", "40"], "depth", "40 mm", "21 mm"),
    "depth into the clamp": (["--depth", "22"], "depth", "22 mm", "21 mm"),
    "no blade": (["--without", "contact"], "mechanisms", "adhesion", "contact"),
    "depth zero": (["--depth", "0"], "depth", "0 mm", "0 mm < depth"),
    "depth negative": (["--depth", "-3"], "depth", "-3 mm", "0 mm < depth"),
    "unknown element": (["--element", "Q1"], "element", "Q1", "P2P1"),
    "unknown normal": (["--normal", "tol"], "normal", "tol", "'tool'"),
    "unknown scheme": (["--set", "scheme=stagered"], "scheme", "stagered", "'staggered'"),
    "half an augmentation": (["--set", "augmentations=1.5"], "augmentations", "1.5", "whole number"),
    "no tolerance": (["--set", "tolerance=0"], "tolerance", "0", "tolerance <= 0.01"),
    "steps crossed": (["--set", "step_min=0.5 mm"], "step_min", "0.5 mm", "0.1 mm"),
    "no such mesh": (["--set", "mesh=/nowhere/block.msh"], "mesh", "/nowhere/block.msh", ""),
    "unknown mechanism": (["--with", "gentt"], "with", "gentt", "'gent'"),
    "take out what is not there": (["--without", "viscous"], "without", "viscous", "'viscous_degraded'"),
    "no bulk law": (["--without", "neo_hookean"], "mechanisms", "volumetric", "neo_hookean"),
    "an end that there is not": (["--set", "until=the end"], "until", "the end", "transition"),
    "cut deeper than it is high": (["--set", "precut=25 mm"], "precut", "25 mm", "21 mm"),
    "as wide as the blade": (["--set", "width=0.7 mm"], "thickness", "0.7 mm", "thinner"),
    "a kilometre wide": (["--set", "width=1 km"], "width", "mm", "shortest"),
    "frames less than none": (["--frames", "-3"], "frames", "-3", "whole number"),
    "value of what was taken out": (
        ["--without", "adhesion", "--set", "tau_W=1 kPa"], "tau_W", "1 kPa", "adhesion"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", OPTIONS)
def test_options(case, tmp_path):
    args, key, value, hint = OPTIONS[case]
    assert value in refusal(run("run2d", "gelatin", *args, "--out", tmp_path / "out"), key, hint=hint)
    assert not (tmp_path / "out").exists(), "refused before anything is written"


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


# The file's text, then the line named in the message, and key, value, hint.
FILES = {
    "not TOML": (changed('G = "7.5 kPa"', "G = 7.5 kPa"), 2, "TOML", "G = 7.5 kPa", "readable"),
    "key written twice": (changed("nu = 0.49", "nu = 0.49\nnu = 0.4"), 4, "TOML", "nu = 0.4", "readable"),
    "unknown key": (changed("eta_reg", "eta_ref"), 6, "eta_ref", "2.38 s", "'eta_reg'"),
    "bare number": (changed('"7.5 kPa"', "7.5"), 2, "G", "7.5", "'… kPa'"),
    "wrong unit": (changed('"0.07 mm"', '"0.07 s"'), 5, "delta_c", "0.07 s", "1 mm"),
    "list for a number": (changed('"7.5 kPa"', '["7.5 kPa", "8 kPa"]'), 2, "G", "8 kPa", "1 kPa"),
    "truth for a number": (changed("nu = 0.49", "nu = true"), 3, "nu", "True", "without unit"),
    "table for a number": (changed("nu = 0.49", "nu = {a = 1}"), 3, "nu", "a section with a", "without unit"),
    "inf": (changed("nu = 0.49", "nu = inf"), 3, "nu", "inf", "nu < 0.5"),
    "negative": (changed('"30 mm"', '"-30 mm"'), 10, "width", "-30 mm", "0 mm < width"),
    "wrong section": (changed("[specimen]", "[blade]"), 10, "width", "30 mm", "[specimen]"),
    "unknown section": (changed("[protocol]", "[protocl]"), 12, "protocl", "speed", "'protocol'"),
    "key outside a section": ('G = "7 kPa"\n' + GOOD, 1, "G", "7 kPa", "[parameters]"),
    "section that is none": ("parameters = 3\n", 1, "parameters", "3", "[parameters]"),
    "missing parameter": (changed('G_c = "5.3 J/m^2"\n', ""), None, "G_c", "(missing)", "stiff_cohesion"),
    "unknown mechanism": ('mechanisms = ["neo_hooke"]\n' + GOOD, 1, "mechanisms", "neo_hooke", "neo_hookean"),
    "two of a role": (
        'mechanisms = ["neo_hookean", "smith_ferrante", "viscous", "viscous_degraded"]\n' + GOOD,
        1, "mechanisms", "viscous, viscous_degraded", "take out",
    ),
    "mechanisms that are no names": ("mechanisms = [1]\n" + GOOD, 1, "mechanisms", "[1]", "names"),
    "no mechanism": ("mechanisms = []\n" + GOOD, 1, "mechanisms", "[]", "names"),
    "unknown base": ('base = "gelatine"\n', 1, "base", "gelatine", "'gelatin'"),
    "base that is no name": ("base = 3\n", 1, "base", "3", "name"),
    "base that is this file": ('base = "case.toml"\n', 1, "base", "case.toml", "lead back"),
    "depth beyond the block": (
        GOOD + 'depth = "50 mm"\n', 14, "depth", "50 mm", "21 mm"
    ),
    "tip too sharp": (
        GOOD + '[numerics]\nh = "0.25 mm"\n[blade]\ntip = "12 mm"\n', 17, "tip", "12 mm", "a^2/b"
    ),
    "unknown element": (GOOD + '[numerics]\nelement = "P3"\n', 15, "element", "P3", "P2P1"),
    "elements of four thicknesses": (GOOD + "[numerics]\nh = 4\n", 15, "h", "4", "thicknesses"),
    "text for a whole number": (GOOD + '[numerics]\nlayers = "two"\n', 15, "layers", "two", "number"),
    "mesh that is no path": (GOOD + "[numerics]\nmesh = 3\n", 15, "mesh", "3", "path"),
    "unknown entry about the material": ('[material]\nauthor = "x"\n' + GOOD, 2, "author", "x", "source"),
    "name that is no text": ("[material]\nname = 3\n" + GOOD, 2, "name", "3", "text"),
}  # fmt: skip


@pytest.mark.parametrize("case", FILES)
def test_files(case, tmp_path):
    text, line, key, value, hint = FILES[case]
    file = tmp_path / "case.toml"
    file.write_text(text, encoding="utf-8")
    said = refusal(run("run2d", file, "--out", tmp_path / "out"), key, file=file, line=line, hint=hint)
    assert value in said


def test_the_file_that_the_others_spoil_is_good(tmp_path):
    from cutbench.case.case import load_case

    (tmp_path / "case.toml").write_text(GOOD, encoding="utf-8")
    assert load_case(tmp_path / "case.toml").id == load_case("gelatin").id


def test_bytes_that_are_no_text(tmp_path):
    file = tmp_path / "case.toml"
    file.write_bytes(b'[parameters]\nG = "7 \xff"\n')
    refusal(run("run2d", file), "text", file=file, line=2, hint="UTF-8")


def test_a_bad_base_is_named_by_its_own_file(tmp_path):
    (tmp_path / "base.toml").write_text(changed("nu = 0.49", "nu = 0.6"), encoding="utf-8")
    (tmp_path / "case.toml").write_text('base = "base.toml"\n', encoding="utf-8")
    refusal(run("run2d", tmp_path / "case.toml"), "nu", value="0.6", file="base.toml", line=3)


@pytest.mark.parametrize(("source", "hint"), [("geltin", "'gelatin'"), ("nowhere.toml", ""), (".", "folder")])
def test_no_such_material(source, hint):
    refusal(run("run2d", source), "material", value=source, hint=hint)


def test_unwritable_folder_is_refused_before_the_run(tmp_path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    out = tmp_path / "file" / "below"
    refusal(run("run2d", "gelatin", "--out", out), "--out", value=out)


@pytest.mark.parametrize(
    ("args", "key", "hint"),
    [
        (["materials", "gelatine"], "material", "'gelatin'"),
        (["mechanisms", "coulom"], "mechanism", "'coulomb'"),
        (["plot", "nowhere"], "DIR|MAP.nc", "run.json"),
        (["sweep", "nowhere.toml", "--out", "maps"], "file", ""),
        (["sweep", STUDY, "--out", "maps", "--workers", "many"], "--workers", ""),
        (["sweep", STUDY, "--out", "maps", "--workers", "-2"], "--workers", ""),
        (["run2d"], "MATERIAL", ""),
        (["run2d", "gelatin", "--sett", "mu=1"], "--sett", ""),
        (["cut"], "cut", ""),
    ],
)
def test_other_commands(args, key, hint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refusal(run(*args), key, hint=hint)
    assert list(Path().iterdir()) == [], "nothing was written"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("sweep mine.toml", "mine.toml"),
        ("run2d study.toml", "study.toml"),
        ("fit study.toml --out out", "study.toml"),
        ("discover mine.toml --out out", "mine.toml"),
        ("run2d .", "."),
        ("run2d binary.toml", "binary.toml"),
        ("run2d gelatin --out mine.toml", "--out"),
        ("run2d gelatin --mechanisms laws", "broken.py"),
        ("guide . --material gelatin", "map.nc"),
        ("tension gelatin --notch 50", "notch"),
        ("run3d gelatin --set tilt=120deg", "tilt"),
        ("app --port 99999999", "port"),
    ],
)
def test_files_of_another_kind_and_options_of_other_commands(words, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in (
        ("mine.toml", GOOD),
        ("study.toml", study_texts.GOOD),
        ("laws/broken.py", "def law(:"),
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    before = sorted(tmp_path.rglob("*"))
    done = run(*words.split())
    assert done.exit_code == 2 and isinstance(done.exception, SystemExit), done.output
    assert named in done.output and "Traceback" not in done.output
    assert sorted(tmp_path.rglob("*")) == before
