"""map.html: what it holds, without a browser; what it does in one is tests/test_page_browser.py's."""

from __future__ import annotations

import json
import re

import analytic_runs
import numpy as np
import page_maps
import pytest

from cutbench.base.greek import plain_symbol
from cutbench.case.case import load_case
from cutbench.maps.axes import Axis
from cutbench.maps.dataset import load_map
from cutbench.maps.page import contents, page, save_page
from cutbench.maps.page_curves import CURVE_TOLERANCE, REST, curve_of, thinned
from cutbench.maps.page_layers import refined
from cutbench.run.outcome import Outcome
from cutbench.run.result import Result
from cutbench.run.store.runs import Store


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    return {
        kind: page_maps.swept(tmp_path_factory.mktemp(kind), text)
        for kind, text in (("grid", page_maps.GRID), ("sought", page_maps.SOUGHT))
    }


def data_of(html):
    (text,) = re.findall(r'<script id="data" type="application/json">(.*?)</script>', html, re.S)
    return json.loads(text)


@pytest.mark.parametrize("kind", ["grid", "sought"])
def test_the_page_holds_every_run_with_its_curve_and_asks_nobody_for_anything(folders, kind):
    html = (folders[kind] / "map.html").read_text(encoding="utf-8")
    assert not re.search(
        r"""(src|href)\s*=|url\((?!#)|import\s|fetch\(|XMLHttp|https?://(?!www\.w3\.org/2000/svg)""",
        html.replace("`url(#${name})`", ""),
    )
    found, data, store = data_of(html), load_map(folders[kind] / "map.nc"), Store(folders[kind] / "runs")
    runs = [point for point in found["points"] if not point["mark"]]
    assert {run["id"] for run in runs} == {id for id in data["run_id"].values.ravel() if id}
    assert found["title"] == page_maps.TITLE
    for run in runs[::5]:
        curve = run["curve"]
        x, y = store.get(run["id"]).displacement_mm, store.get(run["id"]).force_N
        drawn = np.interp(x, curve["d"], curve["scale"] * np.array(curve["force"]))
        assert drawn == pytest.approx(y, abs=(found["error"] + 1e-3) * max(y))
        assert {"neo_hookean", "adhesion"} <= set(curve["split"]) and run["closure"] == 1e-3


def test_a_point_has_its_groups_and_what_they_are_in_units(folders):
    found = data_of((folders["grid"] / "map.html").read_text(encoding="utf-8"))
    run = next(p for p in found["points"] if p["at"] == [30.0, 0.2, 0.187])
    varied = [q for q in found["quantities"] if q["fixed"] is None]
    known = {q["name"]: (q, pair) for q, pair in zip(varied, run["values"], strict=True)}
    q, (group, value) = known["cohesion"]
    assert (q["symbol"], q["sets"], q["in"], group) == ("(G_c/δ_c)/G", "G_c", "J/m^2", 30.0)
    case = load_case("gelatin", {"cohesion": 30.0, "viscosity": 0.2, "adhesion": 0.187})
    assert value == pytest.approx(1e3 * case.p.G_c, rel=1e-3)
    assert known["adhesion"][1] == pytest.approx([0.187, 1e3 * case.p.tau_W], rel=1e-3)
    fixed = {q["name"]: q["fixed"] for q in found["quantities"]}
    assert fixed["speed"] == [0.021, 0.021] and fixed["thickness"] == [0.7, 0.7], "what groups are made of"
    assert known["viscosity"][1] == pytest.approx([0.2, case.p.eta_reg], rel=1e-3)


