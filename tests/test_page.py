"""map.html: one file that asks nobody for anything, and does in a browser what it should."""

from __future__ import annotations

import json
import re
import shutil
import subprocess

import analytic_runs
import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.maps.dataset import load_map
from cutbench.maps.page import REST, contents, curve_of, page, page_template, save_page, thinned
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study
from cutbench.run.measures import MEASURES
from cutbench.run.result import Outcome, Result
from cutbench.run.store.runs import Store

GRID = f"""title = "Cohesion </script> & viscosity"
base = "gelatin"
{analytic_runs.AXES}[plot]
mark = ["gelatin"]
"""
SOUGHT = GRID.replace("points = 4\n", "").replace("base", 'mode = "boundary"\nbase').replace(
    "values = [0.01, 0.2, 5.0]", "from = 0.01\nto = 5.0"
) + '[boundary]\nruns = 40\n'  # fmt: skip
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def split_run(case):
    """The stand-in, with a ledger whose parts make up the force."""
    result = analytic_runs.computed(case)
    force = result.curve["force_N"]
    result.curve |= {"force_neo_hookean_N": 0.75 * force, "force_adhesion_N": 0.25 * force}
    return result


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    found = {}
    for name, text in (("grid", GRID), ("sought", SOUGHT)):
        folder = tmp_path_factory.mktemp(name)
        (folder / "study.toml").write_text(text)
        run_study(load_study(folder / "study.toml"), folder, workers=0, run=split_run)
        found[name] = folder
    return found


def data_of(html):
    (text,) = re.findall(r'<script id="data" type="application/json">(.*?)</script>', html, re.S)
    return json.loads(text)


@pytest.mark.parametrize("kind", ["grid", "sought"])
def test_the_page_holds_every_run_with_its_curve_and_split(folders, kind):
    html = (folders[kind] / "map.html").read_text(encoding="utf-8")
    assert not re.search(
        r"""(src|href)\s*=|url\(|import\s|fetch\(|XMLHttp|https?://(?!www\.w3\.org/2000/svg)""", html
    )
    found = data_of(html)
    data = load_map(folders[kind] / "map.nc")
    ids = {id for id in data["run_id"].values.ravel() if id}
    assert {point["id"] for point in found["points"]} == ids and found["title"] == data.attrs["title"]
    store = Store(folders[kind] / "runs")
    for point in found["points"][::5]:
        curve = store.get(point["id"]).curve
        assert point["curve"]["force"] == pytest.approx(curve["force_N"], rel=1e-3)
        assert {"neo_hookean", "adhesion"} <= set(point["curve"]["split"])
        assert sum(map(np.array, point["curve"]["split"].values())) == pytest.approx(
            point["curve"]["force"], abs=2e-3 * max(point["curve"]["force"])
        )
    assert (found["field"] is not None) == (kind == "sought")
    if kind == "sought":
        assert len(found["field"]["margin"]) == np.prod([len(v) for v in found["field"]["values"]])


def test_a_page_without_its_store_has_numbers_and_no_curves(folders, tmp_path):
    data = load_map(folders["grid"] / "map.nc")
    assert save_page(data, None, tmp_path).is_file()
    points = contents(data, None)["points"]
    assert len(points) == 24 and not any("curve" in point for point in points)
    assert points[0]["measures"]["drop_rel"] == pytest.approx(data["drop_rel"].values[0, 0, 0], rel=1e-3)


def test_curves_are_thinned_and_stay_close():
    x = np.linspace(0, 10, 4000)
    y = np.sin(x) + (x > 5)
    keep = thinned(x, y, 60)
    assert keep.size <= 60 and keep[0] == 0 and keep[-1] == 3999
    assert np.abs(np.interp(x, x[keep], y[keep]) - y).max() < 0.03


