"""Runs of a store as a table: chosen by what they are and what came out, shown or written as CSV or JSON."""

from __future__ import annotations

import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.files import number
from cutbench.base.toml import one_of
from cutbench.base.units import parse_quantity, unit_factor
from cutbench.case.computation import computation_here
from cutbench.case.model import Model
from cutbench.case.model import groups as known_groups
from cutbench.run.measures import MEASURES, NOTED
from cutbench.run.store.runs import Head, writer

#: Columns that every run has, before its values.
_GENERAL = ("id", "name", "outcome", "reached_mm", "seconds", "dim", "mechanisms", "written", "message",
            "cutbench", "computation")  # fmt: skip
#: What a listing shows when it is not told.
DEFAULT = ("id", "name", "outcome", "drop_rel", "onset_mm", "peak_N", "steady_N", "seconds", "written")
_SIGNS: dict[str, Callable[[Any, Any], bool]] = {
    ">=": operator.ge, "<=": operator.le, "!=": operator.ne, "=": operator.eq, ">": operator.gt,
    "<": operator.lt,
}  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """``column sign value``; a value of a parameter is read in the unit the column is shown in."""

    column: str
    sign: str
    value: float | str

    def holds(self, row: Mapping[str, object]) -> bool:
        """Whether a run meets it; one that lacks the column does not."""
        found = row.get(self.column)
        if found is None or (isinstance(found, float) and math.isnan(found)):
            return False
        if isinstance(self.value, float):
            if not isinstance(found, (int, float)):
                return False
            if self.sign in ("=", "!="):  # as a person writes numbers
                same = math.isclose(found, self.value, rel_tol=1e-6, abs_tol=1e-15)
                return same == (self.sign == "=")
            return _SIGNS[self.sign](found, self.value)
        if self.column == "mechanisms":
            there = self.value in str(found).split()
            return there == (self.sign == "=")
        return _SIGNS[self.sign](str(found), self.value)


def row_of(id: str, head: Head) -> dict[str, object]:
    """A run as one flat row: general columns, values in their units, groups by name, measures."""
    values = {name: float(v) for name, (v, _) in head["values"].items()}
    internal = {name: float(v) * unit_factor(unit) for name, (v, unit) in head["values"].items()}
    with suppress(BadInput):  # laws that this process does not know
        internal = vars(Model(tuple(head["mechanisms"])).namespace(internal))
    groups = {
        name: float(f"{group.value(SimpleNamespace(**internal)):.6g}")
        for name, group in known_groups().items()
        if group.unit == "1" and {group.parameter, *group.needs} <= internal.keys()
    }
    measures = {name: number(v) for name, v in head["measures"].items()}
    numerics = {k: v for k, v in head["numerics"].items() if v is not None}
    shown = {
        "id": id,
        "mechanisms": " ".join(head["mechanisms"]),
        "written": datetime.fromtimestamp(head["written"], UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "cutbench": head["versions"].get("cutbench"),
    }
    general = {name: shown.get(name, head.get(name)) for name in _GENERAL}
    return general | numerics | values | groups | measures


def other_computations(heads: Iterable[Head]) -> dict[str, int]:
    """How many runs are of another computation than this process's, by what wrote them."""
    of_others = (head for head in heads if head["computation"] != computation_here(head["mechanisms"]))
    return dict(Counter(writer(head) for head in of_others))


def units(heads: Iterable[Head]) -> dict[str, str]:
    """The unit of each value that is not a pure number."""
    return {name: unit for head in heads for name, (_, unit) in head["values"].items() if unit != "1"}


def columns_of(rows: Sequence[Mapping[str, object]]) -> list[str]:
    """All columns of some rows: the general ones, then the others in order of appearance."""
    return list(dict.fromkeys([*_GENERAL, *(name for row in rows for name in row)]))


def parse_condition(text: str, known: Sequence[str], unit: Mapping[str, str]) -> Condition:
    """``G >= 10 kPa``, ``drop_rel>0.1``, ``name = gelatin``, ``mechanisms = coulomb``. Raises BadInput."""
    match = re.fullmatch(r"\s*([\w.]+)\s*(>=|<=|!=|==|=|>|<)\s*(.+?)\s*", text)
    if not match:
        raise BadInput("--where", text, "column, sign and value, such as 'drop_rel > 0.1' or 'G >= 10 kPa'")
    column, sign, raw = match.groups()
    sign = "=" if sign == "==" else sign
    if column not in known and column not in MEASURES | NOTED:
        raise BadInput("--where", column, one_of(column, known))
    if column in _GENERAL and column not in ("reached_mm", "seconds", "dim"):
        return Condition(column, sign, raw)
    if column in unit:
        return Condition(column, sign, float(parse_quantity(raw, unit[column], key=column)))
    try:
        return Condition(column, sign, float(raw))
    except ValueError:
        return Condition(column, sign, raw)  # a choice, such as element = P2


def table_of(
    heads: Mapping[str, Head], where: Sequence[str], columns: Sequence[str] | None, sort: str | None
) -> tuple[list[str], list[list[object]]]:
    """Heads and rows of the runs that meet all of ``where``. Raises BadInput for an unknown column."""
    rows = [row_of(id, head) for id, head in heads.items()]
    known = columns_of(rows)
    unit = units(heads.values())
    conditions = [parse_condition(text, known, unit) for text in where]
    chosen = list(columns) if columns else known
    for name in [*chosen, *([sort] if sort else [])]:
        if name not in known and name not in MEASURES | NOTED and name not in DEFAULT:
            raise BadInput("--columns", name, one_of(name, known))
    kept = [row for row in rows if all(condition.holds(row) for condition in conditions)]
    if sort:
        kept.sort(key=lambda row: (_missing(row.get(sort)), str(type(row.get(sort))), row.get(sort) or 0))
    names = [f"{name} [{unit[name]}]" if name in unit else name for name in chosen]
    return names, [[row.get(name) for name in chosen] for row in kept]


def _missing(value: object) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))
