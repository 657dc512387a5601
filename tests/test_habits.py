"""Habits that would tie the suite to the inside of the package, counted in the source of the tests."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCES = {
    path.name: ast.parse(path.read_text("utf-8")) for path in sorted(Path(__file__).parent.glob("*.py"))
}
#: Places where a method of text says what stands in it, and the helpers that look for a piece of a message.
SAYS = {"startswith", "endswith", "count", "index", "search", "match", "fullmatch", "findall"}
HELPERS = {"refused", "refusal"}
#: Of Python's: what is private by spelling, but public protocol or nobody's.
PROTOCOLS = re.compile(r"__\w+__|_repr_\w+_|_")
#: How ``monkeypatch``, ``pytest.MonkeyPatch`` and ``unittest.mock`` put something in another's place.
OURS, THIRD = {"cutbench", "benchmarks"}, {"IPython"}
PATCHES = {"setattr", "setitem", "delattr", "delitem", "patch", "object", "dict", "multiple", "__setattr__"}


def words(text: object) -> int:
    """How many words a literal has: what stands between blanks and has letters side by side. A text of
    several lines is a file and not a phrase."""
    if not isinstance(text, str) or "\n" in text.strip():
        return 0
    return sum(bool(re.search(r"[^\W\d_]{2}", part)) for part in text.split())


def constants(tree: ast.Module) -> dict[str, ast.expr]:
    """What stands behind the names that a module gives to values."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found[node.targets[0].id] = node.value
    return found


def literals(node: ast.AST, known: dict[str, ast.expr]) -> Iterator[ast.Constant]:
    """All texts of an expression, also behind a name, but not those that a function in it is called with."""
    if isinstance(node, ast.Constant):
        yield node
    elif isinstance(node, ast.Name) and node.id in known:
        yield from literals(known[node.id], {k: v for k, v in known.items() if k != node.id})
    elif not isinstance(node, ast.Call):
        for child in ast.iter_child_nodes(node):
            yield from literals(child, known)


def tables(function: ast.AST, known: dict[str, ast.expr]) -> dict[str, ast.expr]:
    """Values of a test's parameters, by name: columns of the tables that it is parametrized with."""
    found: dict[str, ast.expr] = {}
    for call in getattr(function, "decorator_list", []):
        if not (isinstance(call, ast.Call) and ast.unparse(call.func).endswith("parametrize")):
            continue
        if len(call.args) < 2 or not isinstance(names := _plain(call.args[0]), str | tuple | list):
            continue
        names = re.split(r",\s*", names) if isinstance(names, str) else list(names)
        rows = call.args[1]
        if isinstance(rows, ast.Name) and rows.id in known:
            rows = known[rows.id]
        if not isinstance(rows, ast.List | ast.Tuple):
            continue
        for row in rows.elts:
            cells = row.elts if len(names) > 1 and isinstance(row, ast.Tuple | ast.List) else [row]
            for name, cell in zip(names, cells, strict=False):
                found[name] = ast.List([*getattr(found.get(name), "elts", []), cell])
    return found


def _plain(node: ast.expr) -> object:
    try:
        return ast.literal_eval(node)
    except ValueError:
        return None


def spoken(node: ast.AST) -> Iterator[ast.expr]:
    """The expressions of a check that are held against a text: operands of ``in`` and ``==`` in an assertion,
    what is looked for by a method of text there, ``match=``, and ``hint=`` of the helpers."""
    if isinstance(node, ast.Assert):
        for part in ast.walk(node.test):
            if isinstance(part, ast.Compare) and isinstance(
                part.ops[0], ast.In | ast.NotIn | ast.Eq | ast.NotEq
            ):
                yield from (part.left, *part.comparators)
            elif isinstance(part, ast.Call) and getattr(part.func, "attr", "") in SAYS:
                yield from part.args[:1]
    elif isinstance(node, ast.Call):
        yield from (k.value for k in node.keywords if k.arg == "match")
        if getattr(node.func, "id", "") in HELPERS:
            yield from (k.value for k in node.keywords if k.arg == "hint")


def phrases(sources=SOURCES) -> list[str]:
    found = {}
    for name, tree in sources.items():
        known = constants(tree)
        for function in [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]:
            seen = known | tables(function, known)
            unpacked = _unpacked(function, seen)
            for node in ast.walk(function):
                for said in spoken(node):
                    for text in literals(said, seen | unpacked):
                        if words(text.value) >= 3:
                            found[name, text.lineno, text.value] = f"{name}:{text.lineno}: {text.value!r}"
    return list(found.values())


