"""The workbench in a browser: who may use it, what it refuses; a run, readings and a map in Chromium."""

from __future__ import annotations

import json
import socket
import threading
import time
import urllib.error
import urllib.request
from types import SimpleNamespace

import numpy as np
import pytest

uvicorn = pytest.importorskip("uvicorn", reason="no uvicorn here: the extra 'app'")
pytest.importorskip("starlette", reason="no starlette here: the extra 'app'")
from chromium import NEEDED, a_browser, look  # noqa: E402, F401 (a fixture)
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

from cutbench.app.server import workbench  # noqa: E402

TOKEN = "a-secret"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workbench")
    (folder / "maps" / "mine").mkdir(parents=True)
    (folder / "maps" / "mine" / "map.html").write_text("<h1>a map of mine</h1>")
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        own = uvicorn.Server(uvicorn.Config(workbench(folder, TOKEN), log_level="warning"))
        thread = threading.Thread(target=own.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        while not own.started:
            time.sleep(0.02)
        yield SimpleNamespace(url=f"http://127.0.0.1:{listening.getsockname()[1]}", folder=folder)
        own.should_exit = True
        thread.join(20)


def ask(server, path, body=None, *, method=None, token=TOKEN, host=None):
    """Status and text of an answer."""
    port = server.url.rsplit(":", 1)[1]
    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    request = urllib.request.Request(server.url + path, data=data, method=method)
    if token:
        request.add_header("Cookie", f"cutbench_{port}={token}")
    if host:
        request.add_header("Host", host)
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


# -- who may use it -----------------------------------------------------------------------------------
@pytest.mark.parametrize("path", ["/", "/api/begin", "/files/maps/mine/map.html", "/?token=wrong"])
def test_nobody_reads_without_the_token(server, path):
    for token in (None, "another"):
        assert ask(server, path, token=token)[0] == 403


def test_a_name_that_leads_to_this_machine_from_elsewhere_is_refused(server):
    assert ask(server, "/", host="evil.example")[0] == 400


def test_the_address_with_its_token_opens_the_page_and_is_not_kept_in_it(server):
    jar = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with jar.open(f"{server.url}/?token={TOKEN}", timeout=30) as answer:
        assert "token" not in answer.url and "<h1>cutbench</h1>" in answer.read().decode()
    with jar.open(f"{server.url}/api/jobs", timeout=30) as answer:
        assert json.load(answer) == []


@pytest.mark.parametrize("path", ["/files/../secret", "/files/%2e%2e/secret", "/files/maps/../../secret"])
def test_nothing_outside_the_folder_is_served(server, path):
    (server.folder.parent / "secret").write_text("not yours")
    status, text = ask(server, path)
    assert status >= 400 and "not yours" not in text


# -- what it refuses ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("request_", "key"),
    [
        ({"material": "steel"}, "material"),
        ({"tool": "spoon"}, "tool"),
        ({"values": {"G": "8"}}, "G"),
        ({"values": {"G": "8 mm"}}, "G"),
        ({"values": {"nu": "0.7"}}, "nu"),
        ({"values": {"depth": "30 mm"}}, "depth"),
        ({"values": 3}, "values"),
        ({"numerics": "finest"}, "numerics"),
        ({"command": "rm"}, "command"),
    ],
)
def test_what_cannot_be_run_is_refused_by_its_name(server, request_, key):
    for path in ("/api/check", "/api/runs"):
        status, text = ask(server, path, request_)
        assert (status, json.loads(text)["key"]) == (400, key)
    assert not list(server.folder.glob("run-*"))


def test_a_slip_of_a_unit_is_said_before_the_run(server):
    status, text = ask(server, "/api/check", {"values": {"G": "7.5 MPa"}})
    assert status == 200 and json.loads(text)["doubts"]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("curve.exe", b"a,b\n1,2"),
        ("..%2Fcurve.csv", b"a,b"),
        ("empty.csv", b""),
        ("image.csv", b"\x89PNG\0\0\0"),
    ],
)
def test_what_is_no_table_is_not_kept(server, name, content):
    before = {*server.folder.rglob("*")}
    assert ask(server, f"/api/files/{name}", content, method="PUT")[0] >= 400
    assert {p for p in {*server.folder.rglob("*")} - before if p.is_file()} == set()


def test_readings_are_refused_as_on_the_command_line(server):
    table = b"u [mm],F [N]\n0.1,0.2\n0.2,broken\n0.3,0.6\n"
    assert ask(server, "/api/files/broken.csv", table, method="PUT")[0] == 201
    asked = {
        "task": "fit",
        "files": ["broken.csv"],
        "kind": "uniaxial",
        "columns": {"displacement": "u", "force": "F"},
        "specimen": {"length": "40 mm", "area": "20 mm^2"},
    }
    status, text = ask(server, "/api/campaigns", asked)
    said = json.loads(text)["error"]
    assert status == 400 and "broken.csv" in said and "line 3" in said
    assert ask(server, "/api/campaigns", {**asked, "files": ["other.csv"]})[0] == 400
    assert ask(server, "/api/campaigns", {**asked, "task": "delete"})[0] == 400


