"""What pages say by the code alone: ``<!-- made: NAME -->`` in a page asks for it.

``python docs/made.py`` writes it there.
"""

from __future__ import annotations

import importlib
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import typer

import cutbench
import cutbench.mechanisms
from cutbench.base.units import Parameter
from cutbench.case.model import DEFAULT, PROTOCOL, SPECIMEN, groups, section_of
from cutbench.case.numerics import Numerics, defaults
from cutbench.case.tuning import Tuning
from cutbench.cli.main import app
from cutbench.mechanisms import Mechanism, registry
from studies.paper.page import tables as tables_of_claims

#: Rooms as an API page has them, in the order of a user's way.
ROOMS = {
    "run": "Runs",
    "case": "Cases",
    "maps": "Maps",
    "data": "Measured data",
    "homogeneous": "Tests without a mesh",
    "calibration": "Calibration",
    "discovery": "Discovery",
    "mechanisms": "Mechanisms",
    "loading": "Reading back",
    "base": "Errors",
}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def digits(value: float) -> str:
    return re.sub(r"e([-+])0*", lambda found: "e" + found[1].strip("+"), f"{value:g}")


def plain(text: str) -> str:
    """A cell of a table: one line, nothing that Markdown or HTML would read as markup."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def command_line() -> str:
    """Each command with its arguments and options."""
    known = getattr(typer.main.get_command(app), "commands")  # noqa: B009  (typer's own type, not click's)
    return "\n\n".join(_command(name, command) for name, command in known.items())


def _command(name: str, command: Any) -> str:
    arguments = [q for q in command.params if q.param_type_name == "argument"]
    options = [q for q in command.params if q.param_type_name == "option" and not q.hidden]
    usage = " ".join(["cutbench", name, *(q.metavar or q.name.upper() for q in arguments), "[OPTIONS]"])
    parts = [f"## {name}", plain((command.help or "").partition("\n\n")[0]), f"    {usage}"]
    parts += [f"`{q.metavar or q.name.upper()}`: {plain(q.help or '')}" for q in arguments]
    rows = [
        [", ".join(f"`{o}`" for o in (*q.opts, *q.secondary_opts)), _takes(q), plain(q.help or "")]
        for q in options
        if q.name != "help"
    ]
    return "\n\n".join([*parts, table(("option", "takes", "what it does"), rows)] if rows else parts)


def _takes(q: Any) -> str:
    flag = q.is_flag or getattr(getattr(q, "type_descriptor", None), "annotation", None) is bool
    return "" if flag else f"`{q.metavar or q.name.upper()}`".replace("|", "\\|")


def public_names() -> dict[str, list[str]]:
    """The names that ``import cutbench`` offers, by the room that they come from."""
    found: dict[str, list[str]] = {}
    for name in sorted(cutbench.__all__, key=str.lower):
        where = getattr(getattr(cutbench, name), "__module__", None) or _room_of_data(name)
        found.setdefault(where.split(".")[1], []).append(name)
    return found


def _room_of_data(name: str) -> str:
    """Data have no module of their own: the room whose module holds the same object."""
    value = getattr(cutbench, name)
    for room in ROOMS:
        for module in ("", f".{name.lower()}", ".model", ".numerics"):
            try:
                if getattr(importlib.import_module(f"cutbench.{room}{module}"), name, None) is value:
                    return f"cutbench.{room}"
            except ImportError:
                continue
    return "cutbench.base"


def api() -> str:
    """Autodoc of every public name, a heading a room."""
    rooms = public_names()
    parts = []
    for room in [*ROOMS, *sorted(set(rooms) - set(ROOMS))]:
        if room in rooms:
            lines = [line for name in rooms[room] for line in _directive(cutbench, name)]
            parts.append(f"## {ROOMS.get(room, room)}\n\n```{{eval-rst}}\n" + "\n".join(lines) + "```")
    return "\n\n".join(parts)


def _directive(module: ModuleType, name: str) -> Iterator[str]:
    value = getattr(module, name)
    kind = "class" if isinstance(value, type) else "function" if callable(value) else "data"
    if kind == "class" and issubclass(value, BaseException):
        kind = "exception"
    yield f".. auto{kind}:: {module.__name__}.{name}"
    if kind == "class":
        yield "   :members:"
    yield ""


def laws() -> str:
    """Autodoc of what a law derives from, answers with and declares."""
    names = [name for name in cutbench.mechanisms.__all__ if callable(getattr(cutbench.mechanisms, name))]
    lines = [line for name in names for line in _directive(cutbench.mechanisms, name)]
    return "```{eval-rst}\n" + "\n".join(lines) + "```"


def _quantity(q: Parameter) -> list[str]:
    unit = "" if q.unit == "1" else q.unit
    start = "" if q.default is None else f"`{digits(q.default)}{' ' + unit if unit else ''}`"
    return [f"`{q.name}`", plain(q.doc), unit, plain(q.range_text().replace("<=", "≤")), start]


def _section(section: str) -> str:
    """The keys of a section; the laws that bring one where the default model does not."""
    known = {q.name: (q, [""]) for q in (*SPECIMEN, *PROTOCOL)}
    for law in registry().values():
        for q in law.parameters:
            known.setdefault(q.name, (q, []))[1].append("" if law.name in DEFAULT else f"`{law.name}`")
    rows = [
        [*_quantity(q), "" if "" in names else ", ".join(names)]
        for q, names in known.values()
        if section_of(q.name) == section
    ]
    return table(("key", "what it is", "unit", "allowed", "default", "with"), rows)


def groups_table() -> str:
    """The groups that may be set in place of parameters."""
    rows = [
        [f"`{g.name}`", plain(g.text), g.unit if g.unit != "1" else "", f"`{g.parameter}`", plain(g.title)]
        for g in groups().values()
    ]
    return table(("key", "formula", "unit", "sets", ""), rows)


def tools() -> str:
    """The profiles of a blade with their parameters."""
    rows = []
    for law in registry().values():
        if law.role == "contact":
            about = (sys.modules[type(law).__module__].__doc__ or "").partition("\n\n")[0]
            about = re.sub(r" \(paper[^)]*\)", "", about)
            rows.append([f"`{law.name}`", plain(about), ", ".join(f"`{q.name}`" for q in law.parameters)])
    return table(("mechanism", "what it is", "parameters"), rows)


def attribute_texts(cls: type) -> dict[str, str]:
    """What the section Attributes of a class's docstring says of each."""
    _, _, section = (inspect.getdoc(cls) or "").partition("Attributes\n----------\n")
    entries = re.findall(r"^(\w+) :.*\n((?:    .*\n?)+)", section, re.MULTILINE)
    return {name: " ".join(text.split()).replace("``", "`") for name, text in entries}


