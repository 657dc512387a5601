"""Sixty and more malformed campaigns: each refused by one message with file, line or key, and what would be
right; none with a traceback; no measured file is ever written to."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from refusals import ANY, refusal
from typer.testing import CliRunner

from cutbench.cli.main import app

CAMPAIGN = """title = "two tests"
material = "elastomer"
baseline = ["neo_hookean", "smith_ferrante", "contact", "adhesion"]
candidates = ["gent", "coulomb"]

[fit]
free = ["G", "tau_W"]

[fit.bounds]
G = ["10 kPa", "900 kPa"]

[numerics]
h = "0.6 mm"

[[experiment]]
id = "slow"
kind = "cut"
data = "slow.csv"
columns = { displacement = "u [mm]", force = "F [N]", time = "t [s]", repetition = "rep" }
units = { displacement = "mm", force = "N", time = "s" }
specimen = { width = "30 mm", length = "30 mm", height = "21 mm" }
blade = { thickness = "0.7 mm", tip = "1.05 mm" }
speed = "0.02 mm/s"

[[experiment]]
id = "pull"
kind = "uniaxial"
data = "pull.csv"
columns = { displacement = "way", force = "load" }
units = { displacement = "mm", force = "N" }
specimen = { length = "80 mm", area = "22 mm^2" }
role = "test"
"""


def slow() -> str:
    """Two specimens, 12 readings each: a force that rises by 2 N per mm up to 3 mm, then slowly."""
    rows = ["rep;t [s];u [mm];F [N]"]
    for name, scale in (("A", 1.0), ("B", 1.05)):
        for i in range(12):
            u = 0.5 * (i + 1)
            force = scale * (2.0 * min(u, 3.0) + 0.3 * u)
            rows.append(f"{name};{u / 0.02:.1f};{u:.2f};{force:.3f}")
    return "\n".join(rows) + "\n"


def pull() -> str:
    """A neo-Hookean strip of G = 120 kPa, 80 mm long, 22 mm² thick."""
    rows = ["way,load"]
    for i in range(1, 13):
        stretch = 1 + i / 20
        rows.append(f"{80 * (stretch - 1):.3f},{22 * 0.12 * (stretch - stretch**-2):.5f}")
    return "\n".join(rows) + "\n"


def write(folder: Path, changes: list[tuple[str, str, str]]) -> Path:
    """The good campaign with ``changes``: (file, pattern, replacement), each of which must apply."""
    texts = {"campaign.toml": CAMPAIGN, "slow.csv": slow(), "pull.csv": pull()}
    for name, old, new in changes:
        assert old == "" or old in texts[name], f"'{old}' is not in {name}"
        texts[name] = texts[name].replace(old, new) if old else new
    for name, text in texts.items():
        (folder / name).write_bytes(text.encode("utf-8"))
    return folder / "campaign.toml"


def toml(old: str, new: str) -> tuple[str, str, str]:
    return "campaign.toml", old, new


def csv(old: str, new: str) -> tuple[str, str, str]:
    return "slow.csv", old, new


def strip(old: str, new: str) -> tuple[str, str, str]:
    return "pull.csv", old, new


def scaled(factor: float, column: int = 3) -> tuple[str, str, str]:
    """The cutting readings with one column times ``factor``."""
    head, *rows = slow().splitlines()
    cells = [row.split(";") for row in rows]
    for row in cells:
        row[column] = f"{factor * float(row[column]):.9g}"
    return "slow.csv", "", "\n".join([head, *(";".join(row) for row in cells)]) + "\n"


# Changes to the good campaign, then what is named: file, line, key, value (None: of several words), and a
# name, a number or a unit of what would be right.
BAD = {
    "not TOML": ([toml('title = "two', "title = two")], "campaign.toml", 1, "TOML", None, ""),
    "empty title": ([toml('"two tests"', '""')], "campaign.toml", 1, "title", "", ""),
    "unknown key": ([toml("material =", "materials =")],
        "campaign.toml", 2, "materials", "elastomer", "'material'"),
    "unknown material": ([toml('"elastomer"', '"elastomr"')],
        "campaign.toml", 2, "material", "elastomr", "'elastomer'"),
    "material is a number": ([toml('"elastomer"', "7")], "campaign.toml", 2, "material", "7", ""),
    "no material": ([toml('material = "elastomer"\n', "")],
        "campaign.toml", None, "material", "(missing)", "[parameters]"),
    "unknown baseline": ([toml('"contact", ', '"contakt", ')],
        "campaign.toml", 3, "baseline", "contakt", "'contact'"),
    "baseline twice a role": ([toml('"neo_hookean", ', '"neo_hookean", "gent", ')],
        "campaign.toml", 3, "baseline", None, ""),
    "baseline without shear": ([toml('"neo_hookean", ', "")], "campaign.toml", 3, "baseline", None, ""),
    "unknown candidate": ([toml('["gent",', '["gnt",')], "campaign.toml", 4, "candidates", "gnt", "'gent'"),
    "candidate of the baseline": ([toml('["gent",', '["adhesion",')],
        "campaign.toml", 4, "candidates", "adhesion", ""),
    "candidate twice": ([toml('["gent",', '["coulomb",')], "campaign.toml", 4, "candidates", "coulomb", ""),
    "unknown free parameter": ([toml('"tau_W"]', '"tau_X"]')],
        "campaign.toml", 7, "free", "tau_X", "'tau_W'"),
    "unknown key of fit": ([toml("free =", "fre =")], "campaign.toml", 7, "fre", None, "'free'"),
    "bounds the wrong way": ([toml('"10 kPa", "900 kPa"', '"900 kPa", "10 kPa"')],
        "campaign.toml", 10, "G", None, ""),
    "bounds without unit": ([toml('"10 kPa"', "10")], "campaign.toml", 10, "G", "10", "kPa"),
    "coarse mesh": ([toml('"0.6 mm"', '"5 mm"')], "campaign.toml", 13, "h", "5 mm", "0.7 mm"),
    "parameter in numerics": ([toml('h = "0.6 mm"', 'G = "1 kPa"')], "campaign.toml", 13, "G", "1 kPa", "h"),
    "no experiment": ([toml("[[experiment]]", "[[experimnt]]")],
        "campaign.toml", 15, "experimnt", None, "'experiment'"),
    "single brackets": ([toml('"test"\n', '"test"\n[experiment.x]\n')],
        "campaign.toml", 33, "x", None, "data"),
    "same id": ([toml('"pull"', '"slow"')], "campaign.toml", 26, "id", "slow", ""),
    "no id": ([toml('id = "pull"\n', "")], "campaign.toml", 25, "id", "(missing)", ""),
    "unknown kind": ([toml('"uniaxial"', '"uniaxal"')], "campaign.toml", 27, "kind", "uniaxal", "'uniaxial'"),
    "no kind": ([toml('kind = "cut"\n', "")], "campaign.toml", 15, "kind", "(missing)", "cut"),
    "unknown role": ([toml('"test"', '"tset"')], "campaign.toml", 32, "role", "tset", "'test'"),
    "nothing to fit": ([toml('speed = "0.02 mm/s"', 'role = "test"')],
        "campaign.toml", 23, "role", None, "'train'"),
    "unknown key of a test": ([toml("specimen = { length", "specimn = { length")],
        "campaign.toml", 31, "specimn", None, "specimen"),
    "key of another kind": ([toml('role = "test"', 'blade = { tip = "1 mm" }')],
        "campaign.toml", 32, "blade", None, "cut"),
    "angle without unit": ([toml('role = "test"', "angle = 45")], "campaign.toml", 32, "angle", "45", "deg"),
    "angle beyond half a turn": ([toml('role = "test"', 'angle = "200 deg"')],
        "campaign.toml", 32, "angle", "200 deg", "180 deg"),
    "a blade drawn backwards": ([toml('speed = "0.02 mm/s"', "slice_push = -1")],
        "campaign.toml", 23, "slice_push", "-1", "0"),
    "a blade drawn in a test without one": ([toml('role = "test"', "slice_push = 1")],
        "campaign.toml", 32, "slice_push", "1", "cut"),
    "missing data file": ([toml('"pull.csv"', '"pul.csv"')], "campaign.toml", 28, "data", "pul.csv", ""),
    "no data": ([toml('data = "pull.csv"\n', "")], "campaign.toml", 25, "data", "(missing)", ""),
    "same file twice": ([toml('"slow.csv"', '["slow.csv", "slow.csv"]')],
        "campaign.toml", 18, "data", None, ""),
    "no width": ([toml('width = "30 mm", ', "")],
        "campaign.toml", 21, "specimen.width", "(missing)", "specimen"),
    "no blade": ([toml('thickness = "0.7 mm", ', "")],
        "campaign.toml", 22, "blade.thickness", "(missing)", "0.7 mm"),
    "negative size": ([toml('height = "21 mm"', 'height = "-21 mm"')],
        "campaign.toml", 21, "specimen.height", "-21 mm", ""),
    "size without unit": ([toml('area = "22 mm^2"', "area = 22")],
        "campaign.toml", 31, "specimen.area", "22", "mm^2"),
    "no area": ([toml(', area = "22 mm^2"', "")], "campaign.toml", 31, "specimen.area", "(missing)", "mm^2"),
    "blade wider than the block": ([toml('"0.7 mm"', '"40 mm"')],
        "campaign.toml", None, "thickness", "40 mm", "30 mm"),
    "no speed and no time": ([
        toml('speed = "0.02 mm/s"\n', ""),
        toml(', time = "t [s]"', ""),
        toml(', time = "s"', "")
        ],
        "campaign.toml", 15, "speed", "(missing)", "time"),
    "speed of a minute": ([toml('"0.02 mm/s"', '"1.2 mm/s"')],
        "campaign.toml", 23, "speed", "1.2 mm/s", "0.02"),
    "speed of the wrong kind": ([toml('"0.02 mm/s"', '"0.02 mm"')],
        "campaign.toml", 23, "speed", "0.02 mm", "1 mm/s"),
    "unknown column role": ([toml('force = "load"', 'forc = "load"')],
        "campaign.toml", 29, "columns.forc", "load", "force"),
    "no force column": ([toml(', force = "load"', "")],
        "campaign.toml", 29, "columns.force", "(missing)", "stress"),
    "two abscissas": ([toml('displacement = "way"', 'displacement = "way", stretch = "load"')],
        "campaign.toml", 29, "columns.stretch", "load", ""),
    "unknown unit": ([toml('displacement = "mm", force = "N" }', 'displacement = "mn", force = "N" }')],
        "campaign.toml", 30, "units.displacement", "mn", "'mm'"),
    "unit of the wrong kind": ([toml('time = "s" }', 'time = "mm" }')],
        "campaign.toml", 20, "units.time", "mm", "'s'"),
    "unit of no column": ([toml('time = "s" }', 'stress = "MPa" }')],
        "campaign.toml", 20, "units.stress", "MPa", "displacement"),
    "unit against the header": ([toml('force = "N", time', 'force = "mN", time')],
        "slow.csv", 13, "force", None, "a wrong unit"),
    "no unit at all": ([toml(', force = "N" }\nspecimen = { length', " }\nspecimen = { length")],
        "pull.csv", 1, "load", "no unit", "'N'"),
    "zero factor": ([toml('role = "test"', "factors = { force = 0 }")],
        "campaign.toml", 32, "factors.force", "0", ""),
    "no approach to find": ([toml('speed = "0.02 mm/s"', 'zero = "auto"')],
        "campaign.toml", 23, "zero", "auto", "'A'"),
    "contact beyond the readings": ([toml('speed = "0.02 mm/s"', 'zero = "9 mm"')],
        "campaign.toml", 23, "zero", "9 mm", "6 mm"),
    "a zero without a displacement": ([
        toml('displacement = "way"', 'stretch = "way"'),
        toml('displacement = "mm", ', ""),
        toml('role = "test"', 'zero = "1 mm"')
        ],
        "campaign.toml", 32, "zero", "1 mm", "displacement"),
    "no force before contact": ([toml('speed = "0.02 mm/s"', 'zero = "0.1 mm"\nforce_zero = "auto"')],
        "campaign.toml", 24, "force_zero", "auto", "0.01 N"),
    "force zero without unit": ([toml('speed = "0.02 mm/s"', "force_zero = 3")],
        "campaign.toml", 23, "force_zero", "3", "N"),
    "nothing left": ([toml('speed = "0.02 mm/s"', 'from = "7 mm"')],
        "campaign.toml", 23, "from", "7 mm", "6 mm"),
    "too little left": ([toml('speed = "0.02 mm/s"', 'from = "5 mm"')], "slow.csv", 11, "readings", "3", "5"),
    "lists of other lengths": ([
        toml('"u [mm]", force = "F [N]", time = "t [s]", repetition = "rep"', "[1, 2], force = [3]")
        ],
        "campaign.toml", 19, "columns.force", None, "2"),
    "a column twice in a list": ([
        toml('displacement = "way", force = "load"', "displacement = 1, force = [2, 2]")
        ],
        "pull.csv", 1, "columns.force", "2", ""),
    "missing column": ([toml('"F [N]"', '"Force"')], "slow.csv", 1, "columns.force", "Force", "F [N]"),
    "nearest column": ([toml('"load"', '"lod"')], "pull.csv", 1, "columns.force", "lod", "'load'"),
    "column twice": ([csv("rep;t [s];u [mm];F [N]", "rep;t [s];u [mm];F [N];F [N]")],
        "slow.csv", 1, "columns.force", "F [N]", ""),
    "empty file": ([csv("", " \n")], "slow.csv", None, "data", None, ""),
    "a spreadsheet": ([csv("", "PK\x03\x04\0\0")], "slow.csv", None, "data", None, "CSV"),
    "header alone": ([csv("", "rep;t [s];u [mm];F [N]\n")], "slow.csv", 1, "data", None, ""),
    "nan": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00;nan")], "slow.csv", 17, "F [N]", "nan", ""),
    "empty cell": ([csv("B;100.0;2.00;4.830", "B;100.0;;4.830")], "slow.csv", 17, "u [mm]", "", ""),
    "words": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00;overload")], "slow.csv", 17, "F [N]", "overload", ""),
    "infinite": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00;1e999")], "slow.csv", 17, "force", "inf", ""),
    "short row": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00")], "slow.csv", 17, "row", "B;100.0;2.00", "4"),
    "a unit of nothing in a row of units": ([
        toml(', force = "N" }\nspecimen = { length', " }\nspecimen = { length"),
        strip("way,load\n", "way,load\n(mm),(V)\n")
        ],
        "pull.csv", 1, "load", "V", "'N'"),
    "long row": ([strip("20.000,", "20,000,")], "pull.csv", 6, "row", "20,000,1.61040", ""),
    "two decimal signs": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00;4,830")],
        "slow.csv", 17, "number", "4,830", ""),
    "thousands": ([csv("B;100.0;2.00;4.830", "B;1,100.0;2.00;4.830")],
        "slow.csv", 17, "number", "1,100.0", ""),
    "time runs back": ([csv("B;100.0;2.00", "B;70.0;2.00")], "slow.csv", 17, "time", "70 s", ""),
    "time stands still": ([csv("B;100.0;2.00", "B;75.0;2.00")], "slow.csv", 17, "time", "75 s", ""),
    "empty repetition": ([csv("B;100.0;2.00", ";100.0;2.00")], "slow.csv", 17, "rep", "", ""),
    "too few readings": ([csv("B;100.0", "C;100.0")], "slow.csv", 17, "readings", "1", "5"),
    "repetitions apart": ([
        csv("", slow() + "".join(f"C;{t};{t * 0.01:.2f};{t * 0.02:.2f}\n" for t in range(1, 9)))
        ],
        "slow.csv", None, "displacement", "0.01 to 0.08", ""),
    "force of the wrong sign": ([scaled(-1)], "slow.csv", 13, "force", "-7.8 N", "-1"),
    "force all zero": ([scaled(0)], "slow.csv", None, "force", None, ""),
    "displacement of the wrong sign": ([scaled(-1, 2)], "slow.csv", 13, "force", "7.8 N", "-1"),
    "force in mN": ([scaled(1e3)], "slow.csv", 13, "force", None, ""),
    "force in kN": ([scaled(1e-3)], "slow.csv", 13, "force", None, ""),
    "travel in micrometres": ([scaled(1e3, 2)], "slow.csv", 13, "displacement", "6000 mm", ""),
    "travel in metres": ([scaled(1e-3, 2)], "slow.csv", 13, "displacement", None, ""),
    "wrong area": ([toml('"22 mm^2"', '"22 cm^2"'), toml('"22 cm^2"', '"22000 mm^2"')],
        "pull.csv", 13, "stress", None, ""),
    "stress in kPa for MPa": ([
        toml('force = "load" }', 'stress = "load" }'),
        toml('force = "N" }\nspec', 'stress = "GPa" }\nspec')
        ],
        "pull.csv", 13, "stress", None, ""),
    "strain in percent": ([
        toml('displacement = "way"', 'strain = "way"'),
        toml('displacement = "mm", force = "N" }', 'force = "N" }')
        ],
        "pull.csv", 13, "stretch", "49", "percent"),
    "a return without time": ([
        toml(', time = "t [s]"', ""),
        toml(', time = "s"', ""),
        csv("A;200.0;4.00", "A;200.0;2.00")
        ],
        "slow.csv", 9, "displacement", "2 mm", "time"),
    "nothing moves": ([strip("", "way,load\n" + "".join(f"4.0,{i}\n" for i in range(1, 7)))],
        "pull.csv", None, "stretch", None, ""),
    "stretch below zero": ([strip("\n4.000,", "\n-90.000,")], "pull.csv", 2, "stretch", "-0.125", ""),
}  # fmt: skip


def test_the_good_one_is_good(tmp_path):
    done = CliRunner().invoke(app, ["data", str(write(tmp_path, []))])
    assert done.exit_code == 0, done.output
    assert "slow" in done.output and "pull" in done.output


def test_there_are_sixty():
    assert len(BAD) >= 60


@pytest.mark.parametrize("name", BAD)
def test_refused(name, tmp_path):
    changes, file, line, key, value, hint = BAD[name]
    path = write(tmp_path, changes)
    before = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in tmp_path.iterdir()}
    done = CliRunner().invoke(app, ["data", str(path), "--out", str(tmp_path / "out")])
    refusal(done, key, value=ANY if value is None else value, line=line, file=file, hint=hint)
    after = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in tmp_path.iterdir() if p.is_file()}
    assert after == before
    assert not (tmp_path / "out").exists()
