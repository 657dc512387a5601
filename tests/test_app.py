"""The workbench in a browser: who may use it, what it refuses; a cut, a map and readings in Chromium."""

from __future__ import annotations

import http.client
import json
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="no NiceGUI here: the extra 'app'")
from chromium import NEEDED, a_browser, look  # noqa: F401 (a fixture)
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

import cutbench
from cutbench.app import campaigns, drawings, studies
from cutbench.app.case_choices import Choice, keep_case_files, save_case
from cutbench.base.errors import BadInput


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workbench")
    (folder / "maps" / "mine").mkdir(parents=True)
    (folder / "maps" / "mine" / "map.html").write_text("<h1>a map of mine</h1>")
    (folder.parent / "secret").write_text("not yours")
    # A framework that sees pytest behaves otherwise.
    own = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    command = [sys.executable, "-m", "cutbench", "app", str(folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=own) as process:
        address = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", process.stdout.readline())
        yield SimpleNamespace(address=address[0], port=int(address[1]), token=address[2], folder=folder)
        process.terminate()


def ask(server, path, *, token=None, **headers):
    """Status and text of an answer."""
    if token:
        headers["Cookie"] = f"cutbench_{server.port}={token}"
    asked = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    asked.request("GET", path, headers={name.replace("_", "-"): text for name, text in headers.items()})
    answer = asked.getresponse()
    return answer.status, answer.read().decode() if answer.status != 101 else ""


# -- who may use it -----------------------------------------------------------------------------------
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
UPGRADE = {
    "Connection": "Upgrade", "Upgrade": "websocket", "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
}  # fmt: skip


@pytest.mark.parametrize(
    "path", ["/", "/files/maps/mine/map.html", "/?token=wrong", "/_nicegui_ws/socket.io/?EIO=4"]
)
def test_nobody_reads_without_the_token(server, path):
    assert ask(server, path)[0] == ask(server, path, token="another")[0] == 403


def test_a_socket_is_opened_for_this_page_alone(server):
    assert ask(server, SOCKET, **UPGRADE)[0] == 403
    right = {"token": server.token, **UPGRADE}
    assert ask(server, SOCKET, **right, Origin="http://127.0.0.1:1")[0] == 403
    assert ask(server, SOCKET, **right, Origin=f"http://127.0.0.1:{server.port}")[0] == 101


def test_a_name_that_leads_to_this_machine_from_elsewhere_is_refused(server):
    assert ask(server, "/", token=server.token, Host="evil.example")[0] == 400


def test_the_address_with_its_token_opens_the_page_and_is_not_kept_in_it(server):
    asked = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    asked.request("GET", f"/?token={server.token}")
    answer = asked.getresponse()
    assert answer.status == 303 and answer.getheader("Location") == "/"
    assert "HttpOnly" in answer.getheader("Set-Cookie")
    status, page = ask(server, "/", token=server.token)
    assert status == 200 and server.token not in page


@pytest.mark.parametrize("path", ["/files/../secret", "/files/%2e%2e/secret", "/files/maps/../../secret"])
def test_nothing_outside_the_folder_is_served(server, path):
    status, text = ask(server, path, token=server.token)
    assert status >= 400 and "not yours" not in text


def test_without_the_framework_it_says_what_to_install(tmp_path):
    command = "import sys; sys.modules['nicegui'] = None; from cutbench.cli.main import main; main()"
    run = [sys.executable, "-c", command, "app", str(tmp_path)]
    ended = subprocess.run(run, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 2 and "cutbench[app]" in ended.stderr and "Traceback" not in ended.stderr


# -- what it refuses ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("choice", "key"),
    [
        (Choice(material="steel"), "material"),
        (Choice(blade="spoon"), "tool"),
        (Choice(texts={"G": "-3"}), "G"),
        (Choice(texts={"G": "8 mm"}), "G"),
        (Choice(texts={"nu": "0.7"}), "nu"),
        (Choice(texts={"depth": "30 mm"}), "depth"),
        (Choice(texts={"depth": ""}), "depth"),
        (Choice(numerics="finest"), "numerics"),
    ],
)
def test_what_cannot_be_run_is_refused_by_its_name(choice, key):
    with pytest.raises(BadInput) as error:
        choice.case()
    assert error.value.key == key


def test_a_number_has_the_unit_of_its_parameter_and_a_slip_of_it_is_said():
    assert Choice(texts={"G": "8"}).case().shown()["G"] == "8 kPa"
    assert Choice(texts={"G": "7.5 MPa"}).case().doubts


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("curve.exe", b"a,b\n1,2"),
        ("../curve.csv", b"a,b"),
        ("empty.csv", b""),
        ("image.csv", b"\x89PNG\0\0\0"),
    ],
)
def test_what_is_no_table_is_not_kept(tmp_path, name, content):
    with pytest.raises(BadInput):
        campaigns.keep_file(tmp_path / "kept", name, content)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_readings_are_refused_as_on_the_command_line(tmp_path):
    head = campaigns.keep_file(tmp_path, "broken.csv", b"u [mm],F [N]\n0.1,0.2\n0.2,broken\n0.3,0.6\n")
    columns = campaigns.likely_columns(head, "uniaxial")
    assert columns == {"displacement": "u [mm]", "force": "F [N]", "time": ""}
    asked = {
        "files": ["broken.csv"], "kind": "uniaxial", "columns": columns,
        "specimen": {"length": "40 mm", "area": "20 mm^2"},
    }  # fmt: skip
    with pytest.raises(BadInput) as error:
        campaigns.write_campaign(tmp_path, asked, Choice().start())
    assert "broken.csv" in error.value.file and error.value.line == 3
    with pytest.raises(BadInput):
        campaigns.write_campaign(tmp_path, {**asked, "files": ["other.csv"]}, Choice().start())


