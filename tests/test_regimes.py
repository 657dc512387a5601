"""Stable, held back by viscosity, or a snap: by the run at rest and the speed of the front."""

from __future__ import annotations

import csv
import io
import math

import analytic_runs
import numpy as np
import pytest
from refusals import refused

from cutbench import load_case
from cutbench.base.errors import BadInput
from cutbench.maps.collapse import collapse_of, save_collapse
from cutbench.maps.dataset import load_map
from cutbench.maps.regimes import (
    HELD,
    KINDS,
    REST,
    SNAP,
    SNAP_SPEED,
    STABLE,
    UNKNOWN,
    kind,
    quasi_static_case,
)
from cutbench.maps.sampling_plan import plan_of
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study
from cutbench.run.measures import FRONT
from cutbench.run.result import Outcome, Result

LIMIT = 5.0
STUDY = f"""base = "gelatin"
[[axis]]
name = "cohesion"
values = [2.0, 8.0]
[[axis]]
name = "viscosity"
values = [{REST}, 0.2, 5.0]
scale = "log"
[regime]
rest = true
"""


def speed_of(case) -> float:
    """Of the front: 1 below the cohesion ``LIMIT``, above it faster the less the viscosity."""
    p = case.p
    cohesion, viscosity = p.G_c / p.delta_c / p.G, p.eta_reg * p.speed / p.delta_c
    return 1.0 if cohesion < LIMIT else 1 + 4 / viscosity


def jumping(case) -> Result:
    """A cut that advances by ``speed_of`` over the stretch that its speed is measured on, then steadily."""
    analytic_runs.note(case)
    ahead = FRONT * case.p.thickness
    d = np.array([0, 2, 2 + ahead, case.p.depth])
    c = np.cumsum([0, 0.0, speed_of(case) * ahead, case.p.depth - 2 - ahead])
    curve = {"displacement_mm": d, "force_N": np.array([0, 1.0, 0.5, 0.5]), "cut_length_mm": c,
             "time_s": d / case.p.speed}  # fmt: skip
    return Result(
        case,
        curve,
        Outcome("done", "reached it", "", case.p.depth),
        {},
        {},
        [],
        {"freed_rel": speed_of(case)},
    )


def failing_at_rest(case) -> Result:
    if math.isclose(case.p.eta_reg * case.p.speed / case.p.delta_c, REST):
        raise FloatingPointError("the matrix is singular")
    return jumping(case)


def swept(tmp_path, text=STUDY, run=jumping):
    path = tmp_path / "study.toml"
    path.write_text(text)
    return run_study(load_study(path), tmp_path / "out", workers=0, run=run, pictures=False)


def kinds_of(data):
    return np.array(KINDS)[data["kind"].values].tolist()


@pytest.mark.parametrize(
    ("speed", "still", "found"),
    [
        (1.0, 1.2, STABLE),
        (1.5, 40.0, HELD),
        (SNAP_SPEED, 40.0, SNAP),
        (SNAP_SPEED * 0.999, SNAP_SPEED, HELD),
        (9.0, math.nan, SNAP),
        (1.5, math.nan, UNKNOWN),
        (math.nan, 40.0, UNKNOWN),
    ],
)
def test_two_speeds_of_the_front_say_which(speed, still, found):
    assert kind(speed, still) == found


def test_rest_is_the_case_with_hardly_any_viscosity_or_what_has_none():
    case = load_case("gelatin").set(viscosity=0.7)
    still = quasi_static_case(case)
    assert still.id == case.set(viscosity=REST).id != case.id
    assert quasi_static_case(still) is still
    none = case.set(without=[law.name for law in case.model.all if law.regularises])
    assert quasi_static_case(none) is none


def test_a_grid_that_has_rest_on_an_axis_needs_no_further_runs(tmp_path, log):
    sweep = swept(tmp_path)
    assert len(log.read_text().split()) == 6 and sweep.complete
    assert kinds_of(sweep.map) == [[STABLE] * 3, [SNAP, SNAP, HELD]]
    assert np.allclose(sweep.map["rest_freed_rel"], [[1] * 3, [401] * 3])
    assert any("2 snap" in line and "3 stable" in line and "1 held" in line for line in sweep.words())
    again = load_map(sweep.out / "map.nc")
    assert again["kind"].attrs["snap_speed"] == SNAP_SPEED
    assert (again["rest_run_id"].values == again["run_id"].values[:, :1]).all()
    rows = list(csv.DictReader(io.StringIO((sweep.out / "map.csv").read_text())))
    assert [row["kind"] for row in rows] == [STABLE] * 3 + [SNAP, SNAP, HELD]


def test_each_place_of_the_other_axes_has_one_run_at_rest(tmp_path, log):
    sweep = swept(tmp_path, STUDY.replace(f"[{REST}, ", "[0.1, "))
    assert plan_of(load_study(tmp_path / "study.toml")).max_runs == 8
    assert len(log.read_text().split()) == len(set(log.read_text().split())) == 6 + 2
    assert sweep.complete and sweep.status.total == 8
    assert kinds_of(sweep.map) == [[STABLE] * 3, [SNAP, SNAP, HELD]]


