"""Imports point down: every module's imports are read from its source and held against the rooms."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import cutbench

ROOT = Path(cutbench.__file__).parent

#: From the ground up, a room a line. A room imports rooms above its line and itself.
ROOMS = (
    "base",
    "mechanisms",
    "case",
    "forms",
    "solver",
    "models2d",
    "models3d",
    "run",
    "emulator",
    "maps",
    "data",
    "homogeneous",
    "calibration",
    "discovery",
    "loading",
    "app",
    "cli",
)
LEVEL = {room: level for level, room in enumerate(ROOMS)}
#: Pairs of rooms on different floors that must not know each other all the same.
STRANGERS = (("maps", "data"), ("maps", "calibration"), ("maps", "discovery"), ("models2d", "models3d"))


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(ROOT.rglob("*.py"))}


def room(module: str) -> str:
    return module.split(".")[0]


def _type_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def _statements(node: ast.AST):
    for child in ast.iter_child_nodes(node):
        if _type_only(child):  # for readers and type checkers: never executed
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child
        yield from _statements(child)


def imports(module: str) -> set[str]:
    """Full names of what a module imports, inside functions, too: "numpy", "cutbench.forms.base"."""
    found = set()
    for node in _statements(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
            continue
        assert node.level == 0, f"{module}: imports are written in full, from cutbench.… import …"
        for alias in node.names:
            full = f"{node.module}.{alias.name}"
            # "from cutbench.maps import page" imports a module, "from cutbench.maps.page import page" a name.
            found.add(full if full.removeprefix("cutbench.") in MODULES else node.module)
    return found


def own_imports(module: str) -> set[str]:
    return {
        n.removeprefix("cutbench.") for n in imports(module) if n.startswith("cutbench.")
    } & MODULES.keys()


def outside(module: str) -> set[str]:
    return {name.split(".")[0] for name in imports(module)} - {"cutbench"}


INSIDE = [module for module in MODULES if room(module) not in ("", "__init__", "__main__", "cutbench")]
ARROWS = {(module, name) for module in INSIDE for name in own_imports(module) if room(name) != room(module)}


def test_the_reader_of_imports_sees_them():
    assert {"base.errors", "base.units"} <= own_imports("case.model")
    assert "pint" in outside("base.units")


def test_the_rooms_are_all_there_is():
    there = {path.stem for path in ROOT.iterdir() if path.name != "__pycache__"}
    assert there == {*ROOMS, "__init__", "__main__"}


def test_imports_point_down():
    assert not [(a, b) for a, b in ARROWS if LEVEL[room(b)] > LEVEL[room(a)]]
    assert not [(a, b) for a, b in ARROWS if {room(a), room(b)} in map(set, STRANGERS)]


def test_few_arrows_between_rooms():
    assert len({(room(a), room(b)) for a, b in ARROWS}) <= 85


def test_modules_do_not_import_in_a_circle():
    TopologicalSorter({module: own_imports(module) - {module} for module in INSIDE}).prepare()


def test_every_room_says_what_it_is_for_and_gives_its_public_names():
    for name in ROOMS:
        loaded = __import__(f"cutbench.{name}", fromlist=["x"])
        assert loaded.__doc__ and loaded.__doc__.strip(), name
        for public in getattr(loaded, "__all__", ()):
            assert getattr(loaded, public) is not None


def test_a_model_is_geometry_and_nothing_else():
    for module in (m for m in INSIDE if room(m) in ("models2d", "models3d")):
        assert "mechanisms" not in {room(name) for name in own_imports(module)}
        for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                bases = {ast.unparse(base).split(".")[-1] for base in node.bases}
                assert not any(base.endswith("Form") for base in bases), f"{module} defines {node.name}"


def test_a_mechanism_knows_numpy_and_no_mesh():
    allowed = {"numpy", "__future__"} | set(sys.stdlib_module_names)
    for module in (m for m in INSIDE if room(m) == "mechanisms"):
        assert outside(module) <= allowed, module


def test_only_the_command_line_talks_to_a_terminal():
    for module in (m for m in INSIDE if room(m) != "cli"):
        assert not outside(module) & {"typer", "rich", "click"}, module


def test_no_pictures_below_runs():
    for module in (m for m in INSIDE if LEVEL[room(m)] < LEVEL["run"] and m != "base.figure_style"):
        assert "matplotlib" not in outside(module) and "base.figure_style" not in own_imports(module), module


def loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stdout.split()}


def test_importing_cutbench_is_light():
    names = loaded_by("import cutbench")
    assert "cutbench" in names
    assert not names & {"matplotlib", "skfem", "scipy", "xarray", "typer", "rich", "pint", "numpy"}


def test_the_command_line_starts_without_the_solver():
    heavy = {"matplotlib", "skfem", "xarray", "numpy", "scipy", "pint"}
    assert not loaded_by("import cutbench.cli.main") & heavy