def _unpacked(function: ast.FunctionDef, seen: dict[str, ast.expr]) -> dict[str, ast.expr]:
    """Names that a test gives to the cells of ``TABLE[name]``, with the table's columns behind them."""
    found = {}
    for node in ast.walk(function):
        if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript)):
            continue
        table, names = seen.get(ast.unparse(node.value.value)), node.targets[0]
        if isinstance(table, ast.Dict) and isinstance(names, ast.Tuple):
            rows = [row.elts for row in table.values if isinstance(row, ast.Tuple)]
            for k, each in enumerate(names.elts):
                if isinstance(each, ast.Name):
                    found[each.id] = ast.List([row[k] for row in rows if k < len(row)])
                elif isinstance(each, ast.Starred) and isinstance(each.value, ast.Name):
                    found[each.value.id] = ast.List([cell for row in rows for cell in row[k:]])
    return found


def of_the_package(tree: ast.Module) -> dict[str, str]:
    """Where the names of a module come from that it imports."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {(a.asname or a.name).split(".")[0]: a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {a.asname or a.name: f"{node.module}.{a.name}" for a in node.names}
    return found


def private(sources=SOURCES) -> list[str]:
    """Private names that are imported from the package, or read of anything but ``self``, ``cls``."""
    found = []
    for name, tree in sources.items():
        for node in ast.walk(tree):
            parts: list[str] = []
            if isinstance(node, ast.ImportFrom):
                parts = [*(node.module or "").split("."), *(a.name for a in node.names)]
            elif isinstance(node, ast.Import):
                parts = [part for a in node.names for part in a.name.split(".")]
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) not in ("self", "cls"):
                parts = [node.attr]
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("getattr", "setattr"):
                parts = [a.value for a in node.args[1:2] if isinstance(a, ast.Constant)]
            found += [
                f"{name}:{node.lineno}: {part}"
                for part in parts
                if str(part).startswith("_") and not PROTOCOLS.fullmatch(part)
            ]
    return found


def patches(sources=SOURCES) -> list[str]:
    """Where something of the package or of the benchmarks, or of these files, is put in another's place."""
    found = []
    for name, tree in sources.items():
        known = of_the_package(tree)
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            how, of = node.func.attr, ast.unparse(node.func.value)
            if how not in PATCHES or not (of in ("object", "mock") or "patch" in of.lower()) or not node.args:
                continue
            target = node.args[0]
            text = target.value if isinstance(target, ast.Constant) else ast.unparse(target)
            first = str(text).split(".")[0]
            root = known.get(first, first).split(".")[0]
            if (
                root in OURS
                or root not in {*sys.stdlib_module_names, *THIRD}
                or "cutbench" in ast.unparse(node)
            ):
                found.append(f"{name}:{node.lineno}: {ast.unparse(node)[:90]}")
    return found


def test_at_most_twenty_checks_are_on_a_phrase():
    """A phrase is a literal of three or more words that is compared with ``in`` or ``==`` in an assertion,
    looked for by a method of text there, given as ``match=``, or as ``hint=`` of ``refusals.py``; also where
    it stands in a constant of the module, or in the table that a test is parametrized with. Two words (a
    name, a number with its unit) are none, nor is what a test puts together while it runs."""
    found = phrases()
    assert len(found) <= 20, "\n".join(found)


def test_no_private_name_is_used():
    assert private() == []


def test_at_most_ten_internals_are_patched():
    """Environment variables, working directories, modules of Python and its own objects are no internals."""
    found = patches()
    assert len(found) <= 10, "\n".join(found)


TABLE = "BAD = {'a': (1, 'not at all right')}"


@pytest.mark.parametrize(
    ("source", "phrase", "name", "patch"),
    [
        ("from cutbench.run import _x\ndef test():\n    assert 'one two three' in said", 1, 1, 0),
        ("LONG = ['one two three']\ndef test():\n    assert LONG[0] == said", 1, 0, 0),
        (f"{TABLE}\ndef test(n):\n    k, hint = BAD[n]\n    assert hint in said", 1, 0, 0),
        ("def test(monkeypatch):\n    monkeypatch.setattr('cutbench.run.run_case', None)", 0, 0, 1),
        ("import time\ndef test(monkeypatch):\n    monkeypatch.setattr(time, 'sleep', None)", 0, 0, 0),
        ("def test():\n    with raises(E, match='one two three'):\n        search._verdict()", 1, 1, 0),
        ("def test():\n    assert 'drop 0.2' in said and read('a file in a folder') == 3", 0, 0, 0),
    ],
)
def test_they_are_counted(source, phrase, name, patch):
    counted = [len(each({"made_up.py": ast.parse(source)})) for each in (phrases, private, patches)]
    assert counted == [phrase, name, patch]
