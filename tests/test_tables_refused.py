"""Tables, campaigns and fields that cannot be meant: each refused by one line with place and value."""

from __future__ import annotations

import numpy as np
import pytest
import tables_made as made
from typer.testing import CliRunner

from cutbench.cli.main import app

GOOD = made.HEAD + "\n" + made.rows(made.readings())


def with_line(at: int, text: str) -> str:
    """The good table with ``text`` as its line ``at``."""
    lines = GOOD.splitlines()
    lines[at - 1] = text
    return "\n".join(lines) + "\n"


def clocks(bad: str) -> str:
    values = made.readings()
    cells = [f"12:00:{t:04.1f}" for t in values[:, 0]]
    cells[20] = bad
    rows = zip(cells, values[:, 1:], strict=True)
    return "Time,Extension (mm),Load (N)\n" + "".join(f"{c},{u:.4f},{F:.5f}\n" for c, (u, F) in rows)


#: Table, more in the experiment, changed keys of it, and what the message has: place, key or value, and cure.
BAD = {
    # units
    "mpa may be two units": (
        GOOD.replace("(N)", "(mpa)"),
        "",
        {"columns": '{ displacement = "Extension", stress = "Load" }'},
        ("data.csv, line 1", "mpa", "'MPa'"),
    ),
    "an unknown unit": (GOOD.replace("(N)", "(Nn)"), "", {}, ("data.csv, line 1", "Nn", "units")),
    "a unit of another kind": (
        GOOD.replace("(N)", "(Hz)"),
        "",
        {},
        ("data.csv, line 1", "Hz", "units = { force"),
    ),
    "an unknown unit in a row of its own": (
        GOOD.replace(made.HEAD, "Time,Extension,Load\n(s),(mm),(Nn)"),
        "",
        {},
        ("data.csv, line 1", "Load = 'Nn'", "units"),
    ),
    "a unit in pixels": (GOOD.replace("(mm)", "(px)"), "", {}, ("data.csv, line 1", "px", "mm")),
    "mn in the campaign": (
        GOOD,
        'units = { force = "mn" }\n',
        {},
        ("campaign.toml, line", "units.force", "'mN' or 'MN'"),
    ),
    "no unit in the title": (
        GOOD.replace(" (N)", ""),
        "",
        {},
        ("data.csv, line 1", "no unit", "units = { force"),
    ),
    # cells and rows
    "a signed thousand": (GOOD.replace("10.0000", "10,000.0"), "", {}, ("data.csv, line 21", "10,000")),
    "a reading cut short": (with_line(41, "20.0000,20.0"), "", {}, ("data.csv, line 41", "row", "3 cells")),
    "a failed sensor": (
        with_line(30, "14.5,14.5,-1.#IND"),
        "",
        {},
        ("data.csv, line 30", "-1.#IND", "a number"),
    ),
    "words amid readings": (with_line(30, "paused,,"), "", {}, ("data.csv, line 30", "paused", "skip")),
    "a summary amid readings": (with_line(30, "Mean,10,0.9"), "", {}, ("data.csv, line 30", "Mean", "skip")),
    "words alone": (made.HEAD + "\nno readings\nat all\n", "", {}, ("data.csv",)),
    # times
    "a clock that cannot be read": (
        clocks("12:0x:10"),
        "",
        {},
        ("data.csv, line 22", "12:0x:10", "12:03:04.5"),
    ),
    "a clock that runs back": (clocks("12:00:01.0"), "", {}, ("data.csv, line 22", "time", "after that")),
    "a clock of two parts": (
        "Time,Extension (mm),Load (N)\n"
        + "".join(f"10:{k:02d},{k},{made.force(k):.4f}\n" for k in range(1, 20)),
        "",
        {},
        ("data.csv, line 2", "10:01", "units.time"),
    ),
    # travel
    "a decimal point lost": (
        with_line(25, "12.0,120000,1.2"),
        "",
        {},
        ("data.csv, line 25", "120000", "decimal point"),
    ),
    "a travel that jumps and comes back": (
        with_line(25, "12.0,-9.0,1.2"),
        "",
        {},
        ("data.csv, line 25", "-9"),
    ),
    # files and blocks
    "no such pattern": (
        GOOD,
        "",
        {"data": '"cut_*.csv"'},
        ("campaign.toml, line 8", "cut_*.csv", "data.csv"),
    ),
    "no such file": (
        GOOD,
        "",
        {"data": '"dat.csv"'},
        ("campaign.toml, line 8", "dat.csv", "did you mean 'data.csv'"),
    ),
    "an empty sequence": (GOOD, "", {"data": "[[]]"}, ("campaign.toml, line 8", "data", "hold.csv")),
    "a number for a file": (GOOD, "", {"data": "[[1]]"}, ("campaign.toml, line 8", "data", "hold.csv")),
    "a file twice in a sequence": (
        GOOD,
        "",
        {"data": '[["data.csv", "data.csv"]]'},
        ("campaign.toml, line 8", "data", "once"),
    ),
    "unknown blocks": (GOOD, 'blocks = "cycle"\n', {}, ("campaign.toml, line", "blocks", "cycles")),
    "skip without a text": (GOOD, 'skip = [""]\n', {}, ("campaign.toml, line", "skip", "Mean")),
    # sizes
    "too few sizes": (
        GOOD,
        "",
        {"specimen": '{ length = "40 mm", area = ["20 mm^2", "21 mm^2"] }'},
        ("campaign.toml, line 10", "specimen.area", "each of the 1"),
    ),
    "a size of nobody": (
        GOOD,
        "",
        {"specimen": '{ length = "40 mm", area = { 1 = "20 mm^2", B = "21 mm^2" } }'},
        ("campaign.toml, line 10", "specimen.area.B", "21"),
    ),
    "a size that is missing": (
        GOOD,
        "",
        {"specimen": '{ length = "40 mm", area = { B = "21 mm^2" } }'},
        ("campaign.toml, line 10", "specimen.area", "'1'"),
    ),
    "a size without unit": (
        GOOD,
        "",
        {"specimen": '{ length = "40 mm", area = [20] }'},
        ("campaign.toml, line 10", "specimen.area", "mm^2"),
    ),
    "a size below 0": (
        GOOD,
        "",
        {"specimen": '{ length = "40 mm", area = { 1 = "-20 mm^2" } }'},
        ("campaign.toml, line 10", "specimen.area.1", "more than 0"),
    ),
    "area and diameter": (
        GOOD,
        "",
        {"specimen": '{ length = "40 mm", area = ["20 mm^2"], diameter = "5 mm" }'},
        ("campaign.toml, line 10", "specimen.diameter", "not both"),
    ),
    "several zeros for one": (
        GOOD,
        'zero = ["1 mm", "2 mm"]\n',
        {},
        ("campaign.toml, line", "zero", "each of the 1"),
    ),
    "sizes of a cut by specimen": (
        GOOD,
        'blade = { thickness = "0.7 mm" }\n',
        {"kind": '"cut"', "specimen": '{ width = ["30 mm"], length = "30 mm", height = "21 mm" }'},
        ("campaign.toml, line 10", "specimen.width", "one value"),
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_refused(tmp_path, name):
    text, more, keys, wanted = BAD[name]
    message = made.refused(["data", str(made.campaign(tmp_path, text, more, **keys))])
    for part in wanted:
        assert part in message, message


def test_the_good_one_is_good(tmp_path):
    done = CliRunner().invoke(app, ["data", str(made.campaign(tmp_path, GOOD))])
    assert done.exit_code == 0, done.output


#: What tests are called, and what is written for them here; none: a kind that is not computed.
CALLED = {
    "tension": "uniaxial",
    "tensile": "uniaxial",
    "Zug-tensile": "uniaxial",
    "uniaxial_tension": "uniaxial",
    "compression": "uniaxial",
    "unconfined compression": "uniaxial",
    "relaxation": "uniaxial",
    "stress-relaxation": "uniaxial",
    "creep": "uniaxial",
    "cyclic": "uniaxial",
    "loading-unloading": "uniaxial",
    "biaxial": "equibiaxial",
    "equi-biaxial": "equibiaxial",
    "planar tension": "pure_shear",
    "pure shear": "pure_shear",
    "cutting": "cut",
    "friction": "sliding",
    "tack": "separation",
    "pull-off": "separation",
    "indentation": None,
    "nanoindentation": None,
    "puncture": None,
    "needle insertion": None,
    "simple_shear": None,
    "shear": None,
    "rheometer": None,
    "peel": None,
    "tear": None,
    "three-point bending": None,
    "DMA": None,
}


@pytest.mark.parametrize("called", CALLED)
def test_what_people_call_tests(tmp_path, called):
    message = made.refused(["data", str(made.campaign(tmp_path, GOOD, kind=f'"{called}"'))])
    assert f"kind = '{called}'" in message and "campaign.toml, line 7" in message
    expected = message.split("; expected ")[1]
    if CALLED[called] is None:
        assert "none of these" in expected and "did you mean" not in expected
    else:
        assert f"'{CALLED[called]}'" in expected.split(";")[0] + expected.split("did you mean")[-1]


@pytest.mark.parametrize(
    ("called", "meant"), [("uniaxal", "uniaxial"), ("slidin", "sliding"), ("Cut", "cut")]
)
def test_a_kind_that_is_misspelt(tmp_path, called, meant):
    message = made.refused(["data", str(made.campaign(tmp_path, GOOD, kind=f'"{called}"'))])
    assert f"did you mean '{meant}'" in message


def test_a_misspelt_section_is_named_and_not_printed(tmp_path):
    path = made.campaign(tmp_path, GOOD)
    path.write_text(path.read_text("utf-8").replace("[parameters]", "[paramters]"), encoding="utf-8")
    message = made.refused(["data", str(path)])
    assert "paramters" in message and "did you mean 'parameters'" in message and "{" not in message


def test_a_value_without_unit_is_given_no_guess(tmp_path):
    for value in ("0.0075", "75"):
        path = made.campaign(tmp_path, GOOD)
        path.write_text(path.read_text("utf-8").replace('"80 kPa"', value), encoding="utf-8")
        message = made.refused(["data", str(path)])
        assert f"{value} kPa" not in message and "kPa" in message and "campaign.toml, line 3" in message


FILES = {
    "campaign": '[[experiment]]\nid = "a"\n',
    "study": '[[axis]]\nname = "G"\n',
    "convergence": "[[change]]\n",
    "material": '[material]\ndescription = "mine"\n[parameters]\nG = "9 kPa"\n',
}
READ_BY = {
    "campaign": ["data"],
    "study": ["sweep", "--out", "OUT"],
    "convergence": ["converge", "--out", "OUT"],
    "material": ["run2d"],
}


@pytest.mark.parametrize("wanted", READ_BY)
@pytest.mark.parametrize("found", FILES)
def test_a_file_of_another_sort_is_said_to_be_one(tmp_path, wanted, found):
    if found == wanted:
        return
    path = tmp_path / "file.toml"
    path.write_text(FILES[found], encoding="utf-8")
    command, *rest = READ_BY[wanted]
    message = made.refused([command, str(path), *(str(tmp_path / "out") if r == "OUT" else r for r in rest)])
    assert "file.toml" in message and found in message.split("this is")[1]


def test_a_folder_without_a_map_is_said_to_be_one(tmp_path):
    message = made.refused(["guide", str(tmp_path), "--material", "gelatin"])
    assert "map.nc" in message and "rrno" not in message
    (tmp_path / "run.json").write_text("{}", encoding="utf-8")
    assert "a run" in made.refused(["guide", str(tmp_path), "--material", "gelatin"])
    (tmp_path / "map.nc").write_text("none", encoding="utf-8")
    assert "map.nc" in made.refused(["guide", str(tmp_path), "--material", "gelatin"])


FIELD = "x [mm],y [mm],u_x [mm],u_y [mm],sigma\n" + "".join(
    f"{x},{y},0.1,{0.01 * y},0.01\n" for x in range(5) for y in range(5)
)
BAD_FIELDS = {
    "no unit": (FIELD.replace(" [mm]", ""), [], ("field.csv, line 1", "no unit")),
    "pixels": (FIELD.replace("[mm]", "[pixel]"), [], ("field.csv, line 1", "pixel")),
    "a column that is not there": (
        FIELD,
        ["--columns", "x=x,y=y,u=u_x,v=W"],
        ("field.csv", "columns.u_y", "W"),
    ),
    "a role that is none": (FIELD, ["--columns", "x=X,y=Y,z=Z"], ("--columns", "z=Z", "x=X")),
    "a role that is missing": (FIELD, ["--columns", "x=x,y=y,u=u_x"], ("columns.u_y", "(missing)")),
    "a rule that is none": (FIELD, ["--valid", "sigma"], ("valid", "'sigma'", "sigma >= 0")),
    "a rule about no column": (FIELD, ["--valid", "corr > 0.5"], ("field.csv", "corr")),
    "a place that is missing": (FIELD.replace("2,2,0.1", ",2,0.1"), [], ("field.csv, line 14", "x")),
    "a word for a displacement": (
        FIELD.replace("2,2,0.1", "2,2,lost"),
        [],
        ("field.csv, line 14", "lost", "number"),
    ),
}


@pytest.mark.parametrize("name", BAD_FIELDS)
def test_fields_refused(tmp_path, name):
    text, options, wanted = BAD_FIELDS[name]
    path = tmp_path / "field.csv"
    path.write_text(text, encoding="utf-8")
    message = made.refused(
        ["dic", "gelatin", str(path), "--travel", "1", "--out", str(tmp_path / "out"), *options]
    )
    for part in wanted:
        assert part in message, message


def test_there_are_enough():
    assert len(BAD) + len(BAD_FIELDS) >= 25 and np.unique([*BAD, *BAD_FIELDS]).size == len(BAD) + len(
        BAD_FIELDS
    )
