"""A mechanism is one file: nothing outside ``cutbench/mechanisms`` names one, or one of its parameters."""

from __future__ import annotations

import ast
from pathlib import Path

import cutbench
from cutbench.case.model import DEFAULT, PAPER, groups, levers, tools
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import PROTOCOL, SPECIMEN

ROOT = Path(cutbench.__file__).parent
#: Reference problems and published claims are of certain laws, and so is the atlas.
OF_CERTAIN_LAWS = ("mechanisms",)
OF_THE_ATLAS = ("emulator/atlas.py", "emulator/design_space.py")
#: Words that happen to be names: Greek letters, a picture of phases, energy that drifts, what is taken off
#: readings, and roles of laws.
OTHERWISE = {
    "base/figure_style.py": {"beta", "mu", "nu"},
    "base/greek.py": {"beta", "mu", "nu"},
    "calibration/report.py": {"contact"},
    "data/contact.py": {"contact", "zero", "force_zero"},
    "data/experiment_section.py": {"zero", "force_zero"},
    "data/plausible.py": {"contact"},
    "data/read_experiment.py": {"zero"},
    "maps/__init__.py": {"phase"},
    "run/figures/curve.py": {"volumetric", "softening", "viscous", "contact", "adhesion"},
    "solver/step_control.py": {"drift"},
}

LAWS = registry().values()
#: The blade is a body like the specimen: meshes, pictures and checks know its sizes.
BODIES = {q.name for law in tools() for q in law.parameters} | {q.name for q in SPECIMEN + PROTOCOL}
NAMES = {law.name for law in LAWS}
PARAMETERS = {q.name for law in LAWS for q in law.parameters} - BODIES
#: What support laws answer, and what machines have.
METHODS = {"compliance"}

FILES = [
    p
    for p in sorted(ROOT.rglob("*.py"))
    if p.relative_to(ROOT).parts[0] not in OF_CERTAIN_LAWS
    and p.relative_to(ROOT).as_posix() not in OF_THE_ATLAS
]


def words(tree: ast.AST) -> list[tuple[str, int]]:
    """String literals that are no docstrings, and attributes, with their lines."""
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            found.append((node.value, node.lineno))
        elif isinstance(node, ast.Attribute) and node.attr not in METHODS:
            found.append((node.attr, node.lineno))
    return found


def test_the_reader_of_words_sees_a_law():
    assert words(ast.parse("x = 'coulomb'\ny = p.tau_W")) == [("coulomb", 1), ("tau_W", 2)]
    assert {"coulomb", "tau_W"} <= NAMES | PARAMETERS


def test_nothing_outside_names_a_law():
    named = [
        (path.relative_to(ROOT).as_posix(), line, word)
        for path in FILES
        for word, line in words(ast.parse(path.read_text(encoding="utf-8")))
        if word in NAMES | PARAMETERS
    ]
    assert not [each for each in named if each[2] not in OTHERWISE.get(each[0], set())]


def test_the_two_models_come_from_the_laws():
    assert set(DEFAULT) == {law.name for law in LAWS if law.standard}
    assert set(PAPER) == {law.name for law in LAWS if law.published}
    assert DEFAULT != PAPER


def test_groups_are_solved_after_what_they_need():
    known = list(groups().values())
    for i, group in enumerate(known):
        assert not {later.parameter for later in known[i + 1 :]} & set(group.needs)


def test_levers_move_parameters_that_are_declared():
    assert set(levers().values()) <= {q.name for law in LAWS for q in law.parameters} | BODIES
    assert len(levers()) >= 3