@pytest.mark.parametrize("kind", ["grid", "sought"])
def test_drop_chance_and_boundary_are_there_for_grids_and_for_boundaries(folders, kind):
    found, data = (
        data_of((folders[kind] / "map.html").read_text(encoding="utf-8")),
        load_map(folders[kind] / "map.nc"),
    )
    wanted = {"drop": ["z"], "chance": ["margin", "sd"]} | ({"line": ["z"]} if kind == "grid" else {})
    assert set(found["layers"]) == set(wanted) | {"classical"}
    for layer, keys in wanted.items():
        shape = [len(values) for values in found["layers"][layer]["values"]]
        assert all(len(found["layers"][layer][key]) == np.prod(shape) for key in keys)
    chance = found["layers"]["chance"]
    shape = [len(values) for values in chance["values"]]
    margin = np.array(chance["margin"], dtype=float).reshape(shape)
    for run in (p for p in found["points"] if p["label"] in ("abrupt", "smooth") and not p["mark"]):
        at = tuple(
            int(np.argmin(np.abs(np.array(v) - a))) for v, a in zip(chance["values"], run["at"], strict=True)
        )
        near = all(
            v[i] == pytest.approx(a, rel=1e-3)
            for v, i, a in zip(chance["values"], at, run["at"], strict=True)
        )
        assert not near or abs(margin[at]) < 50 or (margin[at] > 0) == (run["label"] == "abrupt")
    if kind == "grid":
        drop = np.array(found["layers"]["drop"]["z"]).reshape(data["drop_rel"].shape)
        assert drop == pytest.approx(1000 * data["drop_rel"].values, abs=0.51)
        line = np.array(found["layers"]["line"]["z"]).reshape(drop.shape)
        assert ((line >= 0) == (data["drop_rel"].values >= 0.1)).all()


def test_marked_materials_come_with_their_own_runs(folders):
    found = data_of((folders["grid"] / "map.html").read_text(encoding="utf-8"))
    marks = {point["mark"]: point for point in found["points"] if point["mark"]}
    assert set(marks) == {"gelatin", "elastomer"} and "μ = 0.35" in marks["elastomer"]["differs"]
    data = load_map(folders["grid"] / "map.nc")
    assert {point["id"] for point in marks.values()} == set(data["mark_run_id"].values)
    names = [q["name"] for q in found["quantities"] if q["fixed"] is None]
    friction = names.index("friction")
    assert marks["elastomer"]["values"][friction][1] == 0.35 and marks["gelatin"]["values"][friction][1] == 0
    assert marks["elastomer"]["curve"]["force"]


def test_a_page_without_its_store_has_numbers_and_no_curves(folders, tmp_path):
    data = load_map(folders["grid"] / "map.nc")
    assert save_page(data, None, tmp_path).is_file()
    found = contents(data, None)
    assert len(found["points"]) == 26 and not any(point["curve"] for point in found["points"])
    place = [number["name"] for number in found["numbers"]].index("drop_rel")
    assert found["points"][0]["measures"][place] == pytest.approx(data["drop_rel"].values[0, 0, 0], rel=1e-3)


def test_marks_of_a_map_without_their_runs_are_places(folders):
    data = load_map(folders["grid"] / "map.nc").drop_dims("mark")
    marks = [point for point in contents(data, None)["points"] if point["mark"]]
    assert marks[0]["at"] == pytest.approx([10.1, 0.714, 0.01057], rel=1e-3)
    assert not any(mark["outcome"] for mark in marks) and "__" not in page(data, None).split("<body>")[0]


def test_runs_that_fell_short_say_so_and_leave_gaps(tmp_path):
    folder = page_maps.swept(tmp_path, page_maps.GRID, analytic_runs.unlucky_run)
    found = data_of((folder / "map.html").read_text(encoding="utf-8"))
    failed = [run for run in found["points"] if run["outcome"] == "failed"]
    assert failed and all("singular" in run["message"] and run["label"] == "not_computed" for run in failed)
    gaps = sum(not run["mark"] for run in failed)
    assert sum(z is None for z in found["layers"]["drop"]["z"]) == gaps
    assert sum(z is None for z in found["layers"]["line"]["z"]) == gaps
    assert None not in found["layers"]["chance"]["margin"], "estimated from the others"


def test_runs_that_lie_on_no_grid_have_no_layers(tmp_path):
    folder = page_maps.swept(tmp_path, page_maps.SAMPLED)
    found = data_of((folder / "map.html").read_text(encoding="utf-8"))
    assert found["layers"] == {} and not found["gridded"] and len(found["points"]) == 11


