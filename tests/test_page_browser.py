"""map.html in a real Chromium, driven by keys, pointer and touch; skipped where there is none."""

from __future__ import annotations

import numpy as np
import page_maps
import pytest
from chromium import NEEDED, a_browser, look  # noqa: F401 (a fixture)
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from cutbench.maps.dataset import load_map

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


def focused(browser):
    return browser.execute_script("return document.activeElement.dataset.id")


def press(browser, *keys):
    browser.switch_to.active_element.send_keys(*keys)


def centre(browser, id):
    script = """const r = document.querySelector(`[data-id="${arguments[0]}"] .ring`).getBoundingClientRect();
        return [r.x + r.width / 2, r.y + r.height / 2]"""
    return browser.execute_script(script, id)


def mouse(browser, kind, x, y):
    about = {
        "type": kind,
        "x": x,
        "y": y,
        "button": "none" if kind == "mouseMoved" else "left",
        "clickCount": 1,
    }
    browser.execute_cdp_cmd("Input.dispatchMouseEvent", about)


def test_it_draws_points_boundary_and_layers_without_a_word_or_a_request(opened):
    kind, browser = opened
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(r => r.name)") == []
    assert text_of(browser, "title") == page_maps.TITLE
    assert len(browser.find_element(By.ID, "boundary").get_attribute("d")) > 30
    assert all_of(browser, "#map image.shade") and "drop" in text_of(browser, "scale")
    assert "(G" in text_of(browser, "map") and "[mm]" in text_of(browser, "curve")
    shade = browser.find_element(By.ID, "shade")
    drop = browser.find_element(By.CSS_SELECTOR, "image.shade").get_attribute("href")
    shade.send_keys("chance")
    assert browser.find_element(By.CSS_SELECTOR, "image.shade").get_attribute("href") != drop
    assert "chance" in text_of(browser, "scale")
    assert bool(all_of(browser, "#map .even")) == (kind == "grid")
    names = [mark.text.rstrip("*") for mark in all_of(browser, "#map text.over")]
    assert set(names) <= {"gelatin", "elastomer"}
    assert {button.text for button in all_of(browser, "#marks button")} == {"gelatin", "elastomer"}


@pytest.mark.parametrize("text", [page_maps.SAMPLED, page_maps.ONE_AXIS, page_maps.SWITCH])
def test_runs_on_no_grid_on_one_axis_and_over_a_switch_are_drawn(browser, tmp_path, text):
    look(browser)
    browser.get((page_maps.swept(tmp_path, text) / "map.html").as_uri())
    assert browser.get_log("browser") == []
    runs = load_map(tmp_path / "map.nc")["run_id"].size
    marked = 1 if "elastomer" not in text else 2
    assert len(all_of(browser, "#points .point")) == runs + marked
    assert all_of(browser, "#force")
    labels = {node.text for node in all_of(browser, "#map text")}
    assert ("without" in labels) == (text == page_maps.SWITCH)
    assert (
        any("drop" in label for label in labels)
        == bool(all_of(browser, "#threshold"))
        == (text == page_maps.ONE_AXIS)
    )


def test_a_tab_walks_the_third_axis(opened, folders):
    kind, browser = opened
    data = load_map(folders[kind] / "map.nc")
    for level, tab in enumerate(all_of(browser, "#level-adhesion .tab")):
        tab.click()
        ids = {id for id in data["run_id"].isel(adhesion=level).values.ravel() if id}
        shown = {g.get_attribute("data-id") for g in all_of(browser, "#points .point")}
        assert ids <= shown and len(shown - ids) <= 2, "the runs of this level and materials"
    up = browser.find_element(By.ID, "y")
    up.send_keys("adhesion")
    assert [f.get_attribute("id") for f in all_of(browser, "[id^=level-]")] == ["level-viscosity"]
    assert "adhesion" in browser.find_element(By.ID, "map").get_attribute("aria-label").split("across")[1]


def test_pointing_shows_a_run_and_a_click_holds_it(grid):
    ids = [g.get_attribute("data-id") for g in all_of(grid, "#points .point:not(.chosen)")][:2]
    for id in ids:
        mouse(grid, "mouseMoved", *centre(grid, id))
        assert id in text_of(grid, "numbers")
    values = text_of(grid, "numbers")
    assert all(
        unit in values for unit in ("J/m²", "kPa", "mm", "N", "mJ")
    ) and "closure 0.1 %" in values.replace("\u00a0", " ")
    assert "drop about" in text_of(grid, "place")
    x, y = centre(grid, ids[1])
    for kind in ("mousePressed", "mouseReleased"):
        mouse(grid, kind, x, y)
    mouse(grid, "mouseMoved", *centre(grid, ids[0]))
    assert ids[1] in text_of(grid, "numbers"), "it is held"
    press(grid, Keys.ESCAPE)
    mouse(grid, "mouseMoved", *centre(grid, ids[0]))
    assert ids[0] in text_of(grid, "numbers")