def shown(value: object, unit: str) -> str:
    if value is None:
        return "none"
    return f"`{digits(value)}{unit}`" if isinstance(value, (int, float)) else f"`{value}`"


def numerics() -> str:
    """Every numerical choice; in blocks where that differs."""
    texts, rows = attribute_texts(Numerics), []
    for f in (f for f in fields(Numerics) if f.name != "tuning"):
        about, allowed = f.metadata, "a path"
        plane, solid = (shown(getattr(defaults(dim), f.name), "") for dim in (2, 3))
        if "choices" in about:
            allowed = ", ".join(about["choices"])
        elif about:
            zero = "0, or " if about["chosen"] else ""
            allowed = f"{zero}{digits(about['low'])} to {digits(about['high'])}"
            allowed += f"; or in {about['unit']}" if about["unit"] else ""
        default = plane if solid == plane else f"{plane}; in blocks {solid}"
        rows.append([f"`{f.name}`", default, allowed, texts[f.name].rstrip(".")])
    return table(("name", "default", "allowed", "what it does"), rows)


def tuning() -> str:
    """The parts, with what their numbers decide."""
    lines = []
    for part in fields(Tuning):
        about = type(getattr(Tuning(), part.name)).__doc__ or ""
        lines.append(f"- `{part.name}`: {about.partition('. ')[0].rstrip('.').replace('``', '`')}")
    return "\n".join(lines)


def replaced(law: Mechanism) -> Mechanism | None:
    """The law whose role ``law`` takes, one whose parameters it keeps if there is; none where it is added."""
    names = {q.name for q in law.parameters}
    same = [o for o in registry().values() if o.role == law.role is not None and o.name != law.name]
    inside = [o for o in same if {q.name for q in o.parameters} <= names and o.name in DEFAULT]
    kept = [o for o in same if set(o.parameters) < set(law.parameters)]
    default = [o for o in same if o.name in DEFAULT and law.name not in DEFAULT]
    return next(iter(inside + kept + default), None)


def mechanisms() -> str:
    """Every law but the profiles of a blade, by slot."""
    parts: dict[str, list[str]] = {}
    for law in (law for law in registry().values() if law.role != "contact"):
        about, _, _ = (sys.modules[type(law).__module__].__doc__ or "").partition("\n\n")
        about = re.sub(r" \(paper[^)]*\)", "", " ".join(about.split())).replace("``", "`").rstrip(".,")
        name = f"**`{law.name}`**" if law.name in DEFAULT else f"`{law.name}`"
        other = replaced(law)
        own = [q for q in law.parameters if other is None or q not in other.parameters]
        named = ", ".join(f"`{q.name}`" if q.off is None else f"**`{q.name}`**" for q in own)
        place, named = f" for `{other.name}`" if other else "", f" ({named})" if named else ""
        parts.setdefault(law.slot, []).append(f"- {name}{place}: {about}{named}")
    return "\n\n".join("\n".join([f"### {slot}", "", *lines]) for slot, lines in parts.items())


def claims() -> str:
    """What runs say of the paper's claims."""
    found = Path(__file__).parent / "figures" / "claims.json"
    return tables_of_claims(json.loads(found.read_text(encoding="utf-8")))


MADE: dict[str, Callable[[], str]] = {
    "command line": command_line,
    "api": api,
    "laws": laws,
    "groups": groups_table,
    "tools": tools,
    "numerics": numerics,
    "tuning": tuning,
    "mechanisms": mechanisms,
    "claims": claims,
    **{f"[{s}]": (lambda s=s: _section(s)) for s in ("parameters", "specimen", "blade", "protocol")},
}


#: What only the site can show: docstrings.
SITE = ("api", "laws")
ASKED = re.compile(r"<!-- made: (?P<name>.+?) -->(?:\n.*?\n<!-- end of \1 -->)?", re.DOTALL)


def filled(text: str) -> str:
    """A page of the site, with what it asks for."""
    return ASKED.sub(lambda asked: MADE[asked["name"]](), text)


def written(text: str) -> str:
    """A page of the repository, where tables are read as text, too."""

    def block(asked: re.Match[str]) -> str:
        name = asked["name"]
        if name in SITE:
            return asked[0]
        return f"<!-- made: {name} -->\n\n{MADE[name]().strip()}\n\n<!-- end of {name} -->"

    return ASKED.sub(block, text)


if __name__ == "__main__":
    for page in Path(__file__).parent.rglob("*.md"):
        page.write_text(written(page.read_text(encoding="utf-8")), encoding="utf-8")