def test_marked_materials_have_none(tmp_path, log):
    sweep = swept(tmp_path, STUDY + '[plot]\nmark = ["gelatin"]\n')
    assert len(log.read_text().split()) == 6 + 1
    *_, own = csv.DictReader(io.StringIO((sweep.out / "map.csv").read_text()))
    assert own["mark"] == "gelatin" and own["kind"] == own["rest_front_speed"] == ""


def test_where_the_run_at_rest_fails_only_a_snap_is_known(tmp_path):
    sweep = swept(tmp_path, STUDY.replace(f"[{REST}, ", "[0.1, "), failing_at_rest)
    assert kinds_of(sweep.map) == [[UNKNOWN] * 3, [SNAP, SNAP, UNKNOWN]]


def test_a_boundary_that_is_sought_has_them(tmp_path):
    text = STUDY.replace("[2.0, 8.0]", "[2.0, 8.0]").replace(
        f"values = [{REST}, 0.2, 5.0]", "from = 0.1\nto = 5.0\ntolerance = 0.25"
    )
    sweep = swept(tmp_path, f'mode = "boundary"\n{text}')
    run = sweep.map["run_id"].values != ""
    assert run.any() and (sweep.map["kind"].values[run] > 0).all()
    assert (sweep.map["kind"].values[~run] == 0).all()


def test_a_study_has_no_runs_at_rest_unless_it_says_so(tmp_path, log):
    sweep = swept(tmp_path, STUDY.replace("rest = true", ""))
    assert "kind" not in sweep.map and "rest_run_id" not in sweep.map
    assert len(log.read_text().split()) == 6


def test_what_is_no_yes_or_no_is_refused(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("rest = true", 'rest = "slow"'))
    with pytest.raises(BadInput) as caught:
        load_study(path)
    assert caught.value.key == "regime.rest" and caught.value.line


def panels(V, factor=0.4, power=1.5):
    """A map of two panels whose front follows S = 1 + V*/V, V* a power of what is freed."""
    freed = np.array([[2.0, 3.0], [4.0, 6.0]])
    S = 1 + factor * freed[..., None] ** power / V
    rest = np.broadcast_to(freed[..., None], S.shape)
    return S, rest


def drawn(sweep, S, rest):
    data = sweep.map.assign(
        front_speed=(sweep.map["front_speed"].dims, S), rest_freed_rel=(sweep.map["kind"].dims, rest)
    )
    data.attrs = sweep.map.attrs
    return data


GRID = f"""base = "gelatin"
[[axis]]
name = "adhesion"
values = [0.0, 0.1]
[[axis]]
name = "cohesion"
values = [2.0, 8.0]
[[axis]]
name = "viscosity"
values = [{REST}, 0.3, 1.0, 3.0]
scale = "log"
[regime]
rest = true
[plot]
x = "cohesion"
y = "viscosity"
panel = "adhesion"
"""


def test_one_line_is_found_where_there_is_one(tmp_path):
    sweep = swept(tmp_path, GRID)
    V = sweep.map["viscosity"].values
    S, rest = panels(V)
    found = collapse_of(drawn(sweep, S, rest))
    assert found.fitted == ((S > 1.15) & (S < 10)).sum() >= 6
    assert (found.factor, found.power, found.scatter) == pytest.approx((0.4, 1.5, 1))
    assert np.allclose(found.front_speed, 1 + found.line(found.freed) / found.viscosity)
    # One panel that is three times as fast is no longer on the line of the other.
    S[1] = 1 + 3 * (S[1] - 1)
    assert collapse_of(drawn(sweep, S, rest)).scatter > 1.2


def test_the_line_is_drawn_and_said(tmp_path):
    sweep = swept(tmp_path, GRID)
    paths, text = save_collapse(drawn(sweep, *panels(sweep.map["viscosity"].values)), tmp_path)
    assert {path.suffix for path in paths} == {".png", ".svg"} and all(p.stat().st_size for p in paths)
    assert "0.4 (freed/G_c)^1.5" in text


def test_no_line_of_fronts_that_keep_pace_or_of_too_few(tmp_path):
    sweep = swept(tmp_path, GRID)
    S, rest = panels(sweep.map["viscosity"].values)
    paths, text = save_collapse(drawn(sweep, np.ones_like(S), rest), tmp_path)
    assert len(paths) == 2 and not text
    assert save_collapse(drawn(sweep, S, np.full_like(rest, np.nan)), tmp_path) == ([], "")


def test_a_map_without_runs_at_rest_has_none(tmp_path):
    sweep = swept(tmp_path, STUDY.replace("rest = true", ""))
    assert save_collapse(sweep.map, tmp_path) == ([], "")
    with refused("map", value="study", hint="rest"):
        collapse_of(sweep.map)
