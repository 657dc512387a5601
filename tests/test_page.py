"""map.html: what it holds, without a browser; what it does in one is tests/test_page_browser.py's."""

from __future__ import annotations

import json
import re
from html import unescape

import analytic_runs
import numpy as np
import page_maps
import pytest

from cutbench.base.greek import plain_symbol
from cutbench.case.case import load_case
from cutbench.maps.axes import Axis
from cutbench.maps.dataset import load_map
from cutbench.maps.page import CURVE_TOLERANCE, REST, contents, curve_of, page, refined, thinned
from cutbench.run.result import Outcome, Result
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


def words(html):
    """Its text, without markup."""
    return (
        re.sub(r"\s+", " ", unescape(re.sub(r"<(?!/?sub)[^>]*>", " ", html)))
        .replace("</sub>", "")
        .replace("<sub>", "_")
    )


@pytest.mark.parametrize("kind", ["grid", "sought"])
def test_the_page_holds_every_run_with_its_curve_and_may_ask_nobody_for_anything(folders, kind):
    html = (folders[kind] / "map.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in html and "connect-src" not in html
    found, data, store = data_of(html), load_map(folders[kind] / "map.nc"), Store(folders[kind] / "runs")
    runs = [point for point in found["points"] if not point["mark"]]
    assert {run["id"] for run in runs} == {id for id in data["run_id"].values.ravel() if id}
    assert unescape(re.search("<title>(.*)</title>", html)[1]) == page_maps.TITLE
    for run in runs[::5]:
        curve, result = run["curve"], store.get(run["id"])
        drawn = np.interp(result.displacement_mm, curve["d"], curve["scale"] * np.array(curve["force"]))
        assert drawn == pytest.approx(result.force_N, abs=(curve["error"] + 1e-3) * max(result.force_N))
        assert {"neo_hookean", "adhesion"} <= set(curve["split"]) and "closure 0.1 %" in words(run["rows"])


def test_a_point_has_its_groups_and_what_they_are_in_units(folders):
    found = data_of((folders["grid"] / "map.html").read_text(encoding="utf-8"))
    run = words(next(p for p in found["points"] if p["at"] == [30.0, 0.2, 0.187])["rows"])
    p = load_case("gelatin", {"cohesion": 30.0, "viscosity": 0.2, "adhesion": 0.187}).p
    assert f"cohesion (G_c/δ_c)/G 30 G_c = {1e3 * p.G_c:.3g} J/m²" in run
    assert f"adhesion τ_W/(G_c/δ_c) 0.187 τ_W = {1e3 * p.tau_W:.3g} kPa" in run
    assert f"viscosity η_reg v/δ_c 0.2 η_reg = {p.eta_reg:.3g} s" in run
    assert "v 0.021 mm/s" in run and "2a 0.7 mm" in run, "what groups are made of"


@pytest.mark.parametrize("kind", ["grid", "sought"])
def test_drop_chance_and_boundary_are_there_for_grids_and_for_boundaries(folders, kind):
    found, data = (
        data_of((folders[kind] / "map.html").read_text(encoding="utf-8")),
        load_map(folders[kind] / "map.nc"),
    )
    wanted = {"drop": ["z"], "chance": ["over", "p"]} | ({"line": ["over"]} if kind == "grid" else {})
    assert set(found["layers"]) == set(wanted) | {"classical"}
    for layer, keys in wanted.items():
        shape = [len(values) for values in found["layers"][layer]["values"]]
        assert all(len(found["layers"][layer][key]) == np.prod(shape) for key in keys)
    chance = found["layers"]["chance"]
    shape = [len(values) for values in chance["values"]]
    over = np.array(chance["over"], dtype=float).reshape(shape)
    assert ((over > 0) == (np.array(chance["p"]).reshape(shape) > 500))[over != 0].all()
    for run in (p for p in found["points"] if p["kind"] in ("abrupt", "smooth") and not p["mark"]):
        at = tuple(
            int(np.argmin(np.abs(np.array(v) - a))) for v, a in zip(chance["values"], run["at"], strict=True)
        )
        near = all(
            v[i] == pytest.approx(a, rel=1e-3)
            for v, i, a in zip(chance["values"], at, run["at"], strict=True)
        )
        assert not near or abs(over[at]) < 50 or (over[at] > 0) == (run["kind"] == "abrupt")
    if kind == "grid":
        drop = np.array(found["layers"]["drop"]["z"]).reshape(data["drop_rel"].shape)
        assert drop == pytest.approx(1000 * data["drop_rel"].values, abs=0.51)
        line = np.array(found["layers"]["line"]["over"]).reshape(drop.shape)
        assert ((line >= 0) == (data["drop_rel"].values >= 0.1)).all()


def test_marked_materials_come_with_their_own_runs(folders):
    html = (folders["grid"] / "map.html").read_text(encoding="utf-8")
    marks = {point["mark"]: point for point in data_of(html)["points"] if point["mark"]}
    assert set(marks) == {"gelatin", "elastomer"} and "μ = 0.35" in marks["elastomer"]["notes"]
    data = load_map(folders["grid"] / "map.nc")
    assert {point["id"] for point in marks.values()} == set(data["mark_run_id"].values)
    assert "μ 0.35" in words(marks["elastomer"]["rows"]) and "μ 0 " in words(marks["gelatin"]["rows"])
    assert marks["elastomer"]["curve"]["force"] and f'data-id="{marks["gelatin"]["id"]}"' in html


def test_a_page_without_its_store_has_numbers_and_no_curves(folders):
    data = load_map(folders["grid"] / "map.nc")
    assert "<html" in page(data, None)
    found = contents(data, None)
    assert len(found["points"]) == 26 and not any(point["curve"] for point in found["points"])
    assert found["points"][0]["drop"] == pytest.approx(data["drop_rel"].values[0, 0, 0], rel=1e-3)


def test_marks_of_a_map_without_their_runs_are_places(folders):
    data = load_map(folders["grid"] / "map.nc").drop_dims("mark")
    marks = [point for point in contents(data, None)["points"] if point["mark"]]
    assert marks[0]["at"] == pytest.approx([10.1, 0.714, 0.01057], rel=1e-3)
    assert {mark["kind"] for mark in marks} == {"no run of its own"}
    assert "__" not in page(data, None).split("<body>")[0]


def test_runs_that_fell_short_say_so_and_leave_gaps(tmp_path):
    folder = page_maps.swept(tmp_path, page_maps.GRID, analytic_runs.unlucky_run)
    found = data_of((folder / "map.html").read_text(encoding="utf-8"))
    failed = [run for run in found["points"] if run["kind"] == "not computed"]
    assert failed and all("singular" in run["notes"] for run in failed)
    gaps = sum(not run["mark"] for run in failed)
    assert sum(z is None for z in found["layers"]["drop"]["z"]) == gaps
    assert sum(z is None for z in found["layers"]["line"]["over"]) == gaps
    assert None not in found["layers"]["chance"]["over"], "estimated from the others"


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
