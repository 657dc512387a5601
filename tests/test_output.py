"""What a run leaves behind: files that read back as written, pictures that show what they claim."""

from __future__ import annotations

import json
import os
import shlex
import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import numpy as np
import pytest
from made_up_runs import made_up_curve, made_up_result, made_up_snapshot
from refusals import refused

from cutbench.base.errors import BadInput
from cutbench.base.files import check_writable, replacing
from cutbench.case.case import load_case
from cutbench.run.files import describe, read_curve, read_run, write_curve, write_run
from cutbench.run.paraview import write_fields
from cutbench.run.result import Outcome, ledger_entries, ordered_columns


@pytest.fixture(scope="module")
def case():
    return load_case("gelatin")


@pytest.fixture
def result(case):
    return made_up_result(case)


def test_columns_come_in_the_stated_order():
    names = ordered_columns(made_up_curve(20))
    assert names[:4] == ["displacement_mm", "force_N", "time_s", "cut_length_mm"]
    assert names[4:6] == ["force_neo_hookean_N", "force_volumetric_N"]
    assert names[12:14] == ["work_neo_hookean_mJ", "work_volumetric_mJ"]
    assert names[-2:] == ["reaction_N", "closure"]


def test_ledger_entries_leave_out_the_totals():
    assert ledger_entries(["force_N", "reaction_N", "work_snap_mJ", "force_snap_N", "force_coulomb_N"]) == (
        "snap",
        "coulomb",
    )


def test_curve_reads_back_to_the_last_bit(tmp_path):
    curve = made_up_curve(50)
    curve["force_N"][3] = 0.1 + 0.2
    write_curve(curve, tmp_path / "curve.csv")
    back = read_curve(tmp_path)
    assert set(back) == set(curve)
    for name in curve:
        np.testing.assert_array_equal(back[name], curve[name])


@pytest.mark.parametrize(
    ("text", "key", "line"),
    [
        ("time_s,force_N\n0,0\n", "header", 1),
        ("", "header", 1),
        ("displacement_mm,force_N,force_N\n", "header", 1),
        ("displacement_mm,force_N\n0,0\n1\n", "row", 3),
        ("displacement_mm,force_N\n0,zero\n", "force_N", 2),
    ],
)
def test_bad_curve_names_file_line_and_key(tmp_path, text, key, line):
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(BadInput) as caught:
        read_curve(path)
    assert (caught.value.key, caught.value.line, caught.value.file) == (key, line, str(path))


def test_missing_curve_is_bad_input(tmp_path):
    with refused("curve", hint="curve.csv"):
        read_curve(tmp_path)


def test_a_run_leaves_all_its_files_and_nothing_else(tmp_path, result):
    paths = write_run(result, tmp_path / "new" / "run", command="cutbench run2d gelatin")
    out = tmp_path / "new" / "run"
    assert {p.name for p in out.iterdir()} == {
        "run.json", "curve.csv", "fields", "fields.pvd", "faces.pvd", "blade.pvd", "curve.png", "section.png",
    }  # fmt: skip
    record = json.loads((out / "run.json").read_text())
    assert set(record["files"]) | {"fields"} == {p.name for p in out.iterdir()}
    assert shlex.split(record["reproduce"]["command"]) == ["cutbench", "run2d", "gelatin"]
    assert paths["run"] == out / "run.json"


def test_run_json_keeps_inputs_with_units_and_groups(result):
    record = json.loads(json.dumps(describe(result), allow_nan=False))
    assert record["id"] == result.case.id
    assert "kPa" in json.dumps(record["case"])
    assert record["groups"]["(G_c/delta_c)/G"] == pytest.approx(10.1, rel=2e-2)
    assert record["outcome"] == {
        "kind": "done",
        "message": "reached 21 mm.",
        "advice": "",
        "reached_mm": 21.0,
    }
    assert record["measures"]["drop_rel"] is None, "JSON has no nan"
    assert record["counts"]["iterations"] == 1800
    assert record["versions"]["numpy"] == np.__version__


def test_a_run_reads_back(tmp_path, result):
    write_run(result, tmp_path)
    back = read_run(tmp_path)
    assert back.case.id == result.case.id
    assert back.outcome == result.outcome
    assert np.isnan(back.measures["drop_rel"]) and back.measures["onset_mm"] == 4.2
    assert back.counts == result.counts and back.timings == result.timings
    np.testing.assert_array_equal(back.force_N, result.force_N)


