"""What a run leaves behind: files that read back as written, pictures that show what they claim."""

from __future__ import annotations

import json
import os
import xml.etree.ElementTree as ET
from dataclasses import replace

import matplotlib.image
import meshio
import numpy as np
import pytest
from skfem import MeshTri

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import math_text
from cutbench.base.files import check_writable, replacing
from cutbench.case.case import load_case
from cutbench.run.figures import plot_curve, plot_section, save
from cutbench.run.figures.curve import smooth_force
from cutbench.run.figures.section import blade_outline, split
from cutbench.run.files import describe, read_curve, read_run, write_curve, write_fields, write_run
from cutbench.run.result import Outcome, Result, Snapshot, ledger_entries, ordered_columns


def made_up_curve(n=600, depth=21.0, seed=1):
    """A curve with an elastic rise, a drop at 4.2 mm, then a linear rise; ledger exact, steps uneven."""
    rng = np.random.default_rng(seed)
    d = np.concatenate(([0.0], np.cumsum(rng.uniform(0.2, 1.8, n - 1))))
    d *= depth / d[-1]
    cut = np.clip((d - 4.2) / 0.9, 0, 1)
    length = np.where(d > 4.2, (d - 4.2) * 0.93 + 1.2 * cut, 0.0)
    stored = 0.06 * np.minimum(d, 4.2) ** 2.4 * (1 - 0.55 * cut) + 0.01 * np.maximum(d - 4.2, 0)
    work = {
        "neo_hookean": stored,
        "volumetric": 0.002 * stored,
        "smith_ferrante": 0.159 * length,
        "viscous_degraded": 0.19 * length,
        "contact": 0 * d,
        "coulomb": 0.001 * length,
        "adhesion": 0.024 * length**2,
        "snap": 0.5 * cut,
    }
    total = sum(work.values())
    forces = {m: np.gradient(w, d) + rng.normal(0, 0.02, n) for m, w in work.items()}
    curve = {"closure": np.full(n, 1e-4), "reaction_N": np.gradient(total, d), "displacement_mm": d,
             "force_N": np.gradient(total, d), "time_s": d / 0.021, "cut_length_mm": length}  # fmt: skip
    for m, value in work.items():
        curve[f"work_{m}_mJ"] = value
        curve[f"force_{m}_N"] = forces[m]
    return curve


def made_up_snapshot(travel=6.0, quadratic=True, W=30.0, H=21.0, a=0.35, b=1.05):
    """A half block that gives way to the blade: invented, but smooth and cut down to the tip."""
    x = 15 * np.linspace(0, 1, 19) ** 1.8
    mesh = MeshTri.init_tensor(x, np.linspace(0, H, 37))
    p, cells = mesh.p, mesh.t.T
    if quadratic:
        # scikit-fem numbers a triangle's facets 01, 12, 02: meshio's order of the midsides.
        p = np.column_stack([p, mesh.p[:, mesh.facets].mean(axis=1)])
        cells = np.column_stack([cells, mesh.t2f.T + mesh.nvertices])
    X, Y = p
    tip = H - travel
    above = np.clip((Y - tip) / b, 0, 1)
    push = a * np.sqrt(1 - (1 - above) ** 2) * np.exp(-X / 4)
    bulge = 0.3 * np.exp(-((X - 4) ** 2) / 12) * np.exp(-(((Y - H) / 5) ** 2)) * Y / H
    u = np.column_stack([push, bulge - 0.8 * above * np.exp(-X / 1.5) * 0.5, 0 * X])
    r = np.hypot(X, Y - tip)
    mises = 0.03 / (1 + (r / 1.5) ** 1.2)
    n = len(X)
    s = np.linspace(0.1, H - 0.1, 80)
    face = np.column_stack([0 * s, s, 0 * s])
    moved = face + np.column_stack(
        [a * np.sqrt(np.clip(1 - (1 - np.clip((s - tip) / b, 0, 1)) ** 2, 0, 1)), 0 * s, 0 * s]
    )
    cut = {"X": face, "x": moved, "opening_mm": 2 * (moved - face)[:, 0], "damage": (s > tip) * 1.0,
           "contact_pressure_MPa": 0.2 * np.exp(-((s - tip) ** 2)), "tangential_traction_MPa": 0.01 * face,
           "contact_state": (s > tip).astype(int), "touched": (s > tip).astype(int)}  # fmt: skip
    top = {key: value[:5] for key, value in cut.items() if key not in ("opening_mm", "damage")}
    return Snapshot(travel, np.column_stack([X, Y, 0 * X]), cells, "triangle6" if quadratic else "triangle",
                    {"displacement": u, "piola": np.arange(9.0) * np.ones((n, 9)), "cauchy": np.ones((n, 9)),
                     "von_mises": mises}, {"cut": cut, "top": top})  # fmt: skip


