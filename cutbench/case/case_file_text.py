"""A case as the file that ``load_case`` reads: values with units, section by section."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

from cutbench.case.case import Case
from cutbench.case.model import section_of
from cutbench.case.motion import DEPTH
from cutbench.case.numerics import defaults
from cutbench.case.values import SECTIONS

#: Digits of a value: more than any test tells, few enough to be read.
DIGITS = 9


def case_text(
    case: Case, about: Mapping[str, str] | None = None, remarks: Mapping[str, str] | None = None
) -> str:
    """``case`` as TOML; ``about`` is its section [material], ``remarks`` stand behind values, by name.

    What nobody sets (``Tuning``) is left out.
    """
    lines = [f"mechanisms = {json.dumps(list(case.mechanisms))}", "", "[material]"]
    lines += [f"{key} = {_text(value)}" for key, value in {"name": case.name, **(about or {})}.items()]
    for section in SECTIONS:
        if part := [line for where, line in _values(case, remarks or {}) if where == section]:
            lines += ["", f"[{section}]", *part]
    if numerics := list(_numerics(case)):
        lines += ["", "[numerics]", *numerics]
    return "\n".join(lines)


def _values(case: Case, remarks: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Section and line of each value."""
    for name, q in case.model.parameters().items():
        value = f"{case.values[name] / q.factor:.{DIGITS}g}"
        written = value if q.unit == "1" else _text(f"{value} {q.unit}")
        yield section_of(name), f"{name} = {written}" + (f"  # {remarks[name]}" if name in remarks else "")
    if case.outline:
        yield "blade", f"outline = {json.dumps(case.outline)}"
    if case.motion:
        yield "protocol", f"motion = {json.dumps(case.motion)}"
    if case.until != DEPTH:
        yield "protocol", f"until = {_text(case.until)}"


def _numerics(case: Case) -> Iterator[str]:
    """What differs from the defaults."""
    usual = defaults(case.dim).written()
    for name, value in case.numerics.written().items():
        if value != usual[name]:
            yield f"{name} = {json.dumps(value)}"


def _text(value: str) -> str:
    """A TOML text: JSON's, of which TOML takes all escapes that ``json`` writes but that of DEL."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "")
