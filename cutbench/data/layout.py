"""How a file of readings is laid out: its lines, separator, header, columns and units, specimen by specimen.

A column is looked for by its name or its number. Names that all stand several times are those of several
specimens side by side, each with columns of its own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.toml import nearest
from cutbench.base.unit_spelling import COMMON, exactly, is_unit, size_of
from cutbench.data.text_cells import (
    error_at_line,
    is_empty,
    is_missing,
    is_value,
    lines_of,
    split_line,
    uncommented,
)
from cutbench.run.read_off import READ_OFF

LABEL = "repetition"
#: One column: its name in the header, or its number from 1.
Column = str | int
_SEPARATORS = (";", "\t", ",", "|", None)
#: Lines among which a header is looked for.
_HEAD = 200
#: Rows in a run that make a table, of which two may stand among results above it: what a test has at least.
_TABLE = 5
#: Names of the columns of a displacement field in the files of correlation programs.
_ALSO = {"u_x": ("ux", "u"), "u_y": ("uy", "v")}
_UNIT_OF_CLOCKS = re.compile(r"[ymdhs][ymdhs:./ -]*:[ymdhs:.0 ]+", re.IGNORECASE)


@dataclass(frozen=True)
class Layout:
    """How a file is laid out: separator, index of the header line (-1: none) and its titles, index of the
    first reading's line, each role's column for each specimen, units in a row of their own by column, and
    the specimens' names ('' for a single one)."""

    separator: str | None
    header: int
    names: Sequence[str]
    body: int
    where: Mapping[str, tuple[int, ...]]
    below: Mapping[int, str]
    specimens: tuple[str, ...]

    def title(self, role: str, specimen: int = 0) -> str:
        return self.title_of(self.where[role][specimen])

    def title_of(self, at: int) -> str:
        return (self.names[at] if at < len(self.names) else "") or f"column {at + 1}"

    def own(self, specimen: int) -> list[int]:
        """The columns of one specimen that no other has."""
        return [at[specimen] for at in self.where.values() if len(set(at)) == len(at)]

    @cached_property
    def read(self) -> list[int]:
        """The columns that hold numbers."""
        return [at for role, columns in self.where.items() if role != LABEL for at in columns]

    @cached_property
    def needed(self) -> int:
        """Cells that a reading has at least."""
        return max(max(at) for at in self.where.values()) + 1

    def repeats(self, line: str) -> bool:
        """Whether ``line`` is the header once more."""
        if self.header < 0 or not self.names[0].casefold() or self.names[0].casefold() not in line.casefold():
            return False
        cells, names = split_line(uncommented(line), self.separator), list(self.names)
        return ";".join(cells).rstrip(";").casefold() == ";".join(names).rstrip(";").casefold()

    def is_text(self, cells: Sequence[str], reading: Sequence[str] | None) -> bool:
        """Whether a line is no reading but words: none of its cells that are read is a number, or it begins
        with a word where a ``reading`` begins with a number."""
        first = next(cell for cell in cells if cell)
        if first[0].isdigit():
            return False
        if not any(map(str.isalnum, "".join(cells))):
            return True  # a ruled line
        if is_value(first) or not (first[0].isalpha() or first[0] in "[(<*=\"'"):
            return False
        read = [cells[at] for at in self.read if at < len(cells) and cells[at]]
        if not any(map(is_value, read)):
            return True
        return bool(cells[0]) and reading is not None and is_value(reading[0])


def find_layout(
    path: Path, lines: list[str], columns: Mapping[str, Column | Sequence[Column]], wide: bool
) -> Layout:
    """Where the ``columns`` stand: by role a name or number, or a list of those, one for each specimen.

    ``wide``: names that all stand several times are those of several specimens. Raises BadInput.
    """
    asked = {role: c if isinstance(c, (str, int)) else list(c) for role, c in columns.items()}
    each = [c for given in asked.values() for c in (given if isinstance(given, list) else [given])]
    if all(isinstance(c, int) for c in each):
        separator, first = _first_row(path, lines, asked, max(int(c) for c in each))
        header, names = _titles(lines, separator, first, asked)
    else:
        header, separator, names = _header(path, lines, asked)
        first = None
    where = _where(path, header, names, asked, wide)
    body, below = units_row(lines, header, separator, where)
    if first is not None and header < 0:
        body = first
    count = len(next(iter(where.values())))
    specimens = _specimens(lines, header, separator, names, where) if count > 1 else ("",)
    return Layout(separator, header, names, body, where, below, specimens)