@pytest.fixture(scope="module")
def case():
    return load_case("gelatin")


@pytest.fixture
def result(case):
    return Result(
        case=case,
        curve=made_up_curve(),
        outcome=Outcome("done", "reached 21 mm.", "", 21.0),
        timings={"assembly": 1.25},
        counts={"steps": 600, "iterations": np.int64(1800)},
        snapshots=[made_up_snapshot(3.0), made_up_snapshot(6.0), made_up_snapshot(np.float64(12.0))],
        measures={"onset_mm": 4.2, "peak_mm": 4.18, "peak_N": 1.06, "drop_rel": np.nan},
    )


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
    with pytest.raises(BadInput, match=r"curve\.csv"):
        read_curve(tmp_path)


def test_a_run_leaves_all_its_files_and_nothing_else(tmp_path, result):
    paths = write_run(result, tmp_path / "new" / "run", command="cutbench run2d gelatin")
    out = tmp_path / "new" / "run"
    assert {p.name for p in out.iterdir()} == {
        "run.json", "curve.csv", "fields", "fields.pvd", "faces.pvd", "curve.png", "section.png",
    }  # fmt: skip
    record = json.loads((out / "run.json").read_text())
    assert set(record["files"]) | {"fields"} == {p.name for p in out.iterdir()}
    assert record["reproduce"]["command"] == "cutbench run2d gelatin"
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
    with pytest.raises(BadInput, match=r"run\.json"):
        read_run(tmp_path)


def test_a_second_run_in_the_folder_leaves_no_fields_of_the_first(tmp_path, result):
    write_run(result, tmp_path)
    write_run(replace_snapshots(result, result.snapshots[:1]), tmp_path)
    assert sorted(p.name for p in (tmp_path / "fields").iterdir()) == ["faces_0000.vtu", "fields_0000.vtu"]
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
    with pytest.raises(BadInput, match="--out") as caught:
        check_writable(path)
    assert caught.value.exit_code == 2 and str(path) in str(caught.value)


def test_smoothing_keeps_the_work_and_does_not_see_the_steps():
    at = np.linspace(1, 9, 50)
    coarse, fine = (
        np.linspace(0, 10, 11),
        np.sort(np.append(np.linspace(0, 10, 11), np.random.default_rng(0).uniform(0, 10, 90))),
    )
    work = np.cumsum(np.random.default_rng(1).normal(size=11))
    a = smooth_force(coarse, work, 0.7, at)
    b = smooth_force(fine, np.interp(fine, coarse, work), 0.7, at)
    np.testing.assert_allclose(a, b, atol=1e-12)
    np.testing.assert_allclose(smooth_force(coarse, 3 * coarse, 0.7, np.array([0.0, 5, 10])), 3)