@pytest.mark.parametrize("text", ["", "{}", '{"case": 3}', "[1]"])
def test_a_broken_run_json_is_bad_input(tmp_path, text):
    (tmp_path / "run.json").write_text(text)
    with refused("run", hint="run.json"):
        read_run(tmp_path)


@pytest.mark.slow
def test_a_second_run_in_the_folder_leaves_no_fields_of_the_first(tmp_path, result):
    write_run(result, tmp_path)
    write_run(replace_snapshots(result, result.snapshots[:1]), tmp_path)
    assert {p.name for p in (tmp_path / "fields").iterdir()} == {
        "blade_0000.vtu", "faces_0000.vtu", "fields_0000.vtu",
    }  # fmt: skip
    write_run(replace_snapshots(result, []), tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"run.json", "curve.csv", "curve.png"}


def replace_snapshots(result, snapshots):
    return replace(result, snapshots=snapshots)


@pytest.mark.parametrize("quadratic", [False, True])
def test_fields_read_back_with_units_in_their_names(tmp_path, quadratic):
    snapshot = made_up_snapshot(quadratic=quadratic)
    write_fields([snapshot], tmp_path)
    body = meshio.read(tmp_path / "fields" / "fields_0000.vtu")
    assert body.cells[0].type == snapshot.cell_type
    np.testing.assert_array_equal(body.cells[0].data, snapshot.cells)
    np.testing.assert_array_equal(body.point_data["displacement_mm"], snapshot.point_data["displacement"])
    np.testing.assert_array_equal(body.point_data["von_mises_MPa"], snapshot.point_data["von_mises"])
    assert body.point_data["piola_MPa"].shape == (len(snapshot.points), 9)


def test_faces_carry_contact_and_damage_where_they_have_them(tmp_path):
    snapshot = made_up_snapshot()
    write_fields([snapshot], tmp_path)
    faces = meshio.read(tmp_path / "fields" / "faces_0000.vtu")
    cut, top = snapshot.faces["cut"], snapshot.faces["top"]
    n = len(cut["X"])
    assert len(faces.points) == n + len(top["X"])
    data = faces.point_data
    np.testing.assert_array_equal(data["face"], [0] * n + [1] * len(top["X"]))
    np.testing.assert_array_equal(data["contact_pressure_MPa"][n:], top["contact_pressure_MPa"])
    np.testing.assert_array_equal(data["damage"][:n], cut["damage"])
    assert np.isnan(data["damage"][n:]).all(), "the top face has no damage"
    np.testing.assert_allclose(
        faces.points + data["displacement_mm"], np.vstack([cut["x"], top["x"]]), atol=1e-14
    )
    assert data["tangential_traction_MPa"].shape[1] == 3


def test_series_holds_travel_as_time_and_files_that_exist(tmp_path, result):
    write_fields(result.snapshots, tmp_path)
    for kind in ("fields", "faces"):
        sets = ET.parse(tmp_path / f"{kind}.pvd").getroot().findall("Collection/DataSet")
        assert [float(s.get("timestep")) for s in sets] == [3.0, 6.0, 12.0]
        assert all((tmp_path / s.get("file")).is_file() for s in sets)


def test_a_series_that_goes_back_and_forth_is_over_the_time(tmp_path):
    back = [replace(made_up_snapshot(mm), time_s=s) for mm, s in ((3.0, 10.0), (6.0, 20.0), (6.0, 35.0))]
    write_fields(back, tmp_path)
    sets = ET.parse(tmp_path / "fields.pvd").getroot().findall("Collection/DataSet")
    assert [float(s.get("timestep")) for s in sets] == [10.0, 20.0, 35.0]


def test_a_writer_that_fails_leaves_the_old_file_and_no_litter(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(RuntimeError), replacing(target) as draft:
        draft.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_check_writable_makes_the_folder_and_leaves_it_empty(tmp_path):
    out = check_writable(tmp_path / "a" / "b")
    assert out.is_dir() and not list(out.iterdir())


@pytest.mark.parametrize("kind", ["file", "below a file", "protected"])
def test_unwritable_folder_is_refused(tmp_path, kind):
    path = tmp_path / "x"
    if kind == "protected":
        if os.geteuid() == 0:
            path = "/proc/cutbench"
        else:
            path.mkdir(mode=0o500)
    else:
        path.write_text("")
        path = path / "y" if kind == "below a file" else path
    with refused("--out") as caught:
        check_writable(path)
    assert caught.value.exit_code == 2 and str(path) in str(caught.value)


def test_an_outcome_is_one_of_four():
    with pytest.raises(ValueError, match="crashed"):
        Outcome("crashed", "")
