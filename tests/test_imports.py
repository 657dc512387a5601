"""Imports point down: every module's imports are read from its source and held against the layers."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import cutbench

ROOT = Path(cutbench.__file__).parent

#: From the ground up. A unit (a module or a package of cutbench) imports from lower layers and itself.
LAYERS = (
    {"errors", "threads"},
    {"quantities", "reading", "meshfile", "noise"},
    {"mechanisms", "numerics", "materials", "titles", "repetition", "grading"},
    {"model", "readings", "experiment", "motion"},
    {"values", "forms", "conversion", "fieldfile", "plausible", "homogeneous"},
    {"case", "solve", "recorded"},
    {"result", "axes", "models2d", "models3d", "curve", "campaign", "index", "emulator"},
    {"build", "checkpoint", "identify", "triangles", "boundary", "sampling", "sections"},
    {"fields", "dic"},
    {"crossing", "front", "sensitivity", "remesh"},
    {"run", "study", "plots"},
    {"store", "output", "maps", "lm"},
    {"coordinates"},
    {"estimates", "confirmed"},
    {"worker", "weights", "fitted", "synthetic", "phase", "tension", "confirm", "verify", "plan", "page"},
    {"observe", "cluster", "guide", "agreement", "listing", "claims", "progress", "follow"},
    {"inverse", "sweep", "show", "overview", "compared", "followreport", "convergence"},
    {"fit"},
    {"face", "fitreport", "discover"},
    {"commands"},
    {"cli"},
    {"__init__", "__main__"},
)
LEVEL = {unit: level for level, units in enumerate(LAYERS) for unit in units}
#: The face: what may talk to a terminal.
FACE = {"cli", "commands", "compared", "face", "overview", "progress", "show", "sweep", "__main__"}


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_name(path): path for path in sorted(ROOT.rglob("*.py"))}


def unit(module: str) -> str:
    return module.split(".")[0]


def _type_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def _statements(node: ast.AST, inside_functions: bool):
    for child in ast.iter_child_nodes(node):
        if _type_only(child):  # for readers and type checkers: never executed
            continue
        if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)) and not inside_functions:
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child
        yield from _statements(child, inside_functions)


def imports(module: str, *, inside_functions: bool = True) -> set[str]:
    """Full names of what a module imports: "numpy", "cutbench.forms.base"."""
    path = MODULES[module]
    found = set()
    for node in _statements(ast.parse(path.read_text(encoding="utf-8")), inside_functions):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
            continue
        assert node.level == 0, f"{module}: imports are written in full, from cutbench.… import …"
        for alias in node.names:
            full = f"{node.module}.{alias.name}"
            # "from cutbench import case" imports the module, "from cutbench.case.case import Case" a name.
            inner = full.removeprefix("cutbench.")
            found.add(full if full.startswith("cutbench.") and inner in MODULES else node.module)
    return found


def own_imports(module: str, **how) -> set[str]:
    names = {name for name in imports(module, **how) if name.split(".")[0] == "cutbench"}
    return {name.removeprefix("cutbench").lstrip(".") or "__init__" for name in names}


def outside(module: str, **how) -> set[str]:
    return {name.split(".")[0] for name in imports(module, **how)} - {"cutbench"}


def test_the_reader_of_imports_sees_them():
    assert {"errors", "mechanisms", "quantities"} <= own_imports("model")
    assert "mechanisms.blade._tool" in own_imports("forms.gap")
    assert "case" in own_imports("__init__") and "case" not in own_imports("__init__", inside_functions=False)
    assert "pint" in outside("quantities")


def test_every_module_has_a_layer():
    unknown = {unit(module) for module in MODULES} - LEVEL.keys()
    assert not unknown, f"give {sorted(unknown)} a place in LAYERS"


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_down(module):
    here = unit(module)
    for name in own_imports(module):
        if name == "__init__":  # the version of the package, read by what writes files
            continue
        there = unit(name)
        assert there == here or LEVEL[there] < LEVEL[here], f"cutbench.{module} imports cutbench.{name}"


def test_modules_do_not_import_in_a_circle():
    graph = {
        module: {name for name in own_imports(module, inside_functions=False) if name in MODULES} - {module}
        for module in MODULES
    }
    TopologicalSorter(graph).prepare()  # raises CycleError


@pytest.mark.parametrize("module", [m for m in MODULES if unit(m) in ("models2d", "models3d")])
def test_a_model_is_geometry_and_nothing_else(module):
    other = {"models2d": "models3d", "models3d": "models2d"}[unit(module)]
    used = {unit(name) for name in own_imports(module)}
    assert other not in used
    assert "mechanisms" not in used
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            bases = {ast.unparse(base).split(".")[-1] for base in node.bases}
            assert not any(base.endswith("Form") for base in bases), f"{module} defines the form {node.name}"


@pytest.mark.parametrize("module", [m for m in MODULES if unit(m) == "mechanisms"])
def test_a_mechanism_knows_numpy_and_no_mesh(module):
    allowed = {"numpy", "__future__"} | set(sys.stdlib_module_names)
    assert outside(module) <= allowed


@pytest.mark.parametrize("module", [m for m in MODULES if unit(m) not in FACE])
def test_only_the_face_talks_to_a_terminal(module):
    assert not outside(module) & {"typer", "rich", "click"}


@pytest.mark.parametrize("module", [m for m in MODULES if LEVEL.get(unit(m), 99) < LEVEL["plots"]])
def test_no_pictures_below_the_plots(module):
    assert "matplotlib" not in outside(module)


def loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stdout.split()}


def test_importing_cutbench_is_light():
    names = loaded_by("import cutbench")
    assert "cutbench" in names
    assert not names & {"matplotlib", "skfem", "scipy", "xarray", "typer", "rich", "pint", "numpy"}


def test_the_command_line_starts_without_the_solver():
    assert not loaded_by("import cutbench.cli.main") & {"matplotlib", "skfem", "xarray"}