def test_measured_cuts_have_any_blade_and_tables_any_encoding(tmp_path):
    rows = "\n".join(f"{0.1 * k:.1f};{0.05 * k:.2f}" for k in range(60))
    table = f"Weg [mm];Kraft (längs) [N]\n{rows}\n"
    head = campaigns.keep_file(tmp_path, "schnitt.csv", table.encode("latin-1"))
    assert campaigns.column_names(head) == ["Weg [mm]", "Kraft (längs) [N]"]
    start = Choice("gelatin", "wedge").start()
    sizes = campaigns.sizes_of("cut", start)
    assert sizes["blade"]["angle"] == "20 deg" and sizes["specimen"]["width"] == "30 mm"
    asked = {"files": ["schnitt.csv"], "kind": "cut", "speed": "1 mm/s", **sizes}
    asked["columns"] = {k: v for k, v in campaigns.likely_columns(head, "cut").items() if v}
    campaign = cutbench.load_campaign(campaigns.write_campaign(tmp_path, asked, start))
    assert campaign.base.model.tool.name == "wedge"


# -- files of one's own -------------------------------------------------------------------------------
def test_a_material_and_a_blade_are_files_that_the_command_line_takes(tmp_path):
    made = Choice(blade="wedge", texts={"G": "9", "angle": "25", "depth": "8"}, until="depth").case()
    saved = save_case(made, "my gel", tmp_path)
    assert cutbench.load_case(saved).set(numerics="fast").id == made.id
    other = Choice(material="elastomer", blade=str(saved)).case()
    assert other.shown()["angle"] == "25 deg" and other.shown()["G"] != "9 kPa"
    assert other.mechanisms == Choice(material="elastomer", blade="wedge").case().mechanisms
    assert keep_case_files(tmp_path / "in", [("a.toml", saved.read_bytes())])
    for name, text in (("b.toml", b"G = 3"), ("b.exe", b""), ("../b.toml", b"")):
        with pytest.raises(BadInput):
            keep_case_files(tmp_path / "in", [(name, text)])
    assert [path.name for path in (tmp_path / "in").iterdir()] == ["a.toml"]
    with pytest.raises(BadInput):
        save_case(made, "gelatin", tmp_path)


