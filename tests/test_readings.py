"""The same readings in many clothes are the same readings."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from refusals import refused

from cutbench.data.columns import parted, size_of
from cutbench.data.table import read_table

U = [0.5, 1.0, 1.5, 2.25]
F = [1.25, -0.5, 3.0, 1000.5]

COLUMNS = {"displacement": "u", "force": "F"}


def table(separator=",", head=("u [mm]", "F [N]"), comma=False, end="\n", above="", row="{:g}") -> str:
    rows = [separator.join(head)]
    for pair in zip(U, F, strict=True):
        cells = [row.format(v) for v in pair]
        rows.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
    return above + end.join(rows) + end


# Bytes of a file, and where the header does not say it, the units.
CLOTHES = {
    "plain": (table().encode(), None),
    "semicolons": (table(";").encode(), None),
    "tabs": (table("\t").encode(), None),
    "bars": (table("|").encode(), None),
    "blanks": (table("   ", ("u[mm]", "F[N]")).encode(), None),
    "decimal commas": (table(";", comma=True).encode(), None),
    "decimal commas and tabs": (table("\t", comma=True).encode(), None),
    "quoted decimal commas": (table(comma=True, row='"{:g}"').encode(), None),
    "quotes": (table(head=('"u [mm]"', '"F [N]"'), row='"{:g}"').encode(), None),
    "BOM": (table().encode("utf-8-sig"), None),
    "UTF-16": (table().encode("utf-16"), None),
    "Latin-1": (table(";", above="Prüfkörper;30 °C\n").encode("latin-1"), None),
    "CRLF": (table(end="\r\n").encode(), None),
    "CR": (table(end="\r").encode(), None),
    "no last line end": (table().strip().encode(), None),
    "lines above": (table(";", above="Machine;X\nWidth (mm);30\n;;;\n").encode(), None),
    "comments": (table(above="# a note, u [mm]\n").replace("1.5,", "# half way\n1.5,").encode(), None),
    "header in a comment": (table(head=("# u [mm]", "F [N]")).encode(), None),
    "trailing separators": (table(";").replace("\n", ";;\n").encode(), None),
    "blank lines": (table().replace("\n", "\n\n").encode(), None),
    "parentheses": (table(head=("u (mm)", "F (N)")).encode(), None),
    "slashes": (table(head=("u / mm", "F / N")).encode(), None),
    "in": (table(head=("u in mm", "F in N")).encode(), None),
    "underscores": (table(head=("u_mm", "F_N")).encode(), None),
    "units below": (table(";", head=("u", "F")).replace("u;F\n", "u;F\n(mm);(N)\n").encode(), None),
    "an instrument's header": (
        table(head=("u", "F"), above="Project,X\nDate,1/2/2026\n")
        .replace("u,F\n", "u,F\n(mm),(N)\n")
        .encode(),
        None,
    ),
    "unnamed columns beside": (
        ("u [mm];F [N]\n" + "".join(f"{u:g};{f:g};7;x\n" for u, f in zip(U, F, strict=True))).encode(),
        None,
    ),
    "units given": (table(head=("u", "F")).encode(), {"displacement": "mm", "force": "N"}),
    "other case": (table(head=("U [mm]", "f [N]")).encode(), None),
    "more columns": (table(head=("u [mm]", "F [N]", "note")).replace("\n1", ",x\n1").encode(), None),
    "exponents": (table(row="{:.6e}").encode(), None),
    "a typographic minus": (table().replace("-", "\u2212").encode(), None),
}


@pytest.mark.parametrize("name", CLOTHES)
def test_clothes(name, tmp_path):
    raw, units = CLOTHES[name]
    path = tmp_path / "data.csv"
    path.write_bytes(raw)
    found = read_table(path, COLUMNS, units)
    np.testing.assert_allclose(found.columns["displacement"], U, rtol=1e-12)
    np.testing.assert_allclose(found.columns["force"], F, rtol=1e-12)
    assert path.read_bytes() == raw


#: Two specimens side by side, the second one shorter: what the file holds, and how its columns are asked for.
BESIDE = {
    "under the same names": ("F,u,F,u\n(N),(mm),(N),(mm)", COLUMNS, ("1", "2")),
    "with names above": (
        "Tester 5;;;\nsoft;;hard;\nF [N];u [mm];F [N];u [mm]", COLUMNS, ("soft", "hard")
    ),
    "in other units": ("F [N],u [mm],F [mN],u [mm]", COLUMNS, ("1", "2")),
    "by name": (
        "F1 [N],u1 [mm],F2 [N],u2 [mm]", {"force": ["F1", "F2"], "displacement": ["u1", "u2"]}, ("F1", "F2")
    ),
    "by number, without titles": ("(N),(mm),(N),(mm)", {"force": [1, 3], "displacement": [2, 4]}, ("1", "2")),
    "by number, with titles and units": (
        "F,u,,\nN,mm,N,mm", {"force": [1, 3], "displacement": [2, 4]}, ("1", "2")
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BESIDE)
def test_specimens_side_by_side(name, tmp_path):
    head, columns, labels = BESIDE[name]
    separator, scale = (";" if ";" in head else ","), (1000 if "[mN]" in head else 1)
    rows = [f"{f:g},{u:g},{2 * scale * f:g},{u + 1:g}" for f, u in zip(F, U, strict=True)]
    rows[-1] = f"{F[-1]:g},{U[-1]:g},,"
    path = tmp_path / "data.csv"
    path.write_text(f"{head}\n" + "\n".join(rows).replace(",", separator) + "\n", encoding="utf-8")
    found = read_table(path, columns, wide=True)
    assert found.specimens == labels
    assert tuple(found.labels) == (labels[0],) * 4 + (labels[1],) * 3
    np.testing.assert_allclose(found.columns["force"], [*F, *(2 * f for f in F[:3])], rtol=1e-12)
    np.testing.assert_allclose(found.columns["displacement"], [*U, *(u + 1 for u in U[:3])], rtol=1e-12)


def test_a_shared_column_beside_several(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("u [mm];A [N];B [N]\n1;2;3\n4;5;6\n", encoding="utf-8")
    found = read_table(path, {"displacement": "u", "force": ["A", "B"]}, wide=True)
    assert tuple(found.labels) == ("A", "A", "B", "B")
    np.testing.assert_array_equal(found.columns["displacement"], [1, 4, 1, 4])
    np.testing.assert_array_equal(found.columns["force"], [2, 5, 3, 6])


def test_a_gap_within_a_specimen_is_no_end_of_it(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("F [N],u [mm],F [N],u [mm]\n1,1,2,2\n1,2,,\n1,3,3,3\n", encoding="utf-8")
    with refused("u [mm]", line=3):
        read_table(path, COLUMNS, wide=True)


UNITS = {
    ("u [mm]", "F [g]"): (1.0, 9.80665e-3),
    ("u (MM)", "Load (Kg)"): (1.0, 9.80665),
    ("u [m]", "F [mN]"): (1e3, 1e-3),
    ("u (µm)", "F (kN)"): (1e-3, 1e3),
    ("u / cm", "F / gf"): (10.0, 9.80665e-3),
    ("u_m", "F_mN"): (1e3, 1e-3),
}


@pytest.mark.parametrize("head", UNITS)
def test_units_in_names(head, tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(table(";", head), encoding="utf-8")
    found = read_table(path, COLUMNS | {"force": head[1]})
    for role, values, factor in zip(COLUMNS, (U, F), UNITS[head], strict=True):
        np.testing.assert_allclose(found.columns[role], factor * np.array(values), rtol=1e-12)


def test_a_name_that_ends_like_a_unit_is_a_name():
    assert parted("F_m", "N") == ("F_m", None)
    assert parted("F_N", "N") == ("F", "N")
    assert parted("F_g", "N") == ("F_g", None)
    assert parted("Time (Sec)", "s") == ("Time", "Sec")
    assert parted("Force (avg)") == ("Force (avg)", None)
    assert parted("way [mm/s]") == ("way", "mm/s")
    assert size_of("mm/s", "mm") is None and size_of("g", "mm") is None


def test_columns_by_number_need_no_header(tmp_path):
    path = tmp_path / "data.txt"
    path.write_text(
        "a test of 1944\n7 8\na note\n    0.0255    1.0200\n    0.1344    1.1250\n", encoding="utf-8"
    )
    found = read_table(path, {"stress": 1, "stretch": 2}, {"stress": "MPa"})
    np.testing.assert_array_equal(found.columns["stretch"], [1.02, 1.125])
    np.testing.assert_array_equal(found.columns["stress"], [0.0255, 0.1344])
    assert list(found.lines) == [4, 5]


def test_lines_and_labels(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("about\nrep;u [mm];F [N]\nA;1;2\n\nB;3;4\n", encoding="utf-8")
    found = read_table(path, {**COLUMNS, "repetition": "rep"})
    assert tuple(found.labels) == ("A", "B") and list(found.lines) == [3, 5]


def test_a_measured_unit_of_another_kind_is_no_missing_unit(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(table(head=("u [mm/s]", "F [N]")), encoding="utf-8")
    with refused("u [mm/s]", value="mm/s", line=1):
        read_table(path, COLUMNS)
    assert read_table(path, COLUMNS, {"displacement": "mm"}).notes


def test_blanks_only_where_they_are_allowed(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("x [mm];u_x [mm]\n1;\n2;nan\n3;0.5\n", encoding="utf-8")
    columns = {"x": "x", "u_x": "u_x"}
    found = read_table(path, columns, blanks=("u_x",)).columns["u_x"]
    np.testing.assert_array_equal(found, [np.nan, np.nan, 0.5])
    with refused("u_x [mm]", line=2):
        read_table(path, columns)


def test_a_file_is_only_read(tmp_path):
    path = tmp_path / "data.csv"
    path.write_bytes(table().encode())
    path.chmod(0o444)
    before = hashlib.sha256(path.read_bytes()).hexdigest()
    read_table(path, COLUMNS)
    assert hashlib.sha256(path.read_bytes()).hexdigest() == before
    assert [p.name for p in tmp_path.iterdir()] == ["data.csv"]
