"""Confirmation of a map in three dimensions: which points are chosen, what is compared, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import confirm_jobs
import numpy as np
import pytest
from refusals import refused
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.cli.main import app
from cutbench.maps import dataset as maps
from cutbench.maps.boundary import margin
from cutbench.maps.confirmation import (
    block_case,
    confirm,
    least_certain,
    marked_points,
    resolved_points,
    section_as_block,
)
from cutbench.maps.dataset import MapRow, build_map, save_map
from cutbench.maps.markers import FOLDER, RECORD, read_confirmed
from cutbench.maps.phase import draw_phase, save_phase
from cutbench.maps.study import load_study
from cutbench.run.block_cost import expected_seconds, layer_zones
from cutbench.run.files import write_run
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

COARSE = {"h": "2 mm", "corner": 1.0}


def mapped(tmp_path, text):
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    study = load_study(path)
    rows = {}
    for drop, (_, case) in zip((0.02, 0.09, 0.14, 0.5), study.points(), strict=True):
        found = dict.fromkeys(maps.MEASURES, 1.0) | {"drop_rel": drop}
        regime = "abrupt" if drop >= 0.1 else "smooth"
        rows[case.id] = MapRow("done", "", 1.0, regime, found)
    return build_map(study, rows)


@pytest.fixture
def data(tmp_path):
    return mapped(tmp_path, STUDY)


@pytest.fixture
def short(tmp_path):
    """With a blade so short that two layers along half of it are 0.25 mm thick."""
    return mapped(tmp_path, STUDY.replace('length = "8 mm"', 'length = "1 mm"'))


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
    (material,) = marked_points(data)
    assert material.name == material.case.name == "gelatin"
    assert material.case.p.width == 6.0


def test_points_are_chosen_whose_zone_the_layers_resolve_and_what_is_not_is_said(short):
    # The zone is e² 4 δ_c/cohesion, 0.345 and 0.259 mm at 6 and 8, less at 10 and 12.
    points, said = resolved_points(short, 3, True)
    assert [point.at["cohesion"] for point in points] == [8.0, 6.0]
    assert layer_zones(block_case(points[0].case)) == pytest.approx(
        0.25 * 8 / (4 * math.e**2 * 0.07), rel=0.02
    )
    assert len(said) == 2 and said[0].startswith("cohesion = 10") and "1.2 cohesive zones" in said[0]
    # Where the material is not resolved, the run nearest to it stands in: here one of the line itself.
    assert said[1].startswith("gelatin") and said[1].endswith(points[0].name)
    points, said = resolved_points(short, 3, True, {"layers": 4})
    assert [point.name for point in points][-1] == "gelatin" and len(points) == 4 and not said


def test_where_no_layers_resolve_a_zone_it_is_said_how_many_would(data):
    with refused("layers", value=2, hint="layers=12"):
        resolved_points(data, 3, True)
    # As many do, and one less does not.
    points, _ = resolved_points(data, 3, False, {"layers": 12})
    assert [point.at["cohesion"] for point in points] == [6.0]
    with refused("layers", value=11, hint="layers=12"):
        resolved_points(data, 3, False, {"layers": 11})


def test_a_block_is_judged_by_its_middle_as_a_long_blade(data, tmp_path):
    # The ends hold the force of the whole up, and ligaments are left; the middle falls as the sections do.
    whole = runner({"2D": 0.5, "like": 0.4, "3D": 0.0}, [], bridged=0.3)

    def run(case, folder):
        result = whole(case, folder)
        if case.dim == 3:
            middle = {f"middle_{name}": curve(0.3)[name] for name in ("force_N", "cut_length_mm")}
            result.curve.update(middle)
        return result

    (point,) = confirm(data, least_certain(data, 1), tmp_path, run, source="map.nc")
    assert point.verdict == "confirmed" and point.label_3d == "abrupt"
    assert 0.1 < point.middle["drop_rel"] <= 0.3 and point.three["drop_rel"] < 1e-9
    (record,) = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))["points"]
    assert record["layer_zones"] == pytest.approx(layer_zones(block_case(least_certain(data, 1)[0].case)))


def test_a_block_has_the_physics_of_its_section_and_a_mesh_of_its_own(data):
    point = least_certain(data, 1)[0]
    block = block_case(point.case, {"h": "2 mm"})
    assert block.dim == 3 and block.sizes.h_mm == 2.0
    assert (block.mechanisms, dict(block.values)) == (point.case.mechanisms, dict(point.case.values))
    assert block.numerics.element == point.case.numerics.element
    with pytest.raises(BadInput):
        block_case(point.case, {"h": "200 mm"})


def curve(drop):
    """Rises to 1 N at 0.5 mm, falls by ``drop`` and stays; the cut begins at the top."""
    d = np.array([0.0, 0.5, 0.6, 1.0])
    return {
        "displacement_mm": d,
        "force_N": np.array([0.0, 1.0, 1.0 - drop, 1.0 - drop]),
        "time_s": d,
        "cut_length_mm": np.array([0.0, 0.0, 0.5, 0.6]),
    }


def test_a_section_with_the_blocks_numerics_stands_between(data):
    flat = least_certain(data, 1)[0].case
    block = block_case(flat, {"h": "2 mm", "depth": "0.8 mm", "tilt": "1 deg"})
    like = section_as_block(flat, block)
    assert like.dim == 2 and like.p.depth == 0.8 and like.p.tilt == 0.0
    assert like.numerics == replace(block.numerics, symmetry="auto")
    assert like.mechanisms == flat.mechanisms


#: Where a run's time goes.
SPENT = {"assembly": 0.5, "factorization": 1.0, "solve": 0.2, "residual": 0.1, "window_assembly": 0.1}
CALLS = {"assembly_calls": 5, "factorization_calls": 5, "solve_calls": 9, "residual_calls": 9}


def test_quick_blocks_have_one_layer(data):
    assert block_case(least_certain(data, 1)[0].case, {"numerics": "fast"}).numerics.layers == 1


def runner(drops, calls, outcomes=None, bridged=0.0):
    """Leaves curves that fall by ``drops``, by "2D", "like" and "3D", and says in ``calls`` which. Blocks
    have ligaments along a part ``bridged`` of the blade."""

    def run(case, folder):
        kind = "3D" if case.dim == 3 else "like" if case.name.endswith("(as the block)") else "2D"
        calls.append(kind)
        outcome = Outcome((outcomes or {}).get(kind, "done"), "", "", 1.0)
        result = Result(
            case, curve(drops[kind]), outcome, {"total": 2.0, **SPENT}, {"iterations": 3, **CALLS}
        )
        if kind == "3D":
            result.measures["front_bridged"] = bridged
        write_run(result, folder, command="test")
        return result

    return run


@pytest.mark.parametrize(
    ("drops", "verdict"),
    [
        ({"2D": 0.5, "like": 0.4, "3D": 0.3}, "confirmed"),
        ({"2D": 0.0, "like": 0.0, "3D": 0.0}, "confirmed"),
        ({"2D": 0.5, "like": 0.4, "3D": 0.0}, "another"),
        # The block agrees with the map, but so it would with any tooth of its own mesh.
        ({"2D": 0.0, "like": 0.4, "3D": 0.0}, "numerics"),
        ({"2D": 0.0, "like": 0.4, "3D": 0.4}, "numerics"),
    ],
)
def test_a_block_confirms_only_where_the_sections_agree(data, tmp_path, drops, verdict):
    (point,) = confirm(data, least_certain(data, 1), tmp_path, runner(drops, []), source="map.nc")
    assert point.verdict == verdict
    record = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))
    assert record[verdict] == record["compared"] == 1 and record["points"][0]["verdict"] == verdict


@pytest.mark.parametrize(("drop", "verdict"), [(0.0, "numerics"), (0.3, "confirmed")])
def test_a_block_that_its_layers_hold_up_tells_only_that_the_force_falls(data, tmp_path, drop, verdict):
    run = runner({"2D": 0.5, "like": 0.4, "3D": drop}, [], bridged=0.3)
    (point,) = confirm(data, least_certain(data, 1), tmp_path, run, source="map.nc")
    assert point.verdict == verdict


def test_a_blocks_cost_grows_with_its_sections_calls_and_is_unknown_without(data):
    block = block_case(least_certain(data, 1)[0].case, {"h": "2 mm", "corner": 1.0, "layers": 1})
    column = curve(0.1)

    def expected(times):
        spent = {name: times * seconds for name, seconds in SPENT.items()}
        counts = {name: times * calls for name, calls in CALLS.items()}
        return expected_seconds(block, Result(block, column, Outcome("done", "", "", 1.0), spent, counts))

    # What a clock says is the machine's.
    assert 30 < expected(1000) / expected(1) < 30_000
    assert math.isnan(expected_seconds(block, Result(block, column, Outcome("done", "", "", 1.0), {}, {})))


def test_what_is_there_is_not_computed_again_and_ratios_are_at_equal_numerics(data, tmp_path):
    calls, said = [], []
    points = least_certain(data, 2)
    run = runner({"2D": 0.5, "like": 0.4, "3D": 0.3}, calls)
    done = confirm(data, points, tmp_path, run, source="map.nc", changes=COARSE, announce=said.append)
    assert calls == ["2D", "like"] * 2 + ["3D"] * 2
    assert done[0].ratio["onset_mm"] == pytest.approx(1.0)
    assert done[0].ratio["peak_N"] == pytest.approx(1.0)
    # Of each block, and of all, with a number.
    assert len(said) == 3 and all("about" in text for text in said)
    record = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))
    assert record["points"][0]["at"] == {"cohesion": 8.0} and record["axes"] == {"cohesion": "1"}
    confirm(data, points, tmp_path, run, source="map.nc", changes=COARSE, announce=said.append)
    assert len(calls) == 6 and len(said) == 4


def test_an_interruption_keeps_what_was_compared_and_a_stall_is_not_judged(data, tmp_path):
    blocks = iter(["stalled", "interrupted"])

    def run(case, folder):
        kind = next(blocks) if case.dim == 3 else "done"
        return Result(case, curve(0.5), Outcome(kind, "", "", 1.0), {"total": 1.0}, {"iterations": 1})

    done = confirm(data, least_certain(data, 3), tmp_path, run, source="map.nc")
    assert len(done) == 1 and done[0].verdict == "unfinished" and done[0].label_3d is None
    record = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))
    assert (record["asked"], record["compared"], record["unfinished"]) == (3, 1, 1)


def test_a_block_that_takes_too_long_is_unfinished_and_the_next_begins(data, tmp_path):
    calls = []
    run = runner(dict.fromkeys(("2D", "like", "3D"), 0.5), calls, {"3D": "interrupted"})
    done = confirm(data, least_certain(data, 2), tmp_path, run, source="map.nc", limit_s=0.0)
    assert calls == ["2D", "like"] * 2 + ["3D"] * 2
    assert [point.verdict for point in done] == ["unfinished"] * 2


def test_sections_alone_say_what_blocks_cost(data, tmp_path):
    calls, said = [], []
    run = runner({"2D": 0.5, "like": 0.4, "3D": 0.3}, calls)
    options = {"source": "map.nc", "changes": COARSE, "announce": said.append}
    assert confirm(data, least_certain(data, 2), tmp_path, run, sections_only=True, **options) == []
    assert calls == ["2D", "like"] * 2 and len(said) == 3 and not (tmp_path / RECORD).exists()


@pytest.mark.slow
def test_several_are_run_at_once_and_stand_in_the_order_of_the_points(data, tmp_path):
    points = least_certain(data, 2)
    done = confirm(data, points, tmp_path, confirm_jobs.left, source="map.nc", changes=COARSE, workers=2)
    assert [point.name for point in done] == [point.name for point in points]
    assert [point.verdict for point in done] == ["confirmed"] * 2


@pytest.mark.slow
def test_the_command_runs_a_point_and_goes_on_with_what_its_limit_has_stopped(short, tmp_path):
    save_map(short, tmp_path)
    options = ["--points=1", "--no-materials", "--h=2", "--set=corner=1", f"--out={tmp_path / 'c'}"]
    stopped = CliRunner().invoke(app, ["confirm", str(tmp_path / "map.nc"), *options, "--limit=0 s"])
    assert stopped.exit_code == 1 and "1 unfinished" in stopped.output, stopped.output
    assert (tmp_path / "c" / "phase.png").is_file()
    done = CliRunner().invoke(app, ["confirm", str(tmp_path / "map.nc"), *options, "--limit=1 h"])
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "c" / RECORD).read_text(encoding="utf-8"))
    (point,) = record["points"]
    assert point["outcome_3d"] == "done" and point["label_2d"] is not None
    assert math.isfinite(point["wall_s"])
    assert "1 of 1" in done.output
    assert (tmp_path / "c" / "phase.png").is_file() and not (tmp_path / "phase.png").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--points=few"], "--points = 'few'"),
        (["--points=0", "--no-materials"], "--points = '0'"),
        (["--h=soft"], "h = 'soft'"),
        (["--limit=long"], "--limit = 'long'"),
        (["--workers=two"], "--workers = 'two'"),
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
    """A record of (at, verdict) as ``confirm`` leaves it."""
    found = [{"at": at, "verdict": verdict, "two": {"drop_rel": 0.2}} for at, verdict in points]
    path.write_text(json.dumps({"schema": 2, "points": found}), encoding="utf-8")
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
    """(place, marker) of what is marked."""
    marks = [line for line in axes.lines if line.get_markersize() == 9.0]
    return [(float(m.get_xdata()[0]), float(m.get_ydata()[0]), m.get_marker()) for m in marks]


def test_confirmed_points_are_marked_on_their_panel_and_by_verdict(tmp_path):
    data = plane(tmp_path)
    one = {"cohesion": 8.0, "viscosity": 0.1, "adhesion": 0.0}
    two = {"cohesion": 10.0, "viscosity": 1.0, "adhesion": 0.1}
    three = two | {"viscosity": 0.1}
    far = {"cohesion": 900.0, "viscosity": 1.0, "adhesion": 0.1}
    path = recorded(
        tmp_path / RECORD, (one, "confirmed"), (two, "another"), (three, "numerics"), (far, "confirmed")
    )
    figure = draw_phase(data, read_confirmed(path, data))
    first, second = (ax for ax in figure.axes if ax.get_label() != "<colorbar>")
    assert marks_on(first) == [(8.0, 0.1, "s")]
    assert marks_on(second) == [(10.0, 1.0, "X"), (10.0, 0.1, "D")]
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"3D: confirmed", "3D: another", "3D: its numerics cannot tell"} <= set(words)


def test_on_a_map_of_one_axis_they_stand_at_their_drop(data, tmp_path):
    path = recorded(tmp_path / RECORD, ({"cohesion": 8.0}, "unfinished"))
    figure = draw_phase(data, read_confirmed(path, data))
    assert marks_on(figure.axes[0]) == [(8.0, 0.2, "s")]
    assert not marks_on(draw_phase(data).axes[0])


def test_the_diagram_takes_the_record_beside_the_map(data, tmp_path):
    (tmp_path / FOLDER).mkdir()
    recorded(tmp_path / FOLDER / RECORD, ({"cohesion": 8.0}, "confirmed"))
    assert "3D: confirmed" in save_phase(data, tmp_path)[1].read_text(encoding="utf-8")


def test_a_record_of_another_map_has_no_marks_and_a_broken_one_is_refused(data, tmp_path):
    path = recorded(tmp_path / RECORD, ({"viscosity": 8.0}, "confirmed"))
    assert read_confirmed(path, data) == [] == read_confirmed(tmp_path / "none" / RECORD, data)
    for broken in ("{}", json.dumps({"points": [{"at": {}, "verdict": "fine", "two": {"drop_rel": 1}}]})):
        path.write_text(broken, encoding="utf-8")
        with refused("points", hint="cutbench confirm"):
            read_confirmed(path, data)