@pytest.mark.parametrize(
    ("way", "mode"), [("estimate", "boundary"), ("boundary", "boundary"), ("grid", "grid")]
)
def test_a_map_of_a_case_is_a_study_that_the_command_line_takes(tmp_path, way, mode):
    case = Choice().case()
    known = studies.axis_choices(case)
    axes = [(known["cohesion"], "4", "12"), (known["speed"], "0.01", "0.1 mm/s")]
    study = cutbench.load(studies.write_study(case, axes, way, 12, tmp_path / "map"))
    assert study.mode == mode and [axis.name for axis in study.axes] == ["cohesion", "speed"]
    with pytest.raises(BadInput):
        studies.write_study(case, [(known["speed"], "0.1", "0.01")], way, 4, tmp_path / "wrong")
    assert not (tmp_path / "wrong").exists()


def test_curves_are_saved_as_a_picture_and_a_table():
    curve = drawings.Curve.of_estimate(cutbench.estimate("gelatin"))
    plain = drawings.Curve('a "run"', curve.mm[:3], curve.N[:3])
    assert drawings.curves_png([curve, plain]).startswith(b"\x89PNG")
    rows = drawings.curves_csv([curve, plain]).splitlines()
    assert len(rows) == 1 + curve.mm.size + 3 and all(row.count(",") >= 4 for row in rows)


# -- in a browser -------------------------------------------------------------------------------------
def one(browser, mark):
    return browser.find_element(By.CSS_SELECTOR, f'[data-testid="{mark}"]')


def fill(browser, mark, text):
    one(browser, mark).send_keys(Keys.CONTROL, "a")
    one(browser, mark).send_keys(text)


def within(seconds, browser, condition):
    return WebDriverWait(browser, seconds, poll_frequency=0.1).until(condition)


def choose(browser, mark, text):
    one(browser, mark).click()
    options = ".q-menu [role=option]"
    within(5, browser, lambda b: b.find_elements(By.CSS_SELECTOR, options))
    next(o for o in browser.find_elements(By.CSS_SELECTOR, options) if o.text == text).click()


@pytest.fixture
def page(browser, server):
    look(browser, width=1280)
    browser.get(server.address)
    within(20, browser, lambda b: b.find_elements(By.CSS_SELECTOR, ".scatterlayer .trace"))
    browser.get_log("browser")
    return browser


@NEEDED
def test_the_page_begins_with_an_answer_for_gelatin(page):
    found = cutbench.estimate("gelatin")
    assert found.verdict in one(page, "verdict").text.lower()
    assert page.find_element(By.CSS_SELECTOR, "svg.specimen").is_displayed()
    names = page.execute_script("return performance.getEntriesByType('resource').map(r => r.name)")
    assert all("//127.0.0.1:" in name for name in names), "nothing comes from elsewhere"


@NEEDED
def test_a_slider_and_its_number_are_one_and_the_answer_follows(page):
    before, drawn = one(page, "verdict").text, page.find_element(By.CSS_SELECTOR, ".specimen .blade")
    outline = drawn.get_attribute("points")
    track = one(page, "slide-thickness").find_element(By.CSS_SELECTOR, "[tabindex='0']")
    track.send_keys(Keys.ARROW_RIGHT * 30)
    within(10, page, lambda b: float(one(b, "value-thickness").get_property("value")) > 0.75)
    blade = (By.CSS_SELECTOR, ".specimen .blade")
    within(10, page, lambda b: b.find_element(*blade).get_attribute("points") != outline)
    assert one(page, "verdict").text != before
    fill(page, "value-G", "-3")
    within(10, page, lambda b: "G" in one(b, "fault").text)
    assert not one(page, "start").is_enabled()
    one(page, "reset").click()
    within(10, page, lambda b: not one(b, "fault").text and one(b, "start").is_enabled())
    within(10, page, lambda b: one(b, "verdict").text == before)