DRIVE = """<script>
const report = { before: document.querySelectorAll("#map .point").length };
report.marks = document.querySelectorAll("#map .mark").length;
report.title = document.getElementById("title").textContent;
report.line = (document.getElementById("boundary") || { getAttribute: () => "" }).getAttribute("d").length;
const slider = document.querySelector("input[type=range]");
report.levels = Number(slider.max) + 1;
slider.value = "0"; slider.dispatchEvent(new Event("input"));
report.shown = [...document.querySelectorAll("#map .point")].map(p => p.dataset.id).sort();
document.querySelector("#map .point").dispatchEvent(new MouseEvent("mouseenter"));
report.hovered = document.querySelector("#map .point").dataset.id;
report.hint = document.getElementById("hint").textContent;
report.force = document.getElementById("force").getAttribute("points").split(" ").length;
report.split = document.querySelectorAll("#curve .split").length;
report.rows = document.querySelectorAll("#numbers tr").length;
const up = document.getElementById("y");
up.value = "2"; up.dispatchEvent(new Event("change"));
report.swapped = [...document.querySelectorAll("input[type=range]")].map(s => s.id);
const out = document.createElement("pre"); out.id = "report"; out.textContent = JSON.stringify(report);
document.body.appendChild(out);
</script></body>"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
@pytest.mark.parametrize("kind", ["grid", "sought"])
def test_in_a_browser_points_show_their_curves_and_sliders_walk_the_third_axis(folders, kind, tmp_path):
    driven = tmp_path / "driven.html"
    html = page(load_map(folders[kind] / "map.nc"), Store(folders[kind] / "runs"))
    driven.write_text(html.replace("</body>", DRIVE), encoding="utf-8")
    flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--host-resolver-rules=MAP * ~NOTFOUND"]
    flags += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000", "--dump-dom"]
    done = subprocess.run(
        [BROWSER, *flags, driven.as_uri()], capture_output=True, text=True, encoding="utf-8", timeout=120,
        check=False,
    )  # fmt: skip
    (text,) = re.findall(r'<pre id="report">(.*?)</pre>', done.stdout, re.S) or [done.stderr[-2000:]]
    report = json.loads(text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    data = load_map(folders[kind] / "map.nc")
    ids = data["run_id"].isel(adhesion=0).values
    assert report["title"] == "Cohesion </script> & viscosity"
    assert report["levels"] == 2 and report["shown"] == sorted(id for id in ids.ravel() if id)
    assert report["hovered"] in report["hint"] and report["force"] == 6 and report["split"] >= 2
    assert report["rows"] == 3 + len(MEASURES) and report["before"] > 10
    assert report["swapped"] == ["slider-viscosity"] and (report["line"] > 100) == (kind == "sought")


def uneven_run(case):
    """Steps of unequal length, a mechanism that gives back what another takes up, a force that jumps."""
    d = np.cumsum(np.concatenate([[0.0], np.random.default_rng(3).uniform(0.001, 0.05, 400)]))
    force = np.where(d < 4, d, 3.0) + 0.02 * np.sin(40 * d)
    steps = (force[1:] + force[:-1]) / 2  # the mean force over each step, which its work is made of
    given = np.where(d[1:] < 4, 0.3 * steps, -0.8 * steps)
    parts = {"neo_hookean": given, "smith_ferrante": 0.9 * (steps - given), "adhesion": 0.1 * (steps - given)}
    return Result(
        case,
        {"displacement_mm": d, "force_N": force, "time_s": d, "cut_length_mm": 0 * d}
        | {f"force_{name}_N": np.append(0, part) for name, part in parts.items()},
        Outcome("done", "made up", "", float(d[-1])),
    )  # fmt: skip


@pytest.fixture(scope="module")
def uneven():
    case = load_case("gelatin", {"depth": "12 mm"})
    return curve_of(uneven_run(case))


def test_the_parts_of_a_force_are_the_force_at_every_point(uneven):
    force, split = np.array(uneven["force"]), {k: np.array(v) for k, v in uneven["split"].items()}
    assert len(force) < 100 and all(part.shape == force.shape for part in split.values())
    assert sum(split.values()) == pytest.approx(force, abs=2e-3 * force.max())
    assert np.abs(split[REST]).max() < 0.15 * force.max(), "the mechanisms have nearly all of it"
    late = np.array(uneven["d"]) > 4.5
    assert (split["neo_hookean"][late] < 0).all(), "what gives work back is below zero"
    assert split["adhesion"][late] == pytest.approx(0.18 * force[late], rel=0.1)


@pytest.mark.skipif(shutil.which("node") is None, reason="no JavaScript here")
def test_what_the_page_stacks_ends_at_the_force(uneven):
    (code,) = re.findall(r"^function stacked\(split\) \{\n.*?^\}", page_template(), re.S | re.M)
    asked = f"{code}\nconsole.log(JSON.stringify(stacked({json.dumps(uneven['split'])})))"
    bands = json.loads(
        subprocess.run(["node", "-e", asked], capture_output=True, text=True, check=True).stdout
    )
    tops = np.max([band["to"] for band in bands] + [np.zeros(len(uneven["d"]))], axis=0)
    lows = np.min([band["to"] for band in bands] + [np.zeros(len(uneven["d"]))], axis=0)
    assert tops + lows == pytest.approx(np.array(uneven["force"]), abs=2e-3 * max(uneven["force"]))