# -- in a browser -------------------------------------------------------------------------------------
def text_of(browser, css):
    return browser.find_element(By.CSS_SELECTOR, css).text


def fill(browser, css, text):
    field = browser.find_element(By.CSS_SELECTOR, css)
    field.clear()
    field.send_keys(text)


@pytest.fixture
def page(browser, server):
    look(browser)
    browser.get(f"{server.url}/?token={TOKEN}")
    WebDriverWait(browser, 20).until(lambda b: b.find_elements(By.CSS_SELECTOR, "#groups td"))
    browser.get_log("browser")
    return browser


def within(seconds, browser, condition):
    return WebDriverWait(browser, seconds, poll_frequency=0.1).until(condition)


@NEEDED
def test_a_slider_and_its_number_are_one_and_groups_follow(page):
    def group():
        return page.execute_script("return document.querySelector('#groups tr:nth-child(2) td').textContent")

    before = group()
    page.execute_script(
        "const r = document.querySelector('#value-G').parentElement.querySelector('[type=range]');"
        "r.value = 0.75; r.oninput();"
    )
    assert float(page.find_element(By.ID, "value-G").get_property("value")) > 20
    within(10, page, lambda b: group() != before)
    fill(page, "#value-G", "-3")
    within(10, page, lambda b: "G" in text_of(b, "#fault"))
    assert not page.find_element(By.ID, "start").is_enabled()
    page.find_element(By.ID, "reset").click()
    within(10, page, lambda b: not text_of(b, "#fault") and b.find_element(By.ID, "start").is_enabled())
    assert group() == before


@NEEDED
def test_a_run_grows_in_the_page_and_is_kept(page, server):
    fill(page, "#value-depth", "0.25")
    Select(page.find_element(By.ID, "until")).select_by_value("depth")
    within(10, page, lambda b: b.find_element(By.ID, "start").is_enabled())
    page.find_element(By.ID, "start").click()
    within(90, page, lambda b: b.find_elements(By.CSS_SELECTOR, "#files a"))
    assert "0.25 mm" in text_of(page, "#said")
    (kept,) = server.folder.glob("run-*/run.json")
    assert json.loads(kept.read_text())["outcome"]["kind"] == "done"
    curve = page.execute_script("return curves.at(-1)")
    assert len(curve["mm"]) > 3 and np.all(np.diff(curve["N"]) > 0)
    section = page.execute_script("return section")
    assert np.isclose(section["mm"], 0.25) and len(section["x"]) == len(section["kPa"])
    assert max(page.execute_script("return cells")) < len(section["x"])
    look(page, width=390, touch=True)
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth")
    assert not [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"]


@pytest.mark.slow
@NEEDED
def test_a_run_can_be_stopped(page):
    page.find_element(By.ID, "start").click()
    within(60, page, lambda b: b.execute_script("return curves.at(-1)?.mm.length > 1"))
    page.find_element(By.ID, "stop").click()
    within(20, page, lambda b: "stopped" in text_of(b, "#said"))
    assert page.find_element(By.ID, "start").is_enabled()


@NEEDED
def test_readings_become_a_fit(page, server, tmp_path):
    stretch = np.linspace(1.02, 1.6, 30)
    load = 20 * 0.05 * (stretch - stretch**-2) + 1e-3 * np.sin(40 * stretch)
    rows = [f"{40 * (s - 1):.4f},{F:.5f}" for s, F in zip(stretch, load, strict=True)]
    (tmp_path / "pull.csv").write_text("\n".join(["u [mm],F [N]", *rows]))
    page.find_element(By.ID, "tab-data").click()
    page.find_element(By.ID, "file").send_keys(str(tmp_path / "pull.csv"))
    within(10, page, lambda b: "pull.csv" in text_of(b, "#kept"))
    Select(page.find_element(By.ID, "kind")).select_by_value("uniaxial")
    assert page.find_element(By.ID, "column-force").get_property("value") == "F [N]"
    Select(page.find_element(By.ID, "zero")).select_by_value("auto")
    page.find_element(By.CSS_SELECTOR, "[value=fit]").click()
    within(10, page, lambda b: text_of(b, "#data-fault"))  # a length is missing, as on the command line
    assert 'zero = "auto"' in (server.folder / "readings" / "campaign.toml").read_text(encoding="utf-8")
    Select(page.find_element(By.ID, "zero")).select_by_value("")
    fill(page, "#specimen-length", "40 mm")
    fill(page, "#specimen-area", "20 mm^2")
    page.find_element(By.CSS_SELECTOR, "[value=fit]").click()
    within(90, page, lambda b: b.find_elements(By.CSS_SELECTOR, "#data-files a"))
    (kept,) = server.folder.glob("fit-*/fit.json")
    assert kept.is_file() and (kept.parent / "campaign.toml").is_file()
    assert "G" in text_of(page, "#found")


@NEEDED
def test_a_map_of_the_folder_is_opened(page):
    page.find_element(By.ID, "tab-maps").click()
    frame = page.find_element(By.ID, "map-page")
    within(10, page, lambda b: frame.is_displayed() and "mine/map.html" in frame.get_property("src"))
    page.switch_to.frame(frame)
    within(10, page, lambda b: "a map of mine" in b.page_source)
    page.switch_to.default_content()
