"""What four people do on their first day, by nothing but commands, files and pages: a food engineer, a
student, an experimentalist and a designer."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import instrument
import pytest
from chromium import BROWSER, DRIVER, a_browser, look  # noqa: F401 (a fixture)

from cutbench.base.threads import ONE_THREAD

ROOT = Path(__file__).resolve().parents[1]
#: Machine time in s until each has a first right answer, and for the whole way of the food engineer.
FIRST_S = {"engineer": 60, "student": 60, "experimentalist": 180, "designer": 60}
MOST_S = 300

pytestmark = pytest.mark.slow


@pytest.fixture
def cutbench(tmp_path):
    """The command line as a terminal has it, in a folder of its own: words in, what is said out."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    env = {**os.environ, **ONE_THREAD, "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}

    def call(line: str, status: int = 0) -> str:
        words = re.findall(r"'([^']*)'|(\S+)", line)
        done = subprocess.run(
            [sys.executable, "-m", "cutbench", *("".join(word) for word in words)],
            cwd=tmp_path, env=env, capture_output=True, text=True, encoding="utf-8", check=False, timeout=900,
        )  # fmt: skip
        said = done.stdout + done.stderr
        assert done.returncode == status and "Traceback" not in said, f"{line}\n{said}"
        return said

    return call


@pytest.fixture
def edit(tmp_path):
    """Change words of a file, as a person does in an editor; each is there."""

    def change(name: str, *changes: tuple[str, str]) -> None:
        text = (tmp_path / name).read_text("utf-8")
        for old, new in changes:
            assert old in text, f"{name} has no {old}"
            text = text.replace(old, new, 1)
        (tmp_path / name).write_text(text, "utf-8")

    return change


@pytest.fixture
def page(tmp_path, request):
    """Open a page: a browser that shows it, or None where there is none."""

    def open_page(name: str):
        if not (BROWSER and DRIVER):
            return None
        browser = request.getfixturevalue("browser")
        look(browser)
        browser.get((tmp_path / name).as_uri())
        assert browser.get_log("browser") == []
        return browser

    return open_page


@pytest.fixture
def used():
    """Machine time in s of the processes that a test has begun and that have ended."""
    resource = pytest.importorskip("resource", reason="no account of processes' time here")

    def since(before: float = 0.0) -> float:
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"{spent.ru_utime + spent.ru_stime - before:.1f} s of machine time")  # pytest -rP shows it
        return spent.ru_utime + spent.ru_stime - before

    return partial(since, since())


#: A cheese, by numbers of one's own in place of the dimensionless ones that a new file begins with.
CHEESE = (('G = "7.5 kPa"', 'G = "30 kPa"'), ("cohesion = 10.1", 'G_c = "10 J/m^2"'))
FIRM = (('G = "7.5 kPa"', 'G = "15 kPa"'), ("cohesion = 10.1", 'G_c = "2 J/m^2"'))


