"""Laws of a user's own: taken up from a folder, at work in runs, and refused where something is missing."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from refusals import refused

from cutbench.case.model import DEFAULT, Model
from cutbench.cli.main import app
from cutbench.mechanisms import Points, registry, use_mechanisms
from cutbench.mechanisms.law_registry import laws_of, load_file

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "how-to" / "extend.md").read_text(encoding="utf-8")


def python(code: str, folder: Path) -> str:
    """What a process of its own prints."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    env = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    (folder / "script.py").write_text(code, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def page_law(tmp_path) -> Path:
    """The cohesive law of the page, in a file of its own."""
    (text,) = re.findall(r"^```python\n# file: my_laws/finite\.py\n(.*?)^```$", PAGE, re.M | re.S)
    path = tmp_path / "my_laws" / "finite.py"
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")
    return path


def test_the_cohesive_law_of_the_page_costs_the_work_of_separation_and_damages(page_law):
    (law,) = laws_of(load_file(page_law))
    p = SimpleNamespace(G=0.0075, G_c=0.0053, delta_c=0.07, beta=1.0)
    state, work, T_old, damage = law.start(1, p), 0.0, 0.0, [0.0]
    for old, new in pairwise(np.linspace(0, 4 * p.delta_c, 2001)):
        jump, before = np.zeros((3, 1)), np.zeros((3, 1))
        jump[0], before[0] = new, old
        T, state = law.traction(jump, p, state, Points(jump_old=before, dt=1.0))
        work, T_old = work + (T[0, 0] + T_old) / 2 * (new - old), T[0, 0]
        damage.append(float(state["damage"][0]))
    assert work == pytest.approx(p.G_c, rel=1e-6)
    assert damage[-1] == 1 and np.all(np.diff(damage) >= 0)


@pytest.mark.slow
def test_the_cohesive_law_of_the_page_cuts(page_law):
    said = python(
        "import cutbench\n"
        "assert cutbench.use_mechanisms('my_laws') == ('finite',)\n"
        "run = cutbench.run2d('gelatin', with_='finite', cohesion=4.0, depth='2.5 mm', h='0.7 mm')\n"
        "p = run.case.p\n"
        "print(run.outcome.kind, run.curve['cut_length_mm'][-1],"
        " run.curve['work_finite_mJ'][-1] / (p.G_c * p.length))\n",
        page_law.parent.parent,
    )
    kind, cut, spent = said.split()
    assert kind == "done"
    assert float(cut) > 0.7, "the interface is cut"
    # What is ahead of the cut has taken up some work, too.
    assert float(cut) <= float(spent) < float(cut) + 1.5


LAW = """
import numpy as np
from cutbench.mechanisms import Bulk, Cut, Parameter

class Mine({base}):
    name = "mine"
    title = "mine"
    {role}

    def start(self, n, p):
        return {start}

    def traction(self, jump, p, state, at):
        return 0 * jump, {new}
"""
STATE = '{"widest": np.zeros(n), "damage": np.zeros(n)}'
KEPT = '{"widest": jump[0], "damage": jump[1]}'
COHESIVE = 'role = "cohesive"'