def matching_titles(path: Path, columns: Mapping[str, Column], names: Sequence[str]) -> dict[str, str]:
    """The titles of those of ``names`` that stand in the header with ``columns``. Raises BadInput."""
    if all(isinstance(c, int) for c in columns.values()):
        return {}
    titles = _header(path, lines_of(path), columns)[2]
    return {name: titles[hits[0]] for name in names if (hits := _matches(name, titles))}


def _listed(asked: Column | list[Column]) -> list[Column]:
    return asked if isinstance(asked, list) else [asked]


def _first_row(path: Path, lines: list[str], asked: Mapping, widest: int) -> tuple[str | None, int]:
    """Separator and line of the first row with numbers in the numbered columns."""
    where = [int(c) - 1 for role, given in asked.items() if role != LABEL for c in _listed(given)]
    full = [i for i, line in enumerate(lines) if not is_empty(line)]

    def is_row(i: int, separator: str | None) -> bool:
        cells = split_line(lines[i], separator)
        return len(cells) >= widest and all(is_value(cells[at]) for at in where)

    # A few rows of numbers among lines above the table are none of its rows.
    for least in (_TABLE, 2, 1):
        runs = dict.fromkeys(_SEPARATORS, 0)
        for k, i in enumerate(full[: _HEAD + _TABLE]):
            for separator in _SEPARATORS:
                runs[separator] = runs[separator] + 1 if is_row(i, separator) else 0
                if runs[separator] == least and (least > 1 or i == full[-1]):
                    return separator, full[k + 1 - least]
    wanted = f"a file with {widest} columns, numbers in those that are read"
    raise error_at_line(path, None, "columns", f"column {widest}", wanted)


def _titles(lines: list[str], separator: str | None, first: int, asked: Mapping) -> tuple[int, list[str]]:
    """Header and titles above the first row, if there are any that are as wide."""
    width = len(split_line(lines[first], separator))
    where = {role: tuple(int(c) - 1 for c in _listed(given)) for role, given in asked.items()}
    above = [i for i in range(first - 1, max(first - 6, -1), -1) if not is_empty(lines[i])][:2]
    for i in above:
        cells = split_line(lines[i], separator)
        if len(cells) != width or any(is_value(cell) and not is_missing(cell) for cell in cells):
            break
        if units_row(lines, i - 1, separator, where)[1] and i == above[0] and len(above) > 1:
            continue  # the row of units; titles stand above it
        return i, cells
    return -1, [f"column {k + 1}" for k in range(width)]


def _header(path: Path, lines: list[str], asked: Mapping) -> tuple[int, str | None, list[str]]:
    """The line, separator and titles with most of the names that are looked for, above a table if several
    have as many."""
    named = [(role, c) for role, given in asked.items() for c in _listed(given) if isinstance(c, str)]
    most = 0
    best: list[tuple[list[int], int, str | None, list[str]]] = []
    for separator in _SEPARATORS:
        for i, line in enumerate(lines[:_HEAD]):
            names = split_line(uncommented(line), separator)
            hits = [hit[0] for _, name in named if (hit := _matches(name, names))]
            if len(hits) > most:
                most, best = len(hits), []
            if hits and len(hits) == most:
                best.append((hits, i, separator, names))
    if not best:
        names = _likely_header(lines)
        role, name = named[0]
        wanted = f"a column of the file ({', '.join(names[:12])})" + _meant(name, names)
        raise error_at_line(path, None, f"columns.{role}", name, wanted)

    headings = {i for _, i, *_ in best}

    def above_a_table(found: tuple) -> bool:
        at, i, separator, _ = found
        end = min((k for k in headings if k > i), default=i + 4 * _TABLE)
        rows = [split_line(line, separator) for line in lines[i + 1 : end] if not is_empty(line)]
        return sum(len(r) > max(at) and all(is_value(r[k]) for k in at) for r in rows) >= _TABLE

    found = best[0] if len(best) == 1 else next(filter(above_a_table, best), best[0])
    return found[1], found[2], found[3]