@NEEDED
def test_a_run_grows_in_the_page_and_is_kept(page, server):
    fill(page, "value-depth", "0.25")
    choose(page, "until", "the full depth")
    within(10, page, lambda b: "0.25" in one(b, "verdict").text)
    one(page, "start").click()
    within(120, page, lambda b: one(b, "files").text)
    assert "0.25 mm" in one(page, "said").text
    (kept,) = server.folder.glob("run-*/run.json")
    assert json.loads(kept.read_text())["outcome"]["kind"] == "done"
    shown = "return document.querySelector('.js-plotly-plot').data.map(t => [t.name || '', t.x.length])"
    within(10, page, lambda b: any("run-1" in name and n > 3 for name, n in b.execute_script(shown)))
    assert page.find_element(By.CSS_SELECTOR, ".section").is_displayed()
    assert not [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"]


@pytest.mark.slow
@NEEDED
def test_a_run_can_be_stopped_and_keeps_what_it_has(page, server):
    one(page, "start").click()
    running = "return document.querySelectorAll('.js-plotly-plot .scatterlayer .trace').length"
    within(120, page, lambda b: b.execute_script(running) > 3 and "mm" in one(b, "job").text)
    one(page, "stop").click()
    within(30, page, lambda b: one(b, "job").text.endswith("stopped"))
    kinds = {json.loads(p.read_text())["outcome"]["kind"] for p in server.folder.glob("run-*/run.json")}
    assert "interrupted" in kinds


@NEEDED
def test_a_map_is_estimated_and_one_of_the_folder_is_opened(page, server):
    one(page, "tab-maps").click()
    within(10, page, lambda b: "mine/map.html" in one(b, "map-page").get_property("src"))
    page.switch_to.frame(one(page, "map-page"))
    within(10, page, lambda b: "a map of mine" in b.page_source)
    page.switch_to.default_content()
    one(page, "start-map").click()
    within(60, page, lambda b: b.find_elements(By.LINK_TEXT, "phase.png"))
    assert (server.folder / "map-1" / "map.nc").is_file()
    within(10, page, lambda b: "map-1/map.html" in one(b, "map-page").get_property("src"))


@NEEDED
def test_readings_become_a_fit(page, server, tmp_path):
    stretch = np.linspace(1.02, 1.6, 30)
    load = 20 * 0.05 * (stretch - stretch**-2) + 1e-3 * np.sin(40 * stretch)
    rows = [f"{40 * (s - 1):.4f},{F:.5f}" for s, F in zip(stretch, load, strict=True)]
    (tmp_path / "pull.csv").write_text("\n".join(["u [mm],F [N]", *rows]))
    one(page, "tab-measured").click()
    within(10, page, lambda b: one(b, "kind").is_displayed())
    page.find_element(By.CSS_SELECTOR, ".drop input[type=file]").send_keys(str(tmp_path / "pull.csv"))
    within(10, page, lambda b: "pull.csv" in one(b, "kept").text)
    choose(page, "kind", campaigns.KINDS["uniaxial"])
    within(10, page, lambda b: b.find_elements(By.CSS_SELECTOR, '[data-testid="specimen-area"]'))
    one(page, "fit").click()
    within(10, page, lambda b: one(b, "data-fault").text)  # a length is missing, as on the command line
    fill(page, "specimen-length", "40 mm")
    fill(page, "specimen-area", "20 mm^2")
    within(10, page, lambda b: one(b, "specimen-area").get_property("value") == "20 mm^2")
    one(page, "fit").click()
    within(90, page, lambda b: [e for e in b.find_elements(By.LINK_TEXT, "fit.json") if e.is_displayed()])
    (kept,) = server.folder.glob("fit-*/fit.json")
    assert "F [N]" in (kept.parent / "campaign.toml").read_text(encoding="utf-8")
    assert "fit.png" in one(page, "found-picture").find_element(By.TAG_NAME, "img").get_property("src")


@NEEDED
@pytest.mark.parametrize("dark", [False, True])
def test_on_a_phone_every_page_fits_by_day_and_night(page, dark):
    look(page, width=390, touch=True, dark=dark)
    for tab in ("maps", "measured", "cut"):
        one(page, f"tab-{tab}").click()
        within(10, page, lambda b: b.execute_script("return document.documentElement.scrollWidth") <= 390)
    named = """return [...document.querySelectorAll('button, input, [role=slider], [role=tab]')]
        .filter(e => e.offsetParent && !e.getAttribute('aria-label') && !e.textContent.trim()
            && !(e.labels && e.labels.length)).map(e => e.outerHTML)"""
    assert page.execute_script(named) == [], "all that can be used has a name"
    ink = "return getComputedStyle(document.querySelector('.js-plotly-plot .xtick text')).fill"
    within(10, page, lambda b: (int(re.findall(r"\d+", b.execute_script(ink))[0]) > 128) == dark)
