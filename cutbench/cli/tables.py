"""Tables for the terminal: materials, mechanisms, a run."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Group as Stack
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from cutbench.base.greek import plain_formula
from cutbench.base.units import Parameter
from cutbench.case import materials
from cutbench.case.case import Case, load_case
from cutbench.case.model import Model
from cutbench.case.model import groups as settable_groups
from cutbench.case.model import mechanism as find_mechanism
from cutbench.cli.show import PLAIN, table, verbose
from cutbench.mechanisms import registry
from cutbench.mechanisms.checks import Finding
from cutbench.run.result import Result, summary_lines


def _table(*heads: str, rows: Iterable[Sequence[str]] = (), title: str | None = None) -> Table:
    return table(heads, rows, title=title, **PLAIN)


def _row(made: Table, *cells: str) -> None:
    made.add_row(*map(Text, cells))


def material_table() -> RenderableType:
    """The known materials, a column each, with values and dimensionless groups."""
    cases = [load_case(name) for name in materials.names()]
    made = _table("", *(case.name for case in cases))
    known = {name: q for case in cases for name, q in case.model.parameters().items()}
    for name, q in known.items():
        values = {case.values.get(name) for case in cases}
        if values != {q.default and q.default * q.factor}:  # what all have by default says nothing
            _row(made, name, *(case.shown().get(name, "-") for case in cases))
    made.add_section()
    for text in dict.fromkeys(text for case in cases for text in case.groups()):
        _row(made, plain_formula(text), *(_group(case, text) for case in cases))
    note = "a is half the blade's thickness. 'cutbench materials NAME' shows sources and corrections."
    return Stack(made, Text(note))


def _group(case: Case, text: str) -> str:
    value = case.groups().get(text)
    return "-" if value is None else f"{value:.3g}"


def material(source: str | Path) -> RenderableType:
    """All about one material or case file. Raises BadInput."""
    case, about = load_case(source), materials.about(source)
    known = case.model.parameters()
    rows = [(name, known[name].symbol, text, known[name].doc) for name, text in case.shown().items()]
    groups = [(plain_formula(text), _group(case, text)) for text in case.groups()]
    parts: list[RenderableType] = [
        _table("name", "symbol", "value", "what", rows=rows, title=case.name),
        _table("group", "value", rows=groups),
    ]
    if about["corrections"]:
        read = [list(row.values()) for row in about["corrections"]]
        parts.append(_table("quantity", "printed", "read as", "why", rows=read, title="corrections"))
    parts += [Text(f"{key}: {about[key]}") for key in ("note", "source", "doi") if about[key]]
    parts.append(Text(f"model: {case.model.described}"))
    return Stack(*parts)


def mechanism_table() -> RenderableType:
    """All mechanisms, with what they need and the group a person may set."""
    made = _table("slot", "name", "kind", "parameters", "off at", "title")
    for m in registry().values():
        off = ", ".join(f"{name} = {value:g}" for name, value in m.off.items())
        parameters = ", ".join(q.name if q.unit == "1" else f"{q.name} ({q.unit})" for q in m.parameters)
        _row(made, m.slot, m.name, m.role or "-", parameters or "-", off or "-", m.title)
    rows = [(g.name, plain_formula(g.text), g.parameter) for g in settable_groups().values()]
    return Stack(made, _table("group", "is", "sets", rows=rows, title="dimensionless groups that can be set"))


def mechanism(name: str) -> RenderableType:
    """All about one mechanism. Raises BadInput."""
    m = find_mechanism(name, key="mechanism")
    rows = [
        (q.name, q.unit, q.symbol, _range(q), _number(q.off), _number(q.default), q.doc) for q in m.parameters
    ]
    heads, title = (
        ("parameter", "unit", "symbol", "range", "off at", "default", "what"),
        f"{m.title} ({m.name})",
    )
    parts: list[RenderableType] = [Text(f"{title}: no parameters")]
    if m.parameters:
        parts = [_table(*heads, rows=rows, title=title)]
    # The texts of its groups are found by asking for them at some values.
    model = Model().with_(m.name)
    some = {q.name: q.typical * q.factor for q in model.parameters().values()}
    if groups := m.groups(model.namespace(some)):
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
    made = _table("law", "check", "", "what it requires, and what is wrong")
    for each in found:
        why = each.wrong or each.untested
        state = "FAILED" if each.wrong else "not tested" if each.untested else "ok"
        _row(made, each.law, each.check, state, f"{each.says}: {why}" if why else each.says)
    return made


def _range(q: Parameter) -> str:
    return q.range_text() if q.low is not None or q.high is not None else "any"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def result_table(result: Result) -> RenderableType:
    """What a run found, in the order in which a person asks; ``-v``: all measures and counters, too."""
    head, *lines = summary_lines(result)
    made = _table("", "value", rows=[(name, text) for name, text in lines[1:]], title=head)
    made.add_section()
    for text in result.case.groups():
        _row(made, plain_formula(text), _group(result.case, text))
    if verbose():
        made.add_section()
        for name, value in result.measures.items():
            _row(made, name, "-" if math.isnan(value) else f"{value:.4g}")
        for name, count in result.counts.items():
            _row(made, name, str(count))
    return made
