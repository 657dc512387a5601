"""Sections of TOML files: a table of entries says what one may hold, and a reader holds it to that."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.toml import among, one_of
from cutbench.base.units import Parameter, parse_quantity

#: How many values a list has that may not be empty.
SOME = (1, math.inf)


@dataclass(frozen=True)
class Entry:
    """One key of a section: what may stand there, and what it is where nothing does.

    ``type`` is str, bool, int or float; a ``Parameter``, for a number in its unit and within its bounds;
    dict, for a section that others read, or the entries of one; object, for anything; or a function that
    reads it. ``help`` says what would be right. Bounds of a float are not allowed themselves; a number in
    another ``unit`` than 1 has it beside it. ``count`` says how many values a list has; ``single`` takes one
    for a list of one.
    """

    key: str
    type: Any = str
    help: str = ""
    default: Any = None
    needed: bool = False
    choices: Collection[str] = ()
    low: float | None = None
    high: float | None = None
    unit: str = "1"
    count: tuple[float, float] | None = None
    single: bool = False

    def of(self, section: Mapping[str, object], where: str = "") -> Any:
        """Its value in a section, or the default. Raises BadInput."""
        if self.key in section:
            return self.read(section[self.key], where + self.key)
        if self.needed:
            raise BadInput(where + self.key, "(missing)", self.help)
        return self.default

    def read(self, raw: object, key: str = "") -> Any:
        """The value that ``raw`` stands for; ``key`` is its name where it stands. Raises BadInput."""
        key = key or self.key
        if self.count is None:
            return self._value(raw, key)
        items = [raw] if self.single and not isinstance(raw, list) else raw
        least, most = self.count
        if not isinstance(items, (list, tuple)) or not least <= len(items) <= most:
            raise BadInput(key, raw, self.help)
        return tuple(self._value(item, key) for item in items)

    def _value(self, raw: object, key: str) -> Any:
        quantity = self.type
        if self.choices:
            among(key, raw, self.choices)
            return raw
        if isinstance(self.type, tuple):
            return read_section(raw, self.type, f"{key}.")
        if self.type is float:
            quantity = Parameter(
                self.key, self.unit, "", "", self.low, self.high, open_low=True, open_high=True
            )
        if isinstance(quantity, Parameter):
            return quantity.check(parse_quantity(raw, quantity.unit, key=key), key=key)
        if not isinstance(self.type, type):
            return self.type(raw, key=key)
        if not isinstance(raw, self.type) or not self._fits(raw):
            raise BadInput(key, raw, self._right)
        return raw

    def _fits(self, raw: Any) -> bool:
        if self.type is int:
            return not isinstance(raw, bool) and self.low <= raw <= self.high
        return self.type is not str or bool(raw.strip())

    @property
    def _right(self) -> str:
        if self.type is int:
            return f"a whole number, {self.low} to {self.high}" + f": {self.help}" * bool(self.help)
        return self.help or f"a section, written [{self.key}]"


def read_section(
    section: object,
    entries: Sequence[Entry],
    where: str = "",
    instead: Callable[[str], str | None] = lambda key: None,
) -> dict[str, Any]:
    """The values of a section by key, defaults where nothing is written.

    ``where`` stands before each key in messages. ``instead`` may say what to write for a key that no entry
    has, where that is more than the nearest name. Raises BadInput.
    """
    if not isinstance(section, Mapping):
        name = where.rstrip(".: ")
        keys = ", ".join(each.key for each in entries)
        raise BadInput(name, section, f"a section, written [{name}], with {keys}")
    known = [each.key for each in entries]
    for key in section:
        if key not in known:
            raise BadInput(where + key, section[key], instead(key) or one_of(key, known))
    return {each.key: each.of(section, where) for each in entries}
