"""A run's id changes with the source of what computes it, and with nothing else."""

from __future__ import annotations

import ast
import importlib.util
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import refused

import cutbench
from cutbench.base.errors import ComputationFailed
from cutbench.case.case import load_case
from cutbench.case.computation import Source, Sources, read_text
from cutbench.mechanisms import registry
from cutbench.run.runner import run_case
from cutbench.run.tension import run_tension, strip_case

ROOT = Path(cutbench.__file__).parent
SMALL = {"width": "8 mm", "height": "5 mm", "depth": "0.1 mm", "h": "0.7 mm", "penalty": "200 1/mm",
         "stick": "100 1/mm", "corner": 0.25, "shallow": 1.0, "tip": "2 mm"}  # fmt: skip
GELATIN = tuple(type(law) for law in load_case("gelatin").model.all)


def digest(changed: Path | None = None, edit=lambda text: text + "EXTRA = 1\n", laws=GELATIN) -> str:
    return Sources(lambda path: edit(read_text(path)) if path == changed else read_text(path)).digest(laws)


def law_file(name: str) -> Path:
    return Path(sys.modules[type(registry()[name]).__module__].__file__)


# -- what counts --------------------------------------------------------------------------------------
def test_every_file_of_the_engine_and_of_the_model_s_laws_counts():
    sources, here = Sources(), digest()
    files = sources.engine.union(*(sources.law(kind) for kind in GELATIN))
    assert {law_file("neo_hookean"), ROOT / "mechanisms/base.py", ROOT / "solver/newton.py"} <= files
    assert not [path for path in files if digest(path) == here]


def test_a_docstring_of_any_file_does_not_and_a_constant_of_any_does():
    sources = Sources()
    for path in sources.engine.union(*(sources.law(kind) for kind in GELATIN)):
        text = read_text(path)
        assert Source.of(reworded(text)).digest == Source.of(text).digest, path
        one, other = (Source.of(f"{text}\nCONSTANT = {k}\n").digest for k in (3, 4))
        assert one != other
    newton = next(path for path in sources.engine if path.name == "newton.py")
    assert digest(newton, reworded) == digest()


def reworded(text: str) -> str:
    """The file with other words in each docstring of a module, class or function."""
    lines = text.splitlines(keepends=True)
    docs = [
        node.body[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node)
    ]
    for node in sorted(docs, key=lambda node: -node.lineno):
        indent = lines[node.lineno - 1][: node.col_offset]
        lines[node.lineno - 1 : node.end_lineno] = [f'{indent}"""Reworded."""\n']
    return "".join(lines)


def test_comments_blank_lines_and_line_endings_do_not():
    path = next(path for path in Sources().engine if path.name == "newton.py")
    edits = (
        lambda text: text.replace("\n", "\n\n    # why\n"),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "   \n") + "\n\n",
    )
    assert {digest(path, edit) for edit in edits} == {digest()}


def test_a_law_counts_where_it_or_what_it_builds_on_is_in_the_model():
    gent = type(registry()["gent"])
    assert digest(law_file("gent")) == digest()
    assert digest(law_file("gent"), laws=(*GELATIN, gent)) != digest(laws=(*GELATIN, gent))
    # The default viscous law is a kind of the other one.
    assert digest(law_file("viscous")) != digest()


def test_no_law_is_part_of_the_engine_and_no_picture_map_or_command():
    outside = {path for path in Sources().engine if path.is_relative_to(ROOT)}
    assert not outside & {law_file(name) for name in registry()}
    rooms = {path.relative_to(ROOT).parts[0] for path in outside}
    assert rooms <= {"base", "mechanisms", "case", "forms", "solver", "models2d", "models3d", "run"}
    drawing = {path for path in ROOT.rglob("*.py") if "\nfrom matplotlib" in path.read_text()}
    assert drawing and not outside & drawing


def called_by(run) -> set[Path]:
    """Files of cutbench whose functions ``run`` calls."""
    found = set()

    def look(frame, event, arg):
        if event == "call" and frame.f_code.co_name != "<module>":
            found.add(frame.f_code.co_filename)

    sys.setprofile(look)
    try:
        run()
    finally:
        sys.setprofile(None)
    return {Path(name) for name in found if Path(name).is_relative_to(ROOT)}


@pytest.mark.parametrize("kind", ["section", "block", "strip"])
def test_whatever_runs_in_a_run_counts(kind):
    case = load_case("gelatin", SMALL, dim=2)
    if kind == "section":
        used = called_by(lambda: run_case(case, snapshots_mm=[0.1]))
    elif kind == "block":
        case = load_case(
            "gelatin", {**SMALL, "length": "4 mm", "element": "P1", "h": "1.2 mm", "layers": 1}, dim=3
        )
        used = called_by(lambda: run_case(case))
    else:
        solid = load_case("elastomer", dim=3)
        case = strip_case(solid, {"h": "3 mm", "element": "P1", "depth": "0.4 mm"}, notch_mm=0.0)
        used = called_by(lambda: run_tension(case, 0.0))
    sources = Sources()
    counted = sources.engine.union(*(sources.law(type(law)) for law in case.model.all))
    assert len(used) > 20 and not used - counted


# -- where it is computed -----------------------------------------------------------------------------
def test_another_place_and_other_line_endings_give_the_same_id_and_another_line_does_not(tmp_path):
    copy = tmp_path / "elsewhere" / "cutbench"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for path in copy.rglob("*.py"):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    code = "import cutbench; print(cutbench.__file__); print(cutbench.load_case('gelatin').id)"

    def there() -> str:
        done = subprocess.run([sys.executable, "-c", code], cwd=copy.parent, check=True, capture_output=True,
                              text=True, env={"PYTHONPATH": str(copy.parent)})  # fmt: skip
        file, id = done.stdout.split()
        assert Path(file).parent == copy
        return id

    assert there() == load_case("gelatin").id
    newton = copy / "solver" / "newton.py"
    newton.write_text(newton.read_text().replace("iterations", "Iterations"))
    assert there() != load_case("gelatin").id


def test_a_case_is_not_computed_by_other_code_than_that_which_asks(other_code):
    sent = pickle.dumps(load_case("gelatin"))
    assert pickle.loads(sent).id == load_case("gelatin").id
    other_code("0123456789ab")
    with pytest.raises(ComputationFailed, match="0123456789ab"):
        _ = pickle.loads(sent).id


# -- laws of a user's own -----------------------------------------------------------------------------
def load_law(path: Path) -> type:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module.MyLaw


def test_a_law_of_a_user_s_own_counts_with_the_files_beside_it(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    helper, path = tmp_path / "own_helper.py", tmp_path / "own_law.py"
    helper.write_text("FACTOR = 2.0\n")
    path.write_text(
        "from own_helper import FACTOR\nfrom cutbench.mechanisms.bulk.gent import Gent\n"
        "class MyLaw(Gent):\n    name = 'my_law'\n    factor = FACTOR\n"
    )
    laws = (*GELATIN, load_law(path))
    here = digest(laws=laws)
    assert here != digest()
    for file in (path, helper, law_file("gent")):
        assert digest(file, laws=laws) != here


def test_a_law_without_a_source_is_refused():
    space = {"__name__": "nowhere"}
    exec("from cutbench.mechanisms.bulk.gent import Gent\nclass MyLaw(Gent):\n    name = 'my_law'\n", space)
    with refused("mechanisms", value="MyLaw"):
        digest(laws=(space["MyLaw"],))
