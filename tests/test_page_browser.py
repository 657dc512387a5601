"""map.html in a real Chromium, driven by keys, pointer and touch; skipped where there is none."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import page_maps
import pytest
from chromium import NEEDED, a_browser, look  # noqa: F401 (a fixture)
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

from cutbench.base.files import write_text
from cutbench.maps.dataset import load_map
from cutbench.maps.page import page

pytestmark = NEEDED


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    return {
        kind: page_maps.swept(tmp_path_factory.mktemp(kind), text)
        for kind, text in (("grid", page_maps.GRID), ("sought", page_maps.SOUGHT))
    }


@pytest.fixture(params=["grid", "sought"])
def opened(request, browser, folders):
    look(browser)
    browser.get((folders[request.param] / "map.html").as_uri())
    return request.param, browser


@pytest.fixture
def grid(browser, folders):
    look(browser)
    browser.get((folders["grid"] / "map.html").as_uri())
    return browser


def all_of(browser, css):
    return browser.find_elements(By.CSS_SELECTOR, css)


def text_of(browser, id):
    return browser.find_element(By.ID, id).text


def traces(browser, plot="map"):
    """What is drawn: a list of traces, each with its name, type and how many places it has."""
    script = """return document.getElementById(arguments[0]).data.map(t => ({name: t.name || "",
        type: t.type || "scatter", n: t.x.length, ids: t.customdata || [], z: t.z || null}))"""
    return browser.execute_script(script, plot)


def names(browser):
    return " ".join(trace["name"] for trace in traces(browser))


def choose(browser, id, text):
    Select(browser.find_element(By.ID, id)).select_by_visible_text(text)


def walk(browser, id, value):
    script = """const e = document.getElementById(arguments[0]); e.value = arguments[1];
        e.dispatchEvent(new Event("input", {bubbles: true}))"""
    browser.execute_script(script, id, value)


def centre(browser, id):
    """Where a run is, in pixels."""
    script = """const map = document.getElementById("map"), box = map.getBoundingClientRect();
        const t = map.data.find(t => (t.customdata || []).includes(arguments[0]));
        const n = t.customdata.indexOf(arguments[0]), {xaxis: x, yaxis: y} = map._fullLayout;
        return [box.x + x._offset + x.d2p(t.x[n]), box.y + y._offset + y.d2p(t.y[n])]"""
    return browser.execute_script(script, id)


def mouse(browser, kind, x, y):
    button = "none" if kind == "mouseMoved" else "left"
    about = {"type": kind, "x": x, "y": y, "button": button, "clickCount": 1}
    browser.execute_cdp_cmd("Input.dispatchMouseEvent", about)


def point(browser, id):
    """Point at a run until it is shown."""

    def shown(browser):
        x, y = centre(browser, id)
        mouse(browser, "mouseMoved", x - 30, y)
        mouse(browser, "mouseMoved", x, y)
        time.sleep(0.1)
        return id in text_of(browser, "numbers")

    within(browser, shown)


def within(browser, condition):
    return WebDriverWait(browser, 10, poll_frequency=0.05).until(condition)


def test_it_draws_points_boundary_and_layers_without_a_word_or_a_request(opened):
    kind, browser = opened
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(r => r.name)") == []
    assert text_of(browser, "title") == page_maps.TITLE
    shown = names(browser)
    assert "boundary" in shown and "abrupt (" in shown and "smooth (" in shown
    assert all_of(browser, "#map .contourlayer path") and all_of(browser, "#map .heatmaplayer image")
    assert "(G" in text_of(browser, "map") and "[mm]" in text_of(browser, "curve")
    drop = next(t["z"] for t in traces(browser) if t["type"] == "heatmap")
    choose(browser, "shade", "chance of abrupt")
    assert next(t["z"] for t in traces(browser) if t["type"] == "heatmap") != drop
    assert ("even chance" in names(browser)) == (kind == "grid")
    assert {button.text for button in all_of(browser, "#marks button")} == {"gelatin", "elastomer"}


def test_where_the_regime_is_not_known_there_is_no_firm_line(browser, tmp_path):
    look(browser)
    data = load_map(Path(__file__).parents[1] / "studies" / "results" / "transition" / "map.nc")
    browser.get(write_text(page(data, None), tmp_path / "map.html").as_uri())
    shown = {trace["name"]: trace for trace in traces(browser)}
    hatched = next(trace for name, trace in shown.items() if "95 %" in name)
    assert hatched["n"] > 5
    firm = next((t["z"] for name, t in shown.items() if name.startswith("boundary: ")), [])
    likely = next(t["z"] for name, t in shown.items() if name.startswith("boundary, "))
    known = np.array([[v is not None for v in row] for row in firm or [[]]])
    assert np.size(likely) - known.sum() >= hatched["n"]


@pytest.mark.parametrize("text", [page_maps.SAMPLED, page_maps.ONE_AXIS, page_maps.SWITCH])
def test_runs_on_no_grid_on_one_axis_and_over_a_switch_are_drawn(browser, tmp_path, text):
    look(browser)
    browser.get((page_maps.swept(tmp_path, text) / "map.html").as_uri())
    assert browser.get_log("browser") == []
    runs = load_map(tmp_path / "map.nc")["run_id"].size
    marked = 1 if "elastomer" not in text else 2
    assert sum(len(trace["ids"]) for trace in traces(browser)) == runs + marked
    assert all_of(browser, "#curve .scatterlayer path")
    labels = text_of(browser, "map")
    assert ("without" in labels) == (text == page_maps.SWITCH)
    assert bool(all_of(browser, "#map .shapelayer path")) == (text == page_maps.ONE_AXIS), "the threshold"


def test_a_slider_walks_the_third_axis(opened, folders):
    kind, browser = opened
    data = load_map(folders[kind] / "map.nc")
    for level in range(data.sizes["adhesion"]):
        walk(browser, "level-adhesion", level)
        ids = {id for id in data["run_id"].isel(adhesion=level).values.ravel() if id}
        shown = {id for trace in traces(browser) for id in trace["ids"]}
        assert ids <= shown and len(shown - ids) <= 2, "the runs of this level and materials"
    choose(browser, "y", "adhesion")
    assert [i.get_attribute("id") for i in all_of(browser, ".level input") if i.is_displayed()] == [
        "level-viscosity"
    ]
    assert "adhesion" in browser.find_element(By.ID, "map").get_attribute("aria-label").split("across")[1]


def test_pointing_shows_a_run_and_a_click_holds_it(grid):
    ids = next(trace["ids"] for trace in traces(grid) if trace["name"].startswith("abrupt"))[:2]
    for id in ids:
        point(grid, id)
    values = text_of(grid, "numbers").replace("\u00a0", " ")
    assert all(unit in values for unit in ("J/m²", "kPa", "mm", "N", "mJ")) and "closure 0.1 %" in values
    x, y = centre(grid, ids[1])
    for kind in ("mousePressed", "mouseReleased"):
        mouse(grid, kind, x, y)
    within(grid, lambda b: b.execute_script("return map.data.at(-1).marker.line.width > 4"))
    mouse(grid, "mouseMoved", *centre(grid, ids[0]))
    time.sleep(0.3)
    assert ids[1] in text_of(grid, "numbers"), "it is held"
    grid.switch_to.active_element.send_keys(Keys.ESCAPE)
    point(grid, ids[0])


def test_arrow_keys_walk_from_run_to_run(grid, folders):
    at = load_map(folders["grid"] / "map.nc")["run_id"].values
    map_ = grid.find_element(By.ID, "map")
    assert map_.get_attribute("tabindex") == "0", "one stop for the tabulator"
    walk(grid, "level-adhesion", 1)
    point(grid, at[0, 0, 1])
    for key, expected in (
        (Keys.ARROW_RIGHT, at[1, 0, 1]), (Keys.ARROW_UP, at[1, 1, 1]), (Keys.ARROW_LEFT, at[0, 1, 1]),
        (Keys.ARROW_DOWN, at[0, 0, 1]), (Keys.ARROW_DOWN, at[0, 0, 1]), (Keys.PAGE_DOWN, at[0, 0, 0]),
        (Keys.PAGE_UP, at[0, 0, 1]),
    ):  # fmt: skip
        map_.send_keys(key)
        assert expected in text_of(grid, "numbers")
        assert text_of(grid, "head").startswith(("abrupt", "smooth"))
    map_.send_keys(Keys.ENTER)
    mouse(grid, "mouseMoved", *centre(grid, at[1, 1, 1]))
    time.sleep(0.3)
    assert at[0, 0, 1] in text_of(grid, "numbers"), "it is held"


def test_what_is_stacked_is_the_force(grid):
    script = """const data = document.getElementById("curve").data;
        return [data.filter(t => t.stackgroup).map(t => t.y), data.at(-1).y]"""
    stacked, mean = grid.execute_script(script)
    assert np.sum(stacked, axis=0) == pytest.approx(np.array(mean), abs=1e-9 * max(mean))
    assert np.min(stacked) < 0, "what gives force back is below zero"
    assert all_of(grid, "#curve .scatterlayer .fills path")


def test_all_runs_are_in_a_table(grid, folders):
    all_of(grid, "summary")[0].click()
    rows = all_of(grid, "#table tbody tr")
    assert len(rows) == 24 + 2 and rows[0].is_displayed()
    data = load_map(folders["grid"] / "map.nc")
    ids = {row.find_elements(By.TAG_NAME, "td")[-1].text for row in rows[:24]}
    assert ids == set(data["run_id"].values.ravel())


def test_a_material_shows_its_own_run(grid):
    next(b for b in all_of(grid, "#marks button") if b.text == "elastomer").click()
    assert text_of(grid, "head").startswith("elastomer: ") and "μ = 0.35" in text_of(grid, "said")


def test_on_a_phone_it_fits_and_a_tap_chooses(grid):
    look(grid, width=360, touch=True)
    grid.refresh()
    assert grid.execute_script("return document.documentElement.scrollWidth") <= 360
    small = grid.execute_script(
        "return Math.min(...[...document.querySelectorAll('svg text')].filter(t => t.textContent)"
        ".map(t => t.getBoundingClientRect().height).filter(h => h))"
    )
    assert small > 9, "text can be read"
    grid.execute_script("document.getElementById('map').scrollIntoView()")
    id = next(trace["ids"] for trace in traces(grid) if trace["name"].startswith("abrupt"))[0]
    x, y = centre(grid, id)
    touch = {"type": "touchStart", "touchPoints": [{"x": x + 3, "y": y + 3}]}
    grid.execute_cdp_cmd("Input.dispatchTouchEvent", touch)
    grid.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    within(grid, lambda b: id in text_of(b, "numbers"))


@pytest.mark.parametrize("dark, paper", [(False, False), (True, False), (True, True)])
def test_ink_stands_out_in_the_light_in_the_dark_and_on_paper(grid, dark, paper):
    look(grid, dark=dark, paper=paper)
    found = grid.execute_script(
        """const style = s => getComputedStyle(document.querySelector(s));
        return [style("body").backgroundColor, style("body").color, style(".note").color,
                style("#map .xtick text").fill, style("#controls").display]"""
    )
    *colours, controls = found
    paper_light, *inks = (luminance(colour) for colour in colours)
    assert (paper_light < 0.1) == (dark and not paper)
    for ink in inks:
        light, dim = max(ink, paper_light), min(ink, paper_light)
        assert (light + 0.05) / (dim + 0.05) > 4.5, "the contrast that WCAG asks for"
    assert (controls == "none") == paper


def luminance(colour):
    """Relative, of ``rgb(…)``, as WCAG has it."""
    part = np.array([float(v) for v in colour.strip("rgba()").split(",")[:3]]) / 255
    return float(
        np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]
    )
