"""Sixty and more malformed campaigns: each refused by one message with file, line or key, and what would be
right; none with a traceback; no measured file is ever written to."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest
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


# Changes to the good campaign, then what the message must hold: place, key, value or hint.
BAD = {
    # the campaign file
    "not TOML": ([toml('title = "two', "title = two")], "campaign.toml, line 1", "readable TOML"),
    "empty title": ([toml('"two tests"', '""')], "campaign.toml, line 1: title", "a title"),
    "unknown key": ([toml("material =", "materials =")], "line 2: materials", "did you mean 'material'"),
    "unknown material": ([toml('"elastomer"', '"elastomr"')], "elastomr", "did you mean 'elastomer'"),
    "material is a number": ([toml('"elastomer"', "7")], "line 2: material = '7'", "a known name"),
    "no material": ([toml('material = "elastomer"\n', "")], "material = '(missing)'", "[parameters]"),
    "unknown baseline": ([toml('"contact", ', '"contakt", ')], "line 3: baseline", "did you mean 'contact'"),
    "baseline twice a role": (
        [toml('"neo_hookean", ', '"neo_hookean", "gent", ')],
        "line 3: baseline",
        "one mechanism",
    ),
    "baseline without shear": ([toml('"neo_hookean", ', "")], "line 3", "a bulk law that resists shear"),
    "unknown candidate": ([toml('["gent",', '["gnt",')], "line 4: candidates = 'gnt'", "did you mean 'gent'"),
    "candidate of the baseline": (
        [toml('["gent",', '["adhesion",')],
        "line 4: candidates",
        "not in the baseline",
    ),
    "candidate twice": ([toml('["gent",', '["coulomb",')], "line 4: candidates", "each candidate once"),
    "unknown free parameter": ([toml('"tau_W"]', '"tau_X"]')], "free = 'tau_X'", "did you mean 'tau_W'"),
    "unknown key of fit": ([toml("free =", "fre =")], "line 7: fre", "did you mean 'free'"),
    "bounds the wrong way": (
        [toml('"10 kPa", "900 kPa"', '"900 kPa", "10 kPa"')],
        "G = ",
        "lowest value first",
    ),
    "bounds without unit": ([toml('"10 kPa"', "10")], "line 10: G = 10", "a unit beside the number"),
    "coarse mesh": ([toml('"0.6 mm"', '"5 mm"')], "line 13: h", "the blade's thickness"),
    "parameter in numerics": ([toml('h = "0.6 mm"', 'G = "1 kPa"')], "line 13: G", "one of"),
    "no experiment": ([toml("[[experiment]]", "[[experimnt]]")], "experimnt", "did you mean 'experiment'"),
    "single brackets": ([toml('"test"\n', '"test"\n[experiment.x]\n')], "line 33", "x"),
    "same id": ([toml('"pull"', '"slow"')], "line 26: id = 'slow'", "each id once"),
    "no id": ([toml('id = "pull"\n', "")], "line 25: id = '(missing)'", "a name"),
    "unknown kind": ([toml('"uniaxial"', '"uniaxal"')], "line 27: kind", "did you mean 'uniaxial'"),
    "no kind": ([toml('kind = "cut"\n', "")], "line 15: kind = '(missing)'", "one of cut"),
    "unknown role": ([toml('"test"', '"tset"')], "line 32: role", "did you mean 'test'"),
    "nothing to fit": ([toml('speed = "0.02 mm/s"', 'role = "test"')], "role", "of role 'train'"),
    "unknown key of a test": (
        [toml("specimen = { length", "specimn = { length")],
        "line 31: specimn",
        "specimen",
    ),
    "key of another kind": (
        [toml('role = "test"', 'blade = { tip = "1 mm" }')],
        "line 32: blade",
        "of kind cut",
    ),
    "missing data file": (
        [toml('"pull.csv"', '"pul.csv"')],
        "line 28: data = 'pul.csv'",
        "a file that exists",
    ),
    "no data": ([toml('data = "pull.csv"\n', "")], "line 25: data = '(missing)'", "a file beside this one"),
    "same file twice": ([toml('"slow.csv"', '["slow.csv", "slow.csv"]')], "line 18: data", "each file once"),
    "no width": ([toml('width = "30 mm", ', "")], "line 21: specimen.width = '(missing)'", "specimen = {"),
    "no blade": ([toml('thickness = "0.7 mm", ', "")], "line 22: blade.thickness = '(missing)'", "0.7 mm"),
    "negative size": (
        [toml('height = "21 mm"', 'height = "-21 mm"')],
        "line 21: specimen.height",
        "more than 0",
    ),
    "size without unit": ([toml('area = "22 mm^2"', "area = 22")], "line 31: specimen.area", "a unit beside"),
    "no area": ([toml(', area = "22 mm^2"', "")], "line 31: specimen.area = '(missing)'", "mm^2"),
    "blade wider than the block": ([toml('"0.7 mm"', '"40 mm"')], "thickness", "thinner than the specimen"),
    "no speed and no time": (
        [toml('speed = "0.02 mm/s"\n', ""), toml(', time = "t [s]"', ""), toml(', time = "s"', "")],
        "line 15: speed = '(missing)'",
        "a time column",
    ),
    "speed of a minute": ([toml('"0.02 mm/s"', '"1.2 mm/s"')], "line 23: speed = '1.2 mm/s'", "0.02"),
    "speed of the wrong kind": ([toml('"0.02 mm/s"', '"0.02 mm"')], "line 23: speed", "1 mm/s"),
    "unknown column role": ([toml('force = "load"', 'forc = "load"')], "line 29: columns.forc", "force"),
    "no force column": (
        [toml(', force = "load"', "")],
        "line 29: columns.force = '(missing)'",
        "force or stress",
    ),
    "two abscissas": (
        [toml('displacement = "way"', 'displacement = "way", stretch = "load"')],
        "columns.stretch",
        "not both",
    ),
    "unknown unit": (
        [toml('displacement = "mm", force = "N" }', 'displacement = "mn", force = "N" }')],
        "line 30: units.displacement = 'mn'",
        "a unit such as 'mm'",
    ),
    "unit of the wrong kind": ([toml('time = "s" }', 'time = "mm" }')], "line 20: units.time = 'mm'", "'s'"),
    "unit of no column": ([toml('time = "s" }', 'stress = "MPa" }')], "line 20: units.stress", "one of"),
    "unit that overrules the header, and is wrong": (
        [toml('force = "N", time', 'force = "mN", time')],
        "slow.csv, line 13: force",
        "a wrong unit",
    ),
    "no unit at all": (
        [toml(', force = "N" }\nspecimen = { length', " }\nspecimen = { length")],
        "pull.csv, line 1: load = 'no unit'",
        "units = { force = 'N' }",
    ),
    "zero factor": (
        [toml('role = "test"', "factors = { force = 0 }")],
        "line 32: factors.force",
        "other than 0",
    ),
    "no approach to find": ([toml('speed = "0.02 mm/s"', 'zero = "auto"')], "line 23: zero = 'auto'", "'A'"),
    "contact beyond the readings": (
        [toml('speed = "0.02 mm/s"', 'zero = "9 mm"')],
        "line 23: zero = '9 mm'",
        "to 6 mm",
    ),
    "a zero without a displacement": (
        [
            toml('displacement = "way"', 'stretch = "way"'),
            toml('displacement = "mm", ', ""),
            toml('role = "test"', 'zero = "1 mm"'),
        ],
        "line 32: zero = '1 mm'",
        "a column of displacement",
    ),
    "no force before contact": (
        [toml('speed = "0.02 mm/s"', 'zero = "0.1 mm"\nforce_zero = "auto"')],
        "line 24: force_zero",
        "0.01 N",
    ),
    "force zero without unit": (
        [toml('speed = "0.02 mm/s"', "force_zero = 3")],
        "line 23: force_zero = 3",
        "a unit beside the number",
    ),
    "nothing left": (
        [toml('speed = "0.02 mm/s"', 'from = "7 mm"')],
        "line 23: from = '7 mm'",
        "they go to 6 mm",
    ),
    "too little left": ([toml('speed = "0.02 mm/s"', 'from = "5 mm"')], "slow.csv, line 11: readings", "5"),
    "lists of other lengths": (
        [toml('"u [mm]", force = "F [N]", time = "t [s]", repetition = "rep"', "[1, 2], force = [3]")],
        "line 19: columns.force",
        "2 in every list",
    ),
    "a column twice in a list": (
        [toml('displacement = "way", force = "load"', "displacement = 1, force = [2, 2]")],
        "columns.force = '2'",
        "a column of its own",
    ),
    # the data files
    "missing column": ([toml('"F [N]"', '"Force"')], "slow.csv, line 1: columns.force = 'Force'", "F [N]"),
    "nearest column": ([toml('"load"', '"lod"')], "pull.csv, line 1: columns.force", "did you mean 'load'"),
    "column twice": (
        [csv("rep;t [s];u [mm];F [N]", "rep;t [s];u [mm];F [N];F [N]")],
        "slow.csv",
        "stands twice",
    ),
    "empty file": ([csv("", " \n")], "slow.csv", "a header and readings"),
    "a spreadsheet": ([csv("", "PK\x03\x04\0\0")], "slow.csv", "export the readings as CSV"),
    "header alone": (
        [csv("", "rep;t [s];u [mm];F [N]\n")],
        "slow.csv, line 1",
        "no reading below the header",
    ),
    "nan": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00;nan")], "slow.csv, line 17: F [N] = 'nan'", "a number"),
    "empty cell": (
        [csv("B;100.0;2.00;4.830", "B;100.0;;4.830")],
        "slow.csv, line 17: u [mm]",
        "the cell is empty",
    ),
    "words": (
        [csv("B;100.0;2.00;4.830", "B;100.0;2.00;overload")],
        "slow.csv, line 17: F [N] = 'overload'",
        "number",
    ),
    "infinite": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00;1e999")], "slow.csv, line 17: force", "a number"),
    "short row": ([csv("B;100.0;2.00;4.830", "B;100.0;2.00")], "slow.csv, line 17: row", "4 cells"),
    "a unit of nothing in a row of units": (
        [
            toml(', force = "N" }\nspecimen = { length', " }\nspecimen = { length"),
            strip("way,load\n", "way,load\n(mm),(V)\n"),
        ],
        "pull.csv, line 1: load = 'V'",
        "a unit such as 'N'",
    ),
    "long row": (
        [strip("20.000,", "20,000,")],
        "pull.csv, line 6: row",
        "decimal commas need another separator",
    ),
    "two decimal signs": (
        [csv("B;100.0;2.00;4.830", "B;100.0;2.00;4,830")],
        "slow.csv, line 17: number",
        "one decimal",
    ),
    "thousands": (
        [csv("B;100.0;2.00;4.830", "B;1,100.0;2.00;4.830")],
        "slow.csv, line 17: number",
        "thousands",
    ),
    "time runs back": (
        [csv("B;100.0;2.00", "B;70.0;2.00")],
        "slow.csv, line 17: time",
        "after that of the reading",
    ),
    "time stands still": (
        [csv("B;100.0;2.00", "B;75.0;2.00")],
        "slow.csv, line 17: time",
        "the clock is too coarse",
    ),
    "empty repetition": (
        [csv("B;100.0;2.00", ";100.0;2.00")],
        "slow.csv, line 17: rep",
        "the name of a repetition",
    ),
    "too few readings": (
        [csv("B;100.0", "C;100.0")],
        "slow.csv, line 17: readings in repetition 'C' = '1'",
        "5 readings",
    ),
    "repetitions apart": (
        [csv("", slow() + "".join(f"C;{t};{t * 0.01:.2f};{t * 0.02:.2f}\n" for t in range(1, 9)))],
        "displacement in repetition 'C'",
        "share at least half",
    ),
    "force of the wrong sign": ([scaled(-1)], "slow.csv", "factors = { force = -1 }"),
    "force all zero": ([scaled(0)], "slow.csv: force", "something was measured"),
    "displacement of the wrong sign": ([scaled(-1, 2)], "slow.csv", "factors = { displacement = -1 }"),
    "force in mN": ([scaled(1e3)], "slow.csv", "wrong unit"),
    "force in kN": ([scaled(1e-3)], "slow.csv", "wrong unit"),
    "travel in micrometres": ([scaled(1e3, 2)], "slow.csv", "is it in another unit"),
    "travel in metres": ([scaled(1e-3, 2)], "slow.csv", "is it in another unit"),
    "wrong area": (
        [toml('"22 mm^2"', '"22 cm^2"'), toml('"22 cm^2"', '"22000 mm^2"')],
        "pull.csv",
        "a shear modulus",
    ),
    "stress in kPa for MPa": (
        [
            toml('force = "load" }', 'stress = "load" }'),
            toml('force = "N" }\nspec', 'stress = "GPa" }\nspec'),
        ],
        "pull.csv",
        "a shear modulus of 2.64e+06 kPa",
    ),
    "strain in percent": (
        [
            toml('displacement = "way"', 'strain = "way"'),
            toml('displacement = "mm", force = "N" }', 'force = "N" }'),
        ],
        "pull.csv, line 13: stretch",
        "a strain in percent",
    ),
    "a return without time": (
        [toml(', time = "t [s]"', ""), toml(', time = "s"', ""), csv("A;200.0;4.00", "A;200.0;2.00")],
        "slow.csv, line 9: displacement in repetition 'A' = '2 mm'",
        "needs a time column",
    ),
    "nothing moves": (
        [strip("", "way,load\n" + "".join(f"4.0,{i}\n" for i in range(1, 7)))],
        "stretch",
        "changes",
    ),
    "stretch below zero": ([strip("\n4.000,", "\n-90.000,")], "pull.csv, line 2: stretch", "above 0"),
}


def test_the_good_one_is_good(tmp_path):
    done = CliRunner().invoke(app, ["data", str(write(tmp_path, []))])
    assert done.exit_code == 0, done.output
    assert "slow" in done.output and "pull" in done.output


def test_there_are_sixty():
    assert len(BAD) >= 60


@pytest.mark.parametrize("name", BAD)
def test_refused(name, tmp_path):
    changes, *wanted = BAD[name]
    path = write(tmp_path, changes)
    before = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in tmp_path.iterdir()}
    done = CliRunner().invoke(app, ["data", str(path), "--out", str(tmp_path / "out")])
    # A traceback would reach the runner as an exception that is not an exit.
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    assert done.exit_code == 2, done.output
    message = done.output.strip()
    assert len(message.splitlines()) == 1 and "Traceback" not in message
    for part in wanted:
        assert part in message, message
    assert "cannot be used; expected" in message
    assert re.search(r"\.(toml|csv)", message), message
    after = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in tmp_path.iterdir() if p.is_file()}
    assert after == before
    assert not (tmp_path / "out").exists()