def _where(
    path: Path, header: int, names: Sequence[str], asked: Mapping, wide: bool
) -> dict[str, tuple[int, ...]]:
    """The columns of each role, one for each specimen; beside lists of columns a single one is shared."""
    seen, line = [n for n in names if n], header + 1 if header >= 0 else None
    found: dict[str, list[int]] = {}

    def refused(role: str, column: object, expected: str) -> BadInput:
        return error_at_line(path, line, f"columns.{role}", str(column), expected)

    for role, given in asked.items():
        found[role] = []
        for column in _listed(given):
            hits = [column - 1] if isinstance(column, int) else _matches(str(column), names)
            # Of a strain in % and one in mm the first is a strain.
            fits = [at for at in hits if parted(names[at], UNITS.get(role))[1] is not None] if names else []
            fits = [
                at for at in fits if size_of(parted(names[at])[1] or "", UNITS.get(role, "1")) is not None
            ]
            if len(hits) > 1 and len(fits) == 1:
                hits = fits
            if not hits:
                known = f"one of the columns {', '.join(seen[:12])}{_meant(str(column), seen)}"
                raise refused(role, column, known)
            if taken := next((r for r, other in found.items() if set(hits) & set(other)), None):
                raise refused(role, column, f"a column of its own; '{column}' is read as {taken}")
            if len(hits) > 1 and (isinstance(given, list) or not wide or role == LABEL):
                raise refused(role, column, f"a column that stands once; it stands {_times(len(hits))}")
            found[role] += hits
    count = max(map(len, found.values()))
    many = next(role for role, at in found.items() if len(at) == count)
    for role, at in found.items():
        if len(at) == 1 < count and isinstance(asked[many], list) and role != LABEL:
            found[role] = at * count
        elif len(at) != count:
            expected = (
                f"a column that stands once; it stands {_times(count)}, {asked[role]} {_times(len(at))}."
            )
            units = {parted(names[k])[1] for k in found[many]}
            if len(units) == count:
                expected += f" Of several units name one: '{names[found[many][0]]}'"
            else:
                expected += " Give its number, or those of all specimens, such as force = [1, 4] and"
                expected += " displacement = [2, 5]"
            raise refused(many, asked[many], expected)
    return {role: tuple(at) for role, at in found.items()}


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _specimens(
    lines: list[str], header: int, separator: str | None, names: Sequence[str], where: Mapping
) -> tuple[str, ...]:
    """What specimens side by side are called: by the row above the header, their titles, else numbers."""
    own = [at for at in where.values() if len(set(at)) == len(at)]
    count = len(own[0])
    starts = [min(at[k] for at in own) for k in range(count)]
    if header > 0 and starts == sorted(starts):
        cells = split_line(lines[header - 1], separator)
        parts = [cells[a:b] for a, b in zip(starts, [*starts[1:], len(cells)], strict=True)]
        titles = [next((cell for cell in part if cell), "") for part in parts]
        if all(titles) and len(set(titles)) == count:
            return tuple(titles)
    for at in own:
        titles = [parted(names[i])[0] if i < len(names) else "" for i in at]
        if all(titles) and len(set(titles)) == count:
            return tuple(titles)
    return tuple(str(k + 1) for k in range(count))


def _meant(name: str, names: Sequence[str]) -> str:
    guess = nearest(name, names)
    return f"; did you mean '{guess}'?" if guess else ""