@pytest.mark.parametrize(
    ("base", "role", "start", "new", "missing"),
    [
        ("Cut", COHESIVE, '{"widest": np.zeros(n)}', '{"widest": jump[0]}', "damage"),
        ("Cut", COHESIVE, STATE, '{"widest": jump[0]}', "damage"),
        ("Cut", COHESIVE, STATE, '{"damage": jump[0]}', "widest"),
        ("Cut", "role = None", STATE, KEPT, "role"),
        ("Cut", COHESIVE + "; reads = ('toughness_of_mine',)", STATE, KEPT, "toughness_of_mine"),
        ("Cut", 'role = "rate"; follows = ("glue",)', "{}", "{}", "glue"),
        ("Cut", COHESIVE + "; title = ''", STATE, KEPT, "title"),
        ("Bulk", 'role = "isochoric"', STATE, KEPT, "stress"),
        ("Cut", COHESIVE, STATE, "state['nothing']", "nothing"),
    ],
)
def test_a_law_that_lacks_something_is_refused_by_name(tmp_path, base, role, start, new, missing):
    known = set(registry())
    (tmp_path / "mine.py").write_text(LAW.format(base=base, role=role, start=start, new=new))
    with refused("mine") as error:
        use_mechanisms(tmp_path)
    assert missing in str(error.value)
    assert str(tmp_path / "mine.py") in str(error.value)
    assert set(registry()) == known, "nothing of it is left"


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("import nowhere_at_all", "import"),
        ("x = 1", "file"),
        (
            "from cutbench.mechanisms import NeoHookean\nclass Twice(NeoHookean):\n    name = 'neo_hookean'",
            "name",
        ),
    ],
)
def test_a_file_without_a_law_of_its_own_is_refused(tmp_path, text, wrong):
    (tmp_path / "mine.py").write_text(text)
    with refused(wrong, file="mine.py"):
        use_mechanisms(tmp_path)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with refused("--mechanisms"):
        use_mechanisms(tmp_path / "nowhere")


def test_a_law_that_follows_another_needs_it_in_the_model():
    followers = [law for law in registry().values() if law.follows]
    assert followers
    for law in followers:
        leaders = [m.name for m in Model(DEFAULT).all if m.slot == law.slot and m.role in law.follows]
        with refused("mechanisms", hint=law.name):
            Model(DEFAULT).with_(law.name).without(*leaders)


def test_every_command_takes_a_folder_of_laws():
    for name, command in typer.main.get_command(app).commands.items():
        assert "--mechanisms" in {o for q in command.params for o in q.opts}, name


def cli(*words: str, folder: Path) -> subprocess.CompletedProcess:
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    # Short runs on few elements: compiling a new law takes far longer than it saves.
    env = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "CUTBENCH_COMPILED": "0"}
    args = [sys.executable, "-m", "cutbench", *words]
    return subprocess.run(args, cwd=folder, env=env, capture_output=True, text=True, check=False)


STUDY = """
title = "two runs"
base = "gelatin"
mechanisms = ["neo_hookean", "volumetric", "finite", "viscous_degraded", "contact"]

[protocol]
depth = "0.2 mm"

[numerics]
h = "1.4 mm"

[[axis]]
name = "G_c"
values = ["5 J/m^2", "6 J/m^2"]
"""