def test_arrow_keys_walk_from_run_to_run(grid, folders):
    at = load_map(folders["grid"] / "map.nc")["run_id"].isel(adhesion=1).values
    grid.execute_script("document.querySelector(`[data-id='${arguments[0]}']`).focus()", at[0, 0])
    for key, expected in (
        (Keys.ARROW_RIGHT, at[1, 0]), (Keys.ARROW_UP, at[1, 1]), (Keys.ARROW_LEFT, at[0, 1]),
        (Keys.ARROW_DOWN, at[0, 0]), (Keys.ARROW_DOWN, at[0, 0]),
    ):  # fmt: skip
        press(grid, key)
        assert focused(grid) == expected and expected in text_of(grid, "numbers")
    ring = f"""return getComputedStyle(document.querySelector("[data-id='{at[0, 0]}'] .ring")).stroke"""
    assert grid.execute_script(ring) != "none"
    press(grid, Keys.PAGE_DOWN)
    other = load_map(folders["grid"] / "map.nc")["run_id"].isel(adhesion=0).values
    assert focused(grid) == other[0, 0], "the same place on the level below"
    press(grid, Keys.PAGE_UP)
    assert focused(grid) == at[0, 0]
    press(grid, Keys.ENTER)
    assert grid.switch_to.active_element.get_attribute("aria-pressed") == "true"
    press(grid, Keys.ESCAPE)
    assert grid.switch_to.active_element.get_attribute("aria-pressed") == "false"
    name = grid.switch_to.active_element.get_attribute("aria-label")
    assert "cohesion 1," in name and ("abrupt" in name or "smooth" in name) and "drop" in name
    assert len(all_of(grid, "#points .point[tabindex='0']")) == 1, "one stop for the tabulator"


def test_what_is_stacked_is_the_force(grid):
    script = """const pair = p => p.split(",").map(Number);
        const points = e => e.getAttribute("points").trim().split(" ").map(pair);
        const zero = Number(document.querySelector("#curve .zero").getAttribute("d").match(/,([\\d.]+)h/)[1]);
        return {zero, mean: points(document.getElementById("mean")),
                bands: [...document.querySelectorAll("#curve .split")].map(points)}"""
    found = grid.execute_script(script)
    mean = np.array(found["mean"])
    height = np.zeros(len(mean))
    below = 0
    for band in map(np.array, found["bands"]):
        to, start = band[: len(mean)], band[len(mean) :][::-1]
        assert (to[:, 0] == mean[:, 0]).all() and (start[:, 0] == mean[:, 0]).all()
        height += start[:, 1] - to[:, 1]
        below += (to[:, 1] > found["zero"] + 1).any()
    assert height == pytest.approx(found["zero"] - mean[:, 1], abs=0.1 * len(found["bands"]))
    assert below, "what gives force back is below zero"


def test_all_runs_are_in_a_table(grid, folders):
    all_of(grid, "summary")[0].click()
    rows = WebDriverWait(grid, 10).until(lambda _: all_of(grid, "#table tbody tr"))
    assert len(rows) == 24 + 2
    data = load_map(folders["grid"] / "map.nc")
    assert {row.find_elements(By.TAG_NAME, "td")[-1].text for row in rows[:24]} == set(
        data["run_id"].values.ravel()
    )


def test_a_material_shows_its_own_run(grid):
    next(b for b in all_of(grid, "#marks button") if b.text == "elastomer").click()
    assert text_of(grid, "head").startswith("elastomer: ") and "μ = 0.35" in text_of(grid, "said")
    assert all_of(grid, "#points .point.held")


def test_on_a_phone_it_fits_and_a_tap_chooses(grid):
    look(grid, width=360, touch=True)
    grid.refresh()
    assert grid.execute_script("return document.documentElement.scrollWidth") <= 360
    small = grid.execute_script(
        "return Math.min(...[...document.querySelectorAll('svg text')].filter(t => t.textContent)"
        ".map(t => t.getBoundingClientRect().height))"
    )
    assert small > 9, "text can be read"
    grid.execute_script("document.getElementById('map').scrollIntoView()")
    id = all_of(grid, "#points .point:not(.chosen)")[0].get_attribute("data-id")
    x, y = centre(grid, id)
    touch = {"type": "touchStart", "touchPoints": [{"x": x + 6, "y": y + 6}]}
    grid.execute_cdp_cmd("Input.dispatchTouchEvent", touch)
    grid.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert id in text_of(grid, "numbers")


@pytest.mark.parametrize("dark, paper", [(False, False), (True, False), (True, True)])
def test_ink_stands_out_in_the_light_in_the_dark_and_on_paper(grid, dark, paper):
    look(grid, dark=dark, paper=paper)
    found = grid.execute_script(
        """const style = s => getComputedStyle(document.querySelector(s));
        return [style("body").backgroundColor, style("body").color, style(".note").color,
                style("svg text").fill, style("#controls").display]"""
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