def test_a_food_engineer_learns_how_a_cheese_is_cut_and_what_would_change_it(cutbench, edit, used, tmp_path):
    assert "cutbench estimate" in cutbench("")
    assert "cheese.toml" in cutbench("materials --new cheese")
    edit("cheese.toml", *CHEESE)
    said = cutbench("estimate cheese.toml")
    expected = re.search(r"(abrupt|smooth), as good as sure: .* falls by [\d.]+ \[([\d.]+), ([\d.]+)\]", said)
    assert expected and used() < FIRST_S["engineer"], said

    verdict = re.compile(r"^(abrupt|smooth): the force falls by (\d+) %", re.M)
    said = cutbench("run2d cheese.toml --until transition --out cut")
    regime, percent = verdict.search(said).groups()
    assert regime == expected[1] and 100 * float(expected[2]) < int(percent) < 100 * float(expected[3])
    written = {path.name for path in (tmp_path / "cut").iterdir()}
    assert {"run.json", "curve.csv", "curve.png", "section.png"} <= written
    for tool in ("wire --set 'thickness=0.3 mm'", "wedge --set 'angle=20 deg' --set 'edge_radius=0.1 mm'"):
        name = tool.partition(" ")[0]
        assert name in cutbench(f"estimate cheese.toml --with {name}", status=2), "no estimate is one"
        said = cutbench(f"run2d cheese.toml --with {tool} --until transition --quick --out {name}")
        assert verdict.search(said), said

    cutbench("new study map.toml")
    edit("map.toml", ('base = "gelatin"', 'base = "cheese.toml"'), ("runs = 17", "runs = 9"))
    edit("map.toml", ('mark = ["gelatin"]', 'mark = ["cheese.toml"]'), ('from = "4 kPa"', 'from = "15 kPa"'))
    cutbench("sweep map.toml --estimate --out first")
    assert "cheese" in (tmp_path / "first" / "map.html").read_text("utf-8")
    assert re.search(r"\d+ runs", cutbench("sweep map.toml --out map --dry-run"))
    said = cutbench("sweep map.toml --out map --workers 1")
    assert "cheese" in said
    said = cutbench("guide map --material cheese.toml")
    assert re.search(r"\b(abrupt|smooth|undecided)\b", said)
    assert re.search(r"^ +1\. .* -> .*(mm/s|kPa)", said, re.M), said
    assert used() < MOST_S


LAW = '''"""Square: Ψ = G/2 (x + s x²), x = Ī₁ − 3. Stiffens with strain; neo-Hooke for s = 0."""

from cutbench.mechanisms import Isochoric, NeoHookean, Parameter


class Square(Isochoric):
    """Strain stiffening by the square of the first invariant."""

    name = "square"
    title = "square stiffening"
    role = "isochoric"
    parameters = (*NeoHookean.parameters, Parameter.effect("s", "1", "s", "strain stiffening", typical=0.1))

    def groups(self, p):
        return {"s": p.s}

    def dW_dI1(self, I1, p, at):
        return p.G / 2 * (1 + 2 * p.s * (I1 - 3))

    def W(self, I1, p, at):
        return p.G / 2 * ((I1 - 3) + p.s * (I1 - 3) ** 2)
'''
TOOL = '''"""A blade whose tip is so many times as long as half its thickness."""

from cutbench.mechanisms import Contact, Parameter

THICKNESS, _, *PLACED = Contact.parameters


class Slim(Contact):
    """Contact with a blade of known slenderness."""

    name = "slim"
    title = "contact (slenderness)"
    edge = ("slenderness", "half the thickness over its square")
    settable = ()
    parameters = (
        THICKNESS,
        Parameter.positive("slenderness", "1", "k", "tip over half the thickness", default=3.0, sought=False),
        *PLACED,
    )

    def groups(self, p):
        return {"k": p.slenderness}

    def half_axes(self, p):
        return p.thickness / 2, p.slenderness * p.thickness / 2

    def edge_for(self, p, radius):
        return (p.thickness / 2 / radius) ** 0.5
'''
STIFF = """base = "gelatin"
mechanisms = ["square", "volumetric", "stiff_cohesion", "viscous_degraded", "slim", "adhesion"]

[protocol]
depth = "0.5 mm"

[numerics]
h = "0.7 mm"

[[axis]]
name = "s"
values = [0.0, 1.0]
"""


