"""The house grows no more: each room has at most so many statements, and a room that shrinks keeps it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import cutbench

PACKAGE = Path(cutbench.__file__).parent

#: Statements of each room without docstrings. Who makes a room smaller writes its number here; one grows only
#: where another shrinks by as much.
STATEMENTS = {
    "base": 1563,
    "mechanisms": 2502,
    "case": 1404,
    "forms": 2894,
    "solver": 1958,
    "models2d": 133,
    "models3d": 227,
    "run": 3984,
    "emulator": 1151,
    "maps": 3155,
    "data": 2849,
    "homogeneous": 508,
    "calibration": 1702,
    "discovery": 1526,
    "app": 1129,
    "cli": 1124,
    "top": 61,
}


def statements(room: str) -> int:
    """Of the files of a room, or of those that stand beside the rooms."""
    files = PACKAGE.glob("*.py") if room == "top" else (PACKAGE / room).rglob("*.py")
    count = 0
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            holds = isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
            count += isinstance(node, ast.stmt) - bool(holds and ast.get_docstring(node))
    return count


@pytest.mark.parametrize("room", STATEMENTS)
def test_a_room_has_as_many_statements_as_it_may(room):
    here = statements(room)
    assert here <= STATEMENTS[room], f"{room} has grown by {here - STATEMENTS[room]}: shorten it, or another"
    assert here == STATEMENTS[room], f"{room} is smaller: its number is {here} now"


def test_every_room_has_its_number():
    rooms = {path.parent.name for path in PACKAGE.glob("*/*.py")} | {"top"}
    assert rooms == STATEMENTS.keys()