def test_split_stacks_to_the_force(result):
    """Areas above zero minus areas below it are the force: nothing is hidden, nothing drawn twice."""
    axes = plot_curve(result).axes[1]
    height = np.zeros(2)
    at = 10.0
    for area in axes.collections:
        at_edge = [
            v[:, 1]
            for v in (p.vertices[np.abs(p.vertices[:, 0] - at) < 0.014] for p in area.get_paths())
            if len(v)
        ]
        if at_edge:
            height[0] = max(height[0], np.concatenate(at_edge).max())
            height[1] = min(height[1], np.concatenate(at_edge).min())
    total = next(line for line in axes.lines if line.get_label() == "force on the blade")
    assert height.sum() == pytest.approx(np.interp(at, *total.get_data()), rel=0.02)


def test_released_energy_lies_below_zero(result):
    axes = plot_curve(result).axes[1]
    lowest = min(p.vertices[:, 1].min() for area in axes.collections for p in area.get_paths())
    released = -np.diff(result.curve["work_neo_hookean_mJ"]).min()
    assert released > 0 and lowest < -0.3


def test_curve_picture_marks_onset_peak_and_a_run_that_fell_short(result):
    short = replace(result, outcome=Outcome("stalled", "step below 1e-4 mm.", "smaller h", 9.5))
    texts = [t.get_text() for t in plot_curve(short).axes[0].get_legend().get_texts()]
    assert [t.split(",")[0] for t in texts] == ["onset of cutting", "peak", "stalled at 9.50 mm"]
    assert len(plot_curve(result).axes[0].get_legend().get_texts()) == 2


def test_curve_picture_of_a_single_point(case):
    curve = {name: values[:1] for name, values in made_up_curve(20).items()}
    save_nothing = plot_curve(Result(case, curve, Outcome("failed", "no first step.")))
    assert len(save_nothing.axes) == 2


def test_section_shows_both_halves_and_the_blade(result):
    figure = plot_section(result, result.snapshots[1])
    whole, near = figure.axes[:2]
    x = np.concatenate([p.vertices[:, 0] for c in whole.collections for p in c.get_paths()])
    assert x.min() == pytest.approx(-x.max()) and x.max() > 14.9
    assert near.get_ylim()[0] < 21 - 6.0 < near.get_ylim()[1]


def test_blade_tip_is_at_height_minus_travel(case):
    outline = blade_outline(case.p, 6.0, 25.0)
    assert outline[:, 1].min() == pytest.approx(case.p.height - 6.0)
    assert np.abs(outline[:, 0]).max() == pytest.approx(case.p.thickness / 2)
    assert outline[:, 1].max() == 25.0


def test_split_triangles_fill_the_same_area():
    snapshot = made_up_snapshot()

    def area(cells):
        a, b, c = (snapshot.points[cells[:, i], :2] for i in range(3))
        u, v = b - a, c - a
        return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() / 2

    assert area(split(snapshot.cells)) == pytest.approx(15 * 21)
    assert len(split(snapshot.cells)) == 4 * len(snapshot.cells)


def test_section_needs_plane_snapshots(result):
    with pytest.raises(ValueError, match="snapshots_mm"):
        plot_section(replace(result, snapshots=[]))
    with pytest.raises(ValueError, match="plane"):
        plot_section(result, replace(result.snapshots[0], cell_type="tetra"))


def test_pictures_are_300_dpi_and_come_in_other_formats(tmp_path, result):
    written = save(plot_curve(result), tmp_path / "curve.png", also=("svg", "pdf"))
    assert [p.suffix for p in written] == [".png", ".svg", ".pdf"]
    width = matplotlib.image.imread(written[0]).shape[1]
    assert width == pytest.approx(85 / 25.4 * 300, abs=2)
    assert written[2].read_bytes()[:5] == b"%PDF-"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["curve.pdf", "curve.png", "curve.svg"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("mu", r"$\mu$"),
        ("b/a", "$b/a$"),
        ("eta_reg v/delta_c", r"$\eta_{\mathrm{reg}}\,v/\delta_{\mathrm{c}}$"),
    ],
)
def test_groups_are_set_in_greek(text, shown):
    assert math_text(text) == shown


def test_an_outcome_is_one_of_four():
    with pytest.raises(ValueError, match="crashed"):
        Outcome("crashed", "")