def test_curves_are_thinned_and_stay_as_close_as_they_say():
    x = np.linspace(0, 10, 4000)
    lines = np.stack([np.sin(x) + (x > 5), np.cos(3 * x)], axis=1)
    for points in (40, 400):
        keep, error = thinned(x, lines, CURVE_TOLERANCE, points)
        drawn = np.stack([np.interp(x, x[keep], line[keep]) for line in lines.T], axis=1)
        assert np.abs(drawn - lines).max() == pytest.approx(error, rel=1e-6)
        assert keep[0] == 0 and keep[-1] == 3999 and keep.size <= points
    assert error <= CURVE_TOLERANCE and keep.size < 150


def uneven_run(case):
    """Steps of unequal length, a mechanism that gives back what another takes up, a jump, a rest."""
    d = np.cumsum(np.concatenate([[0.0], np.random.default_rng(3).uniform(0.001, 0.05, 400)]))
    force = np.where(d < 4, d, 3.0) + 0.02 * np.sin(40 * d)
    steps = (force[1:] + force[:-1]) / 2  # the mean force over each step, which its work is made of
    given = np.where(d[1:] < 4, 0.3 * steps, -0.8 * steps)
    parts = {"neo_hookean": given, "smith_ferrante": 0.9 * (steps - given), "adhesion": 0.1 * (steps - given)}
    d, force = np.append(d, [d[-1], d[-1]]), np.append(force, [2.0, 1.5])
    return Result(
        case,
        {"displacement_mm": d, "force_N": force, "time_s": d, "cut_length_mm": 0 * d}
        | {f"force_{name}_N": np.concatenate([[0], part, [0, 0]]) for name, part in parts.items()},
        Outcome("done", "made up", "", float(d[-1])),
    )  # fmt: skip


@pytest.fixture(scope="module")
def uneven():
    run = uneven_run(load_case("gelatin", {"depth": "12 mm"}))
    return run, curve_of(run)


def test_the_parts_of_a_force_are_all_of_it_at_every_point(uneven):
    run, found = uneven
    mean = np.array(found["mean"])
    split = {name: np.array(share) for name, share in found["split"].items()}
    assert (sum(split.values()) == mean).all(), "exactly, in whole numbers"
    assert all(share.shape == mean.shape for share in split.values())
    d = np.array(found["d"])[: mean.size]
    assert np.abs(split.get(REST, np.zeros(1))).max() * found["scale"] < 0.005 * run.force_N.max()
    smooth = (d > 1) & (d < 3.7)
    force = np.interp(d[smooth], run.displacement_mm, run.force_N)
    assert found["scale"] * mean[smooth] == pytest.approx(force, abs=0.03)
    late = (d > 4.5) & (d < d[-1] - 0.5)
    assert found["scale"] * split["neo_hookean"][late] == pytest.approx(-2.4, abs=0.1), (
        "what gives back is below zero"
    )
    assert found["scale"] * split["adhesion"][late] == pytest.approx(0.54, abs=0.02)
    early = (d > 0.5) & (d < 3.5)
    assert split["neo_hookean"][early] == pytest.approx(0.3 * mean[early], abs=0.02 * mean.max())


def test_the_force_goes_on_through_a_rest_and_its_split_does_not(uneven):
    _, found = uneven
    assert len(found["mean"]) < len(found["force"]) and found["d"][-1] == found["d"][len(found["mean"]) - 1]
    assert found["scale"] * found["force"][-1] == pytest.approx(1.5, abs=1e-3 * 3)


def test_symbols_lose_their_markup():
    assert plain_symbol(r"$\eta_\mathrm{reg}\,v/\delta_\mathrm{c}$") == "η_reg v/δ_c"
    assert plain_symbol("$r/a$") == "r/a" and plain_symbol("b") == "b"


def test_the_estimate_of_a_grid_holds_the_grid_s_own_values():
    axis = Axis("cohesion", "1", "", "", (1.0, 2.0, 8.0), "log", "G_c")
    fine = refined(axis, 21)
    assert len(fine) == 21 and fine[::10] == pytest.approx([1, 2, 8]) and fine[5] == pytest.approx(2**0.5)