@pytest.mark.slow
def test_workers_of_a_sweep_know_them(page_law, tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    done = cli(
        "sweep", "study.toml", "--out", "out", "--workers", "2", "--mechanisms", "my_laws", folder=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "2 of 2" in done.stdout
    listed = cli("runs", "out", "--columns", "mechanisms,outcome", "--mechanisms", "my_laws", folder=tmp_path)
    assert listed.stdout.count("finite") == 2, listed.stdout + listed.stderr
    unknown = cli("sweep", "study.toml", "--out", "other", folder=tmp_path)
    assert unknown.returncode == 2 and "--mechanisms" in unknown.stderr
    missing = cli("run2d", "gelatin", "--mechanisms", "nowhere", folder=tmp_path)
    assert missing.returncode == 2 and "nowhere" in missing.stderr


@pytest.mark.slow
def test_a_case_takes_its_laws_along(page_law, tmp_path):
    make = (
        "import pickle, cutbench\n"
        "cutbench.use_mechanisms('my_laws')\n"
        "case = cutbench.load_case('gelatin', {'with': 'finite'})\n"
        "pickle.dump((case, case.model, case.id), open('case.pickle', 'wb'))\n"
    )
    python(make, tmp_path)
    said = python(
        "import pickle\ncase, model, id = pickle.load(open('case.pickle', 'rb'))\n"
        "print(case.id == id, model == case.model, [law.title for law in model.laws('cut')])\n",
        tmp_path,
    )
    assert said.startswith("True True") and "cohesive (finite)" in said


def test_a_package_offers_laws_by_an_entry_point(page_law, tmp_path):
    site = tmp_path / "site"
    about = site / "softlaws-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: softlaws\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[cutbench.mechanisms]\nfinite = softlaws\n")
    (site / "softlaws.py").write_text(page_law.read_text(encoding="utf-8"), encoding="utf-8")
    said = python(
        "import sys; sys.path.insert(0, 'site')\nimport cutbench\n"
        "print('finite' in cutbench.known_mechanisms())\n",
        tmp_path,
    )
    assert said.strip() == "True"


@pytest.mark.slow
def test_a_law_brings_its_group_and_its_lever(tmp_path):
    (tmp_path / "my_laws").mkdir()
    (tmp_path / "my_laws" / "sticky.py").write_text(
        "from cutbench.mechanisms import Blade, Estimate, Group, Parameter\n\n\n"
        "class Sticky(Blade):\n"
        "    name, title, role = 'sticky', 'sticky', 'sticky'\n"
        "    reads = ('G',)\n"
        "    tau = Parameter('tau_s', 'kPa', 't', 'grip', low=0, off=0.0, default=0.0, lever='wash')\n"
        "    parameters = (tau,)\n"
        "    settable = (Group('grip', 'tau_s/G', 't', 'tau_s', ('G',), lambda p: p.tau_s / p.G,\n"
        "                      lambda p, x: x * p.G),)\n\n"
        "    def groups(self, p):\n        return {'tau_s/G': p.tau_s / p.G}\n\n"
        "    def strength(self, t_N, p, state, at):\n        return p.tau_s * at.touched\n\n"
        "    def estimate(self, p, rate, width):\n        return Estimate(drag=p.tau_s)\n"
    )
    names = str([*Model(DEFAULT).mechanisms, "sticky"]).replace("'", '"')
    (tmp_path / "study.toml").write_text(
        f'title = "grip"\nbase = "gelatin"\nmechanisms = {names}\n\n'
        '[[axis]]\nname = "grip"\nvalues = [0.1, 0.3]\n'
    )
    said = python(
        "import cutbench\nfrom cutbench.case.model import levers\n"
        "from cutbench.maps.closed_form_estimates import classical\n"
        "cutbench.use_mechanisms('my_laws')\n"
        "case = cutbench.load_case('gelatin', {'with': 'sticky', 'grip': 0.2})\n"
        "bare = cutbench.load_case('gelatin')\n"
        "print(case.values['tau_s'] / case.p.G, case.groups()['tau_s/G'], levers()['wash'])\n"
        "print(classical(case).slope_N_per_mm > classical(bare).slope_N_per_mm)\n",
        tmp_path,
    )
    assert said.split() == ["0.2", "0.2", "tau_s", "True"]
    said = python(
        "import cutbench\ncutbench.use_mechanisms('my_laws')\n"
        "study = cutbench.load_study('study.toml')\n"
        "print(*[round(case.values['tau_s'] / case.p.G, 9) for case in study.cases()])\n",
        tmp_path,
    )
    assert said.split() == ["0.1", "0.3"]


SHARED = '''
from cutbench.mechanisms import Isochoric, NeoHookean, Parameter


class {kind}(Isochoric):
    """Stiffens by a part of Ī₁ − 3 that a neighbour knows."""

    name, title, role = "{kind}".lower(), "{kind}", "isochoric"
    parameters = (*NeoHookean.parameters, Parameter.effect("{kind}_k", "1", "k", "stiffening"))

    def dW_dI1(self, I1, p, at):
        return p.G / 2 * (1 + p.{kind}_k * PART * (I1 - 3))

    def W(self, I1, p, at):
        return p.G / 2 * (I1 - 3 + p.{kind}_k * PART * (I1 - 3) ** 2 / 2)
'''


def test_files_of_a_folder_import_one_another_and_no_other_folders(tmp_path):
    """By their bare names or with a dot; a neighbour has laws, or helps those that do."""
    for kind, part, line in (
        ("One", 0.5, "from shapes import PART"),
        ("Two", 2.0, "from .shapes import PART"),
    ):
        folder = tmp_path / kind
        folder.mkdir()
        (folder / "shapes.py").write_text(f"PART = {part}\n", encoding="utf-8")
        (folder / f"{kind.lower()}.py").write_text(f"{line}\n{SHARED.format(kind=kind)}", encoding="utf-8")
    (tmp_path / "One" / "three.py").write_text(
        "import one\n\n\nclass Three(one.One):\n    'The same.'\n    name, title = 'three', 'three'\n",
        "utf-8",
    )
    said = python(
        "import pickle, sys, cutbench\nfrom pathlib import Path\n"
        "print(*sorted(cutbench.use_mechanisms('One', 'Two')), sep='+')\n"
        "print('shapes' in sys.modules)\n"
        "known = cutbench.known_mechanisms()\n"
        "print(type(known['three']).__mro__[1] is type(known['one']))\n"
        "p = type('P', (), {'G': 2.0, 'One_k': 1.0, 'Two_k': 1.0})\n"
        "print(*[known[name].dW_dI1(4.0, p, None) for name in ('one', 'two')])\n"
        "case = cutbench.load_case('gelatin', {'with': 'one'})\n"
        "pickle.dump(case, open('case.pickle', 'wb'))\n"
        "Path('One/shapes.py').write_text('PART = 1.5\\n')\n"
        "cutbench.use_mechanisms('One')\n"
        "print(cutbench.known_mechanisms()['one'].dW_dI1(4.0, p, None))\n"
        "print(cutbench.load_case('gelatin', {'with': 'one'}).id == case.id)\n"
        "Path('One/shapes.py').write_text('PART = 0.5\\n')\n",
        tmp_path,
    )
    assert said.split() == ["one+three+two", "False", "True", "1.5", "3.0", "2.5", "False"]
    assert (
        python("import pickle; print(pickle.load(open('case.pickle', 'rb')).mechanisms[0])\n", tmp_path)
        == "one\n"
    )
    done = cli("mechanisms", "--check", "One", folder=tmp_path)
    assert done.returncode == 1 and "three" in done.stdout and "shapes" not in done.stdout
    assert not list(tmp_path.glob("*/__pycache__"))


def test_a_run_keeps_the_sources_of_its_laws_and_is_computed_elsewhere_with_them(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "my").mkdir(parents=True)
    (here / "my" / "shapes.py").write_text("PART = 0.5\n", encoding="utf-8")
    (here / "my" / "one.py").write_text(
        "from shapes import PART\n" + SHARED.format(kind="One"), encoding="utf-8"
    )
    said = python(
        "import cutbench\nfrom cutbench.run import Store, write_run\ncutbench.use_mechanisms('my')\n"
        "run = cutbench.run2d('gelatin', with_='one', One_k=0.2, depth='0.1 mm', h='1.4 mm')\n"
        "write_run(run, 'out')\nstore = Store('store')\nstore.put(run)\n"
        "print(run.id, repr(run.force_N[-1]))\n",
        here,
    )  # fmt: skip
    there.mkdir()
    (here / "out").rename(there / "out")
    (here / "store").rename(there / "store")
    shutil.rmtree(here)
    record = json.loads((there / "out" / "run.json").read_text("utf-8"))
    files = record["laws"]["one"]["files"]
    assert record["laws"]["one"]["digest"] and {Path(name).name for name in files} == {"one.py", "shapes.py"}
    assert all((there / "out" / name).is_file() for name in files)
    assert "numba" in record["versions"]
    unread = cli("plot", "out", folder=there)
    folder = str(Path("out") / Path(files[0]).parent)
    assert unread.returncode == 2 and f"--mechanisms {folder}" in unread.stderr, unread.stderr
    steps = record["reproduce"]["python"].replace("run_case(read", "run = run_case(read")
    steps = f"import os\nos.chdir('out')\n{steps}\nprint(run.id, repr(run.force_N[-1]))\n"
    again = python(steps, there)
    assert again == said
    kept = (
        "import cutbench\nfrom cutbench.run import Store\ncutbench.use_mechanisms({!r})\n"
        "print(*[r.id for r in Store('store')])\n"
    )
    (place,) = {path.parent for path in (there / "store").rglob("one.py")}
    assert python(kept.format(str(place)), there).strip() == said.split()[0]