def test_a_student_has_a_law_and_a_tool_of_their_own_everywhere(cutbench, edit, used, tmp_path):
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "square.py").write_text(LAW.replace("2 * p.s * (I1", "p.s * (I1"), "utf-8")
    (tmp_path / "laws" / "slim.py").write_text(TOOL, "utf-8")
    assert "FAILED" in cutbench("mechanisms --check laws/square.py", status=1), "a slip in the derivative"
    (tmp_path / "laws" / "square.py").write_text(LAW, "utf-8")
    assert " 0 failed" in cutbench("mechanisms --check laws")
    assert "slenderness" in cutbench("mechanisms slim --mechanisms laws")

    own = "--mechanisms laws --with square --with slim"
    refused = cutbench(f"run2d gelatin {own} --set slenderness=90 --h 0.7", status=2)
    most = float(re.search(r"slenderness of at most ([\d.]+)\W*$", refused.strip())[1])
    cutbench(f"run2d gelatin {own} --set slenderness={most} --set s=0.3 --depth 0.5 --h 0.7 --out cut")
    ran = json.loads((tmp_path / "cut" / "run.json").read_text("utf-8"))
    assert {"square", "slim"} <= set(ran["case"]["mechanisms"]) and used() < FIRST_S["student"]
    assert "--mechanisms" in cutbench("run2d gelatin --with square", status=2), "what was forgotten is named"

    (tmp_path / "stiff.toml").write_text(STIFF, "utf-8")
    assert "2 of 2 runs" in cutbench("sweep stiff.toml --mechanisms laws --out map --workers 2")
    cutbench("runs map --mechanisms laws --columns s,max_N --csv runs.csv")
    with (tmp_path / "runs.csv").open(encoding="utf-8", newline="") as file:
        rows = [(float(row["s"]), float(row["max_N"])) for row in csv.DictReader(file)]
    (none, soft), (_, stiff) = sorted(rows)
    assert none == 0 and stiff > 1.01 * soft

    cutbench("new campaign pulled.toml")
    edit("pulled.toml", ("[fit]", 'candidates = ["square"]\n\n[fit]'))
    said = cutbench("discover pulled.toml --mechanisms laws --out found --workers 0")
    assert "square stiffening" in next(line for line in said.splitlines() if line.startswith("What"))
    assert "square stiffening" in (tmp_path / "found" / "discovery.html").read_text("utf-8")


HELD = """title = "Gel, pulled and held"
material = "gelatin"
baseline = ["neo_hookean", "volumetric"]

[fit]
free = ["G"]

[[experiment]]
id = "held"
kind = "uniaxial"
data = "held.csv"
columns = { displacement = "Distance", force = "Force", time = "time", repetition = "specimen" }
specimen = { length = "40 mm", area = "25 mm^2" }
"""
CUT = """title = "Gel, cut"
material = "gelatin"
baseline = "default"

[parameters]
G_c = "2.1 J/m^2"

[numerics]
h = "0.7 mm"

[fit]
free = ["G_c"]

[[experiment]]
id = "cut"
kind = "cut"
data = "cut/curve.csv"
columns = { displacement = "displacement_mm", force = "force_N", time = "time_s" }
until = "3 mm"
specimen = { width = "30 mm", length = "30 mm", height = "21 mm" }
blade = { thickness = "0.7 mm", tip = "1.05 mm" }
"""


