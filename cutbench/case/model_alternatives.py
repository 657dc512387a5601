"""What a model leaves open: the cases that a case could as well be, for all that tests have told.

Laws say it of themselves (``Parameter.unmeasured``, ``Mechanism.alternatives``), and so do numerical choices
that stand for something of the material's (``numerics.UNMEASURED``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.case.numerics import UNMEASURED
from cutbench.mechanisms import registry


def alternative_cases(case: Case, *, switching_on: bool = True) -> tuple[dict[str, Case], dict[str, str]]:
    """``case`` with one thing changed that the model leaves open, by what that is; and those that cannot be,
    with the reason. What is off could as well be there: that is left out without ``switching_on``."""
    cases: dict[str, Case] = {}
    refused: dict[str, str] = {}
    seen = {case.id}
    for name, changes in _changes(case, switching_on):
        try:
            other = case.set(**changes)
        except BadInput as error:
            refused[name] = str(error)
            continue
        if other.id not in seen:  # what is off is not changed by a factor
            seen.add(other.id)
            cases[name] = other
    return cases, refused


def _changes(case: Case, switching_on: bool) -> Iterator[tuple[str, Mapping[str, object]]]:
    """Each in words, and as ``Case.set`` takes it."""
    for law in case.model.all:
        for q in law.parameters:
            now = case.values[q.name]
            off = q.off is not None and now == q.off_value
            for factor in q.unmeasured if switching_on or not off else ():
                value = factor * (q.typical * q.factor if off else now)
                unit = "" if q.unit == "1" else f" {q.unit}"
                yield f"{q.name} = {q.show(value)}", {q.name: f"{value / q.factor!r}{unit}"}
        for name in law.alternatives:
            if name in registry():
                yield f"with {name}", {"with_": name}
    for name, (keys, factors) in UNMEASURED.items():
        for factor in factors:
            scaled = {key: factor * getattr(case.numerics, key) for key in keys}
            yield f"{name} × {factor:g}", scaled
