"""Displacement fields as correlation programs write them: names of columns, points that were not found."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import tables_made as made
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.cli.main import app
from cutbench.data.campaign import load_campaign
from cutbench.data.fields import Field, read_fields

X, Y = np.linspace(-4, 4, 9), np.linspace(1, 7, 7)
#: Points that were not found: a corner in the middle.
LOST = {(i, j) for i, j in itertools.product(range(2, 5), range(3, 6))}


def moved(x, y):
    return 0.02 * x + 0.001 * x * y, -0.1 - 0.004 * y


def written(head: str, row, lost=LOST) -> str:
    """``head``, then ``row(x, y, u, v, found)`` for each point."""
    lines = [head]
    for (i, y), (j, x) in itertools.product(enumerate(Y), enumerate(X)):
        lines.append(row(x, y, *moved(x, y), (i, j) not in lost))
    return "\n".join(lines) + "\n"


def plain(mark: str = "0,0", tail=lambda found: ""):
    return lambda x, y, u, v, found: (
        f"{x:.3f},{y:.3f}," + (f"{u:.5f},{v:.5f}" if found else mark) + tail(found)
    )


def sigma(found):
    return ",0.01" if found else ",-1"


FILES = {
    "VIC": ('"X [mm]", "Y [mm]", "U [mm]", "V [mm]", "sigma"', plain(tail=sigma)),
    "VIC with pixels": (
        '"X [mm]","Y [mm]","Z [mm]","U [mm]","V [mm]","W [mm]",'
        '"x [pixel]","y [pixel]","u [pixel]","v [pixel]","sigma [pixel]"',
        lambda x, y, u, v, found: (
            f"{x},{y},0,{u},{v},0,{9 * x},{9 * y},{9 * u},{9 * v},0.01"
            if found
            else f"{x},{y},0,0,0,0,{9 * x},{9 * y},0,0,-1"
        ),
    ),
    "failed without a place": (
        "X [mm],Y [mm],U [mm],V [mm],Sigma",
        lambda x, y, u, v, found: f"{x},{y},{u},{v},0.01" if found else ",,0,0,-1",
    ),
    "failed and put at 0": (
        "X [mm],Y [mm],U [mm],V [mm],Sigma",
        lambda x, y, u, v, found: f"{x},{y},{u},{v},0.01" if found else "0,0,0,0,-1",
    ),
    "DICe": (
        "x [mm],y [mm],u_x [mm],u_y [mm],SIGMA,GAMMA",
        plain("9,9", lambda f: ",0.004,0.1" if f else ",-1,-1"),
    ),
    "valid or not": ("x [mm],y [mm],u [mm],v [mm],IsValid", plain("7,7", lambda f: f",{int(f)}")),
    "a correlation": (
        "x [mm],y [mm],u [mm],v [mm],Correlation coefficient",
        plain("7,7", lambda f: f",{0.98 * f}"),
    ),
    "nothing but zeros": ("x [mm],y [mm],u_x [mm],u_y [mm]", plain()),
    "-nan(ind)": ("x [mm],y [mm],u_x [mm],u_y [mm]", plain("-nan(ind),-nan(ind)")),
    "-1.#IND": ("x [mm],y [mm],u_x [mm],u_y [mm]", plain("-1.#IND,-1.#IND")),
    "#N/A": ("x [mm],y [mm],u_x [mm],u_y [mm]", plain("#N/A,#N/A")),
    "NaN": ("x [mm],y [mm],u_x [mm],u_y [mm]", plain("NaN,NaN")),
}


def check(field: Field, noted: bool) -> None:
    lost = np.isnan(field.u).any(axis=0)
    assert {(int(i), int(j)) for i, j in np.argwhere(lost)} == LOST
    expected = np.stack(moved(*np.meshgrid(X, Y)))
    np.testing.assert_allclose(field.u[:, ~lost], expected[:, ~lost], atol=1e-5)
    assert any("9 points" in note and "line" in note for note in field.notes) == noted


@pytest.mark.parametrize("name", FILES)
def test_points_that_were_not_found_are_left_out(tmp_path, name):
    path = tmp_path / "field.csv"
    path.write_text(written(*FILES[name]), encoding="utf-8")
    (field,) = read_fields(path, travel_mm=1.0)
    check(field, noted=name not in ("-nan(ind)", "-1.#IND", "#N/A", "NaN"))


def test_what_was_found_can_be_written(tmp_path):
    path = tmp_path / "field.csv"
    path.write_text(
        written(
            "x [mm],y [mm],u [mm],v [mm],quality,sigma", plain("7,7", lambda f: f",{0.9 if f else 0.2},0.01")
        ),
        encoding="utf-8",
    )
    (all_of_them,) = read_fields(path, travel_mm=1.0)
    assert np.isfinite(all_of_them.u).all()
    check(read_fields(path, travel_mm=1.0, valid="quality > 0.5")[0], noted=True)
    path.write_text(written(*FILES["DICe"]), encoding="utf-8")
    assert np.isfinite(read_fields(path, travel_mm=1.0, valid="none")[0].u).all()
    check(read_fields(path, travel_mm=1.0, valid="5 >= 0")[0], noted=True)
    for rule in ("quality", "quality = 0.5", "> 0.5", "quality > half"):
        with pytest.raises(BadInput) as wrong:
            read_fields(path, travel_mm=1.0, valid=rule)
        assert wrong.value.key == "valid" and wrong.value.value == rule
    with pytest.raises(BadInput):
        read_fields(path, travel_mm=1.0, valid="quality > 0.5")


def test_a_clamped_edge_and_a_field_of_zeros_were_measured(tmp_path):
    path = tmp_path / "field.csv"
    y = np.linspace(0, 8, 33)
    rows = "".join(f"{x},{b},{0.001 * x * b},{-0.01 * b}\n" for b, x in itertools.product(y, X))
    path.write_text("x [mm],y [mm],u_x [mm],u_y [mm]\n" + rows, encoding="utf-8")
    assert np.isfinite(read_fields(path, travel_mm=1.0)[0].u).all()
    rows = "".join(f"{x},{b},0,0\n" for b, x in itertools.product(y, X))
    path.write_text("x [mm],y [mm],u_x [mm],u_y [mm]\n" + rows, encoding="utf-8")
    assert not read_fields(path, travel_mm=1.0)[0].u.any()


def test_the_place_of_a_point_that_was_found_must_be_there(tmp_path):
    path = tmp_path / "field.csv"
    text = written(*FILES["VIC"])
    path.write_text(text.replace("-3.000,1.000", ",1.000", 1), encoding="utf-8")
    with pytest.raises(BadInput) as wrong:
        read_fields(path, travel_mm=1.0)
    assert wrong.value.line == 3 and wrong.value.key == "x"


def test_dic_names_columns_units_and_validity(tmp_path):
    path = tmp_path / "field.csv"
    path.write_text(written("a,b,c,d,q", plain("7,7", lambda f: f",{int(f)}")), encoding="utf-8")
    args = ["dic", "gelatin", str(path), "--travel", "0.3", "--h", "1.2", "--out", str(tmp_path / "out")]
    made.refused(args)
    named = [*args, "--columns", "x=a,y=b,u=3,v=4"]
    made.refused([*named[:-1], "x=a,y=b,u=3,w=4"])
    made.refused(named)  # 3 and 4 beside names: the unit is missing
    done = CliRunner().invoke(
        app, [*args, "--columns", "x=a,y=b,u=c,v=d", "--unit", "mm", "--valid", "q > 0"]
    )
    assert done.exit_code == 0, done.output
    assert "9 points are left out" in done.output


def test_a_campaign_says_it_in_its_fields(tmp_path):
    (tmp_path / "dic.csv").write_text(
        written("X,Y,U,V,q", plain("7,7", lambda f: f",{int(f)}")), encoding="utf-8"
    )
    u = np.linspace(0.1, 6, 40)
    cut = "u [mm],F [N]\n" + "".join(f"{a:.3f},{2 * min(a, 3) + 0.3 * a:.4f}\n" for a in u)
    fields = (
        '{ data = "dic.csv", noise = "0.01 mm", travel = "2 mm", valid = "q > 0",'
        ' columns = { x = "X", y = "Y", u_x = "U", u_y = "V" },'
        ' units = { x = "mm", y = "mm", u_x = "mm", u_y = "mm" } }'
    )
    path = made.campaign(
        tmp_path, cut, f'speed = "0.1 mm/s"\nblade = {{ thickness = "0.7 mm" }}\nfields = {fields}\n',
        kind='"cut"', columns='{ displacement = "u", force = "F" }',
        specimen='{ width = "30 mm", length = "30 mm", height = "21 mm" }',
    )  # fmt: skip
    own = path.read_text(encoding="utf-8").split("[[experiment]]")[1]
    path.write_text('material = "elastomer"\n[[experiment]]' + own, encoding="utf-8")
    (e,) = load_campaign(path).experiments
    assert np.isnan(e.fields[0].u[0]).sum() == 9
    assert any("9 points" in note for note in e.notes)
