"""Confirmation of a map in three dimensions: which points are chosen, what is compared, and the command."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.cli.main import app
from cutbench.maps import dataset as maps
from cutbench.maps.boundary import margin
from cutbench.maps.confirmation import confirm, least_certain, marked, solid
from cutbench.maps.confirmed_points import FOLDER, RECORD, read_confirmed
from cutbench.maps.dataset import MapRow, build_map, save_map
from cutbench.maps.phase import draw_phase, save_phase
from cutbench.maps.study import load_study
from cutbench.run.result import Outcome, Result

STUDY = """
title = "small"
base = "gelatin"

[specimen]
width = "6 mm"
height = "6 mm"
length = "8 mm"

[protocol]
depth = "1 mm"

[numerics]
element = "P1"
h = "1.5 mm"

[[axis]]
name = "cohesion"
values = [6.0, 8.0, 10.0, 12.0]

[regime]
drop = 0.1

[plot]
x = "cohesion"
mark = ["gelatin"]
"""


@pytest.fixture
def data(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    study = load_study(path)
    rows = {}
    for drop, (_, case) in zip((0.02, 0.09, 0.14, 0.5), study.points(), strict=True):
        found = dict.fromkeys(maps.MEASURES, 1.0) | {"drop_rel": drop}
        regime = "abrupt" if drop >= 0.1 else "smooth"
        rows[case.id] = MapRow("done", "", 1.0, regime, found)
    return build_map(study, rows)


def test_the_points_nearest_to_the_boundary_come_first(data):
    points = least_certain(data, 3)
    assert [point.at["cohesion"] for point in points] == [8.0, 10.0, 6.0]
    assert points[0].margin == pytest.approx(float(margin(0.09, 1.0, False, drop=0.1)))
    assert sorted(point.case.id for point in least_certain(data, 9)) == sorted(data["run_id"].values)
    # Without a regime there is nothing to confirm.
    data["label"].values[1] = maps.LABELS.index("not_computed")
    assert [point.at["cohesion"] for point in least_certain(data, 1)] == [10.0]


def test_the_cases_are_those_of_the_map(data):
    for point in least_certain(data, 4):
        (where,) = np.flatnonzero(data["cohesion"].values == point.at["cohesion"])
        assert point.case.id == data["run_id"].values[where]
    (material,) = marked(data)
    assert material.name == material.case.name == "gelatin"
    assert material.case.p.width == 6.0


def test_a_block_has_the_physics_of_its_section_and_a_mesh_of_its_own(data):
    point = least_certain(data, 1)[0]
    block = solid(point.case, {"h": "2 mm"})
    assert block.dim == 3 and block.numerics.h_mm == 2.0
    assert (block.mechanisms, dict(block.values)) == (point.case.mechanisms, dict(point.case.values))
    assert block.numerics.element == point.case.numerics.element
    with pytest.raises(BadInput):
        solid(point.case, {"h": "200 mm"})


def curve(drop):
    """Rises to 1 N at 0.5 mm, falls by ``drop`` and stays; the cut begins at the top."""
    d = np.array([0.0, 0.5, 0.6, 1.0])
    return {
        "displacement_mm": d,
        "force_N": np.array([0.0, 1.0, 1.0 - drop, 1.0 - drop]),
        "time_s": d,
        "cut_length_mm": np.array([0.0, 0.0, 0.5, 0.6]),
    }


def test_agreement_is_by_label_and_what_is_there_is_not_computed_again(data, tmp_path):
    drops = {2: 0.5, 3: 0.3}
    calls = []

    def run(case, folder):
        from cutbench.run.files import write_run

        calls.append(case.dim)
        result = Result(case, curve(drops[case.dim]), Outcome("done", "", "", 1.0), {"total": 2.0})
        write_run(result, folder, command="test")
        return result

    points = least_certain(data, 2)
    done = confirm(data, points, tmp_path, run, source="map.nc")
    assert calls == [2, 3, 2, 3] and [point.agrees for point in done] == [True, True]
    assert done[0].ratio["steady_N"] == pytest.approx(0.7 / 0.5)
    assert done[0].ratio["peak_N"] == pytest.approx(1.0)
    record = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))
    assert (record["agree"], record["judged"], record["compared"]) == (2, 2, 2)
    assert record["points"][0]["at"] == {"cohesion": 8.0}
    assert record["axes"] == {"cohesion": "1"}
    confirm(data, points, tmp_path, run, source="map.nc")
    assert len(calls) == 4
    drops[3] = 0.0
    other = confirm(data, points[:1], tmp_path / "other", run, source="map.nc")
    assert other[0].agrees is False and other[0].label_3d == "smooth"


def test_an_interruption_keeps_what_was_compared_and_a_stall_is_not_judged(data, tmp_path):
    kinds = iter(["done", "stalled", "done", "interrupted"])

    def run(case, folder):
        return Result(case, curve(0.5), Outcome(next(kinds), "", "", 1.0), {"total": 1.0})

    done = confirm(data, least_certain(data, 3), tmp_path, run, source="map.nc")
    assert len(done) == 1 and done[0].agrees is None and done[0].label_3d is None
    record = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))
    assert (record["asked"], record["compared"], record["judged"]) == (3, 1, 0)


def test_the_command_runs_a_point(data, tmp_path):
    save_map(data, tmp_path)
    options = ["--points=1", "--no-materials", f"--out={tmp_path / 'c'}"]
    done = CliRunner().invoke(app, ["confirm", str(tmp_path / "map.nc"), *options])
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "c" / RECORD).read_text(encoding="utf-8"))
    (point,) = record["points"]
    assert point["outcome_3d"] == "done" and point["label_2d"] is not None
    assert math.isfinite(point["wall_s"])
    assert "1 of 1 points compared" in done.output
    assert (tmp_path / "c" / "phase.png").is_file() and not (tmp_path / "phase.png").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--points=few"], "--points = 'few'"),
        (["--points=0", "--no-materials"], "--points = '0'"),
        (["--h=soft"], "h = 'soft'"),
    ],
)
def test_bad_input_is_one_message(data, tmp_path, options, says):
    save_map(data, tmp_path)
    done = CliRunner().invoke(app, ["confirm", str(tmp_path / "map.nc"), *options])
    assert done.exit_code == 2 and says in done.output and "Traceback" not in done.output


def test_a_file_that_is_no_map_is_refused(tmp_path):
    (tmp_path / "map.nc").write_text("nothing")
    done = CliRunner().invoke(app, ["confirm", str(tmp_path / "map.nc")])
    assert done.exit_code == 2 and "map" in done.output


# -- marks in the phase diagram ------------------------------------------------------------------


def recorded(path, *points):
    """A record of (at, agrees) as ``confirm`` leaves it."""
    found = [{"at": at, "agrees": agrees, "two": {"drop_rel": 0.2}} for at, agrees in points]
    path.write_text(json.dumps({"schema": 1, "points": found}), encoding="utf-8")
    return path


def plane(tmp_path):
    """A map of cohesion and viscosity at two levels of adhesion."""
    text = STUDY + "\n".join(
        f"[[axis]]\nname = '{name}'\nvalues = {values}"
        for name, values in (("viscosity", [0.1, 1.0]), ("adhesion", [0.0, 0.1]))
    )
    path = tmp_path / "plane.toml"
    path.write_text(text.replace('x = "cohesion"', 'x = "cohesion"\ny = "viscosity"'), encoding="utf-8")
    study = load_study(path)
    found = dict.fromkeys(maps.MEASURES, 0.2)
    return build_map(study, {case.id: MapRow("done", "", 1.0, "abrupt", found) for case in study.cases()})


def marks_on(axes):
    """(place, agrees) of what is marked."""
    squares = [line for line in axes.lines if line.get_markersize() == 9.0]
    return [(float(m.get_xdata()[0]), float(m.get_ydata()[0]), m.get_marker() == "s") for m in squares]


def test_confirmed_points_are_marked_on_their_panel_and_by_whether_they_agree(tmp_path):
    data = plane(tmp_path)
    one = {"cohesion": 8.0, "viscosity": 0.1, "adhesion": 0.0}
    two = {"cohesion": 10.0, "viscosity": 1.0, "adhesion": 0.1}
    far = {"cohesion": 900.0, "viscosity": 1.0, "adhesion": 0.1}
    path = recorded(tmp_path / RECORD, (one, True), (two, False), (far, True))
    figure = draw_phase(data, read_confirmed(path, data))
    first, second = (ax for ax in figure.axes if ax.get_label() != "<colorbar>")
    assert marks_on(first) == [(8.0, 0.1, True)]
    assert marks_on(second) == [(10.0, 1.0, False)]
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"3D: the same", "3D: another"} <= set(words) and "3D: not to its end" not in words


def test_on_a_map_of_one_axis_they_stand_at_their_drop(data, tmp_path):
    path = recorded(tmp_path / RECORD, ({"cohesion": 8.0}, None))
    figure = draw_phase(data, read_confirmed(path, data))
    assert marks_on(figure.axes[0]) == [(8.0, 0.2, True)]
    assert not marks_on(draw_phase(data).axes[0])


def test_the_diagram_takes_the_record_beside_the_map(data, tmp_path):
    (tmp_path / FOLDER).mkdir()
    recorded(tmp_path / FOLDER / RECORD, ({"cohesion": 8.0}, True))
    assert "3D: the same" in save_phase(data, tmp_path)[1].read_text(encoding="utf-8")


def test_a_record_of_another_map_has_no_marks_and_a_broken_one_is_refused(data, tmp_path):
    path = recorded(tmp_path / RECORD, ({"viscosity": 8.0}, True))
    assert read_confirmed(path, data) == [] == read_confirmed(tmp_path / "none" / RECORD, data)
    path.write_text("{}", encoding="utf-8")
    with pytest.raises(BadInput, match="cutbench confirm"):
        read_confirmed(path, data)