def _matches(name: str, names: Sequence[str]) -> list[int]:
    """Columns called ``name``: to the letter, else regardless of case and blanks, else without the unit."""

    def plain(text: str) -> str:
        return re.sub(r"\s+", "", text).casefold()

    tests = (
        lambda n: n == name.strip(),
        lambda n: plain(n) == plain(name),
        lambda n: bool(n) and plain(parted(n)[0]) == plain(name),
        lambda n: bracketed(n) is not None and plain(re.split(r"[\[({<]", n)[0]) == plain(name),
        lambda n: plain(parted(n)[0]) in _ALSO.get(name, ()),
    )
    for test in tests:
        if hits := [i for i, n in enumerate(names) if test(n)]:
            return hits
    return []


def _likely_header(lines: list[str]) -> list[str]:
    """The columns of the first line that has more than one, for a message."""
    for line in lines[:_HEAD]:
        for separator in _SEPARATORS[:4]:
            cells = [c for c in split_line(line, separator) if c]
            if len(cells) > 1:
                return cells
    return [lines[0].strip()]


def units_row(
    lines: list[str], header: int, separator: str | None, where: Mapping[str, tuple[int, ...]]
) -> tuple[int, dict[int, str]]:
    """Where the readings begin, and by column the units in a row of their own below the header."""
    body = header + 1
    line = next((i for i in range(body, min(body + 3, len(lines))) if lines[i].strip()), None)
    if header < 0 or line is None:
        return body, {}
    cells, found, fits = split_line(lines[line], separator), {}, False
    for role, columns in where.items():
        for at in columns:
            if at >= len(cells) or (is_value(cells[at]) and not is_missing(cells[at])):
                return body, {}
            cell = cells[at].strip("[](){}<> ")
            if role == LABEL or not cell or _UNIT_OF_CLOCKS.fullmatch(cell):
                continue
            found[at] = cell
            fits |= size_of(cell, UNITS.get(role, "1")) is not None
    return (line + 1, found) if fits else (body, {})


# -- name and unit in the title of a column -----------------------------------------------------------
#: Unit of each role inside; ``repetition`` is a label, and ``valid`` a number as it stands.
UNITS = {
    "displacement": "mm",
    "force": "N",
    "time": "s",
    "speed": "mm/s",
    "stretch": "1",
    "strain": "1",
    "stress": "MPa",
    "pressure": "MPa",
    "normal_force": "N",
    **dict.fromkeys(("x", "y", "u_x", "u_y", "travel"), "mm"),
    "valid": "",
    **{name: unit for name, (unit, _, _) in READ_OFF.items()},
}

_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\])}>]*?)\s*[\])}>]")
#: Without brackets only a unit of the right kind is one: F_m may be a force's name.
_BARE = (
    re.compile(r"(.*\S)\s+/\s+(\S+)"),
    re.compile(r"(.*\S)\s+in\s+(\S+)"),
    re.compile(r"(.*[^\s/])(?:/|,\s*)([\w%]+)"),
    re.compile(r"(.*[^_])_([^_]+)"),
)


def parted(title: str, target: str | None = None) -> tuple[str, str | None]:
    """Name and unit of a column's title; None where it has no unit.

    ``target`` is a unit of the kind that the column should have; without it any kind that readings have.
    """
    title = title.strip()
    match = _BRACKETS.fullmatch(title)
    if match and is_unit(match[2]):
        return match[1], match[2]
    for pattern in _BARE:
        match = pattern.fullmatch(title)
        targets = set(COMMON) if target is None else {target}
        if match and any(size_of(match[2], kind) is not None for kind in targets):
            # F_g and F_p may be names, and not of weights.
            exact = any(exactly(match[2], kind) is not None for kind in targets)
            if pattern is not _BARE[-1] or exact or len(match[2]) > 1 or "s" in targets:
                return match[1], match[2]
    return title, None


def bracketed(title: str) -> str | None:
    """What a title has in brackets at its end, a unit or not."""
    match = _BRACKETS.fullmatch(title.strip())
    return match[2] if match else None
