"""Tables for the terminal: materials, mechanisms, a run."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Iterable
from pathlib import Path

from rich import box
from rich.console import Group as Stack
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from cutbench.base.units import Parameter
from cutbench.case import materials
from cutbench.case.case import Case, load_case
from cutbench.case.model import groups as settable_groups
from cutbench.case.model import mechanism as find_mechanism
from cutbench.mechanisms import Mechanism, registry
from cutbench.mechanisms.checks import Finding
from cutbench.run.result import Result


def _table(*heads: str, title: str | None = None) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False)
    for head in heads:
        table.add_column(Text(head), overflow="fold")
    return table


def _row(table: Table, *cells: str) -> None:
    table.add_row(*(Text(cell) for cell in cells))


def material_table() -> RenderableType:
    """The known materials, a column each, with values and dimensionless groups."""
    cases = [load_case(name) for name in materials.names()]
    table = _table("", *(case.name for case in cases))
    known = {name: q for case in cases for name, q in case.model.parameters().items()}
    for name, q in known.items():
        values = {case.values.get(name) for case in cases}
        if values != {q.default and q.default * q.factor}:  # what all have by default says nothing
            _row(table, name, *(case.shown().get(name, "-") for case in cases))
    table.add_section()
    for text in dict.fromkeys(text for case in cases for text in case.groups()):
        _row(table, text, *(_group(case, text) for case in cases))
    note = "a is half the blade's thickness. 'cutbench materials NAME' shows sources and corrections."
    return Stack(table, Text(note))


def _group(case: Case, text: str) -> str:
    value = case.groups().get(text)
    return "-" if value is None else f"{value:.3g}"


def material(source: str | Path) -> RenderableType:
    """All about one material or case file. Raises BadInput."""
    case, about = load_case(source), materials.about(source)
    known = case.model.parameters()
    values = _table("name", "symbol", "value", "what", title=case.name)
    for name, text in case.shown().items():
        _row(values, name, known[name].symbol, text, known[name].doc)
    groups = _table("group", "value")
    for text in case.groups():
        _row(groups, text, _group(case, text))
    parts: list[RenderableType] = [values, groups]
    if about.get("corrections"):
        notes = _table("quantity", "printed", "read as", "why", title="corrections")
        for row in about["corrections"]:
            _row(notes, *(row.get(key, "") for key in ("quantity", "printed", "read", "why")))
        parts.append(notes)
    parts += [Text(f"{key}: {about[key]}") for key in ("note", "source", "doi") if key in about]
    parts.append(Text(f"model: {case.model.described}"))
    return Stack(*parts)


def mechanism_table() -> RenderableType:
    """All mechanisms, with what they need and the group a person may set."""
    table = _table("slot", "name", "kind", "parameters", "off at", "title")
    for m in registry().values():
        off = ", ".join(f"{name} = {value:g}" for name, value in m.off.items())
        parameters = ", ".join(q.name if q.unit == "1" else f"{q.name} ({q.unit})" for q in m.parameters)
        _row(table, m.slot, m.name, m.role or "-", parameters or "-", off or "-", m.title)
    groups = _table("group", "is", "sets", title="dimensionless groups that can be set")
    for g in settable_groups().values():
        _row(groups, g.name, g.text, g.parameter)
    return Stack(table, groups)


def mechanism(name: str) -> RenderableType:
    """All about one mechanism. Raises BadInput."""
    m = find_mechanism(name, key="mechanism")
    values = _table(
        "parameter", "unit", "symbol", "range", "off at", "default", "what", title=f"{m.title} ({m.name})"
    )
    for q in m.parameters:
        _row(values, q.name, q.unit, q.symbol, _range(q), _number(q.off), _number(q.default), q.doc)
    parts: list[RenderableType] = [values] if m.parameters else [Text(f"{m.title} ({m.name}): no parameters")]
    if groups := group_texts(m):
        parts.append(Text(f"groups: {', '.join(groups)}"))
    if m.settable:
        parts.append(Text(f"may be set: {', '.join(f'{g.name} = {g.text}' for g in m.settable)}"))
    if m.reads:
        parts.append(Text(f"reads: {', '.join(m.reads)}"))
    doc = inspect.cleandoc(sys.modules[type(m).__module__].__doc__ or type(m).__doc__ or "")
    parts += [Text(f"slot: {m.slot}" + (f", one of its kind: {m.role}" if m.role else "")), Text(doc)]
    return Stack(*parts)


def findings_table(found: Iterable[Finding]) -> RenderableType:
    """What checks of laws have found, a row each."""
    table = _table("law", "check", "", "what it requires, and what is wrong")
    for each in found:
        said = f"{each.says}: {each.wrong}" if each.wrong else each.says
        _row(table, each.law, each.check, "FAILED" if each.wrong else "ok", said)
    return table


def group_texts(m: Mechanism) -> list[str]:
    """The texts of a mechanism's groups, found by asking for them at typical values."""
    case = load_case(materials.names()[0]).set(with_=m.name)
    return list(m.groups(case.p))


def _range(q: Parameter) -> str:
    return q.range_text() if q.low is not None or q.high is not None else "any"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def result_table(result: Result) -> RenderableType:
    """What a run found, in one screen."""
    table = _table("", "value", title=f"{result.case.name} ({result.id})")
    for text in result.case.groups():
        _row(table, text, _group(result.case, text))
    table.add_section()
    for name, value in result.measures.items():
        _row(table, name, "-" if math.isnan(value) else f"{value:.4g}")
    for name, count in result.counts.items():
        _row(table, name, str(count))
    if "closure" in result.curve and len(result.curve["closure"]):
        _row(table, "closure of the energy ledger", f"{result.curve['closure'][-1]:.2e}")
    return table