def test_an_experimentalist_brings_files_as_they_come_and_gets_causes(cutbench, edit, page, used, tmp_path):
    instrument.write_export(tmp_path / "gel.csv", returned=True, stiffening=2.0, seed=2)
    cutbench("new campaign press.toml")
    edit("press.toml", ('"press-readings.csv"', '"gel.csv"'), ('kind = "uniaxial"', 'kind = "compression"'))
    said = cutbench("data press.toml", status=2)
    assert "uniaxial" in said and "factors" in said
    edit("press.toml", ('"compression"', '"uniaxial"'))
    # The lines for a pressed cylinder stand in the file, switched off: they take the place of a strip's.
    head, _, rest = (tmp_path / "press.toml").read_text("utf-8").partition("columns =")
    pressed = re.findall(
        r"^# ((?:columns|factors|specimen|zero|force_zero) = .*)$", rest.partition("# A cut:")[0], re.M
    )
    (tmp_path / "press.toml").write_text("\n".join([head, *pressed]), "utf-8")
    said = cutbench("data press.toml --out data")
    assert "gelatin" in said and " mm" in said
    assert (tmp_path / "data" / "data.png").stat().st_size > 1000

    cutbench("fit press.toml --out fit --workers 0")
    assert json.loads((tmp_path / "fit" / "fit.json").read_text("utf-8"))
    assert used() < FIRST_S["experimentalist"]
    said = cutbench("discover press.toml --out found --workers 0")
    verdict = next(line for line in said.splitlines() if line.startswith("What the baseline lacks"))
    assert "strain stiffening" in verdict
    shown = page("found/discovery.html")
    text = shown.execute_script("return document.body.innerText") if shown else ""
    assert "strain stiffening" in (text or (tmp_path / "found" / "discovery.html").read_text("utf-8"))
    if shown:
        assert shown.execute_script("return document.querySelectorAll('svg, img').length") > 0
        assert shown.execute_script("return document.documentElement.scrollWidth <= innerWidth")

    instrument.write_held(tmp_path / "held.csv", g=0.6, tau=8.0)
    (tmp_path / "held.toml").write_text(HELD, "utf-8")
    said = cutbench("discover held.toml --out held --workers 0")
    added = next(line for line in said.splitlines() if line.endswith("<- added"))
    assert float(re.search(r"g\S* = ([\d.]+)", added)[1]) == pytest.approx(0.6, rel=0.1), added

    cutbench("run2d gelatin --h 0.7 --set 'G_c=1.6 J/m^2' --until transition --out cut")
    (tmp_path / "cut.toml").write_text(CUT, "utf-8")
    said = cutbench("fit cut.toml --out toughness --workers 0 --no-refine")
    assert float(re.search(r"^  G_c +([\d.]+) J/m", said, re.M)[1]) == pytest.approx(1.6, rel=0.05), said


SPEEDS = """title = "Two speeds"
base = "firm.toml"

[protocol]
depth = "2.5 mm"
until = "transition"

[numerics]
h = "0.7 mm"

[[axis]]
name = "speed"
values = ["0.04 mm/s", "0.2 mm/s"]
scale = "log"

[plot]
mark = ["lab/firmer.toml"]
"""


def test_a_designer_sees_a_material_of_their_own_on_the_map(cutbench, edit, page, used, tmp_path):
    cutbench("materials --new 'firm gel' firm.toml")
    edit("firm.toml", *FIRM)
    (tmp_path / "lab").mkdir()
    cutbench("materials --new 'our gel' lab/firmer.toml")
    edit("lab/firmer.toml", ('G = "7.5 kPa"', 'G = "18 kPa"'), FIRM[1], ('"0.021 mm/s"', '"0.1 mm/s"'))
    (tmp_path / "speeds.toml").write_text(SPEEDS, "utf-8")
    expected = re.search(r"(abrupt|smooth), as good as sure", cutbench("estimate lab/firmer.toml"))
    cutbench("sweep speeds.toml --estimate --out first")
    assert '"our gel"' in (tmp_path / "first" / "map.html").read_text("utf-8")
    assert expected and used() < FIRST_S["designer"]
    said = cutbench("sweep speeds.toml --out map --workers 2")
    assert "3 of 3 runs" in said and f"our gel {expected[1]}" in said
    shown = page("map/map.html")
    if shown is None:
        assert '"our gel"' in (tmp_path / "map" / "map.html").read_text("utf-8")
        return
    assert any("our gel" in each.text for each in shown.find_elements("css selector", "#map text"))
    (button,) = shown.find_elements("css selector", "#marks button")
    assert button.text.rstrip("*") == "our gel"
    button.click()
    assert shown.find_element("id", "head").text.startswith("our gel: ")
    numbers = shown.find_element("id", "numbers").text.replace("\u00a0", " ")
    assert "18 kPa" in numbers and "2 J/m²" in numbers, numbers
