"""How a file of readings is laid out: its lines, separator, header, columns and units, specimen by specimen.

A column is looked for by its name or its number. Names that all stand several times are those of several
specimens side by side, each with columns of its own.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.toml import nearest
from cutbench.data.titles import UNITS, is_unit, parted, size_of

LABEL = "repetition"
#: One column: its name in the header, or its number from 1.
Column = str | int
_SEPARATORS = (";", "\t", ",", "|", None)
#: Lines among which a header is looked for.
_HEAD = 200
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?")
_COMMENT = re.compile(r"\s*(#|//|%)\s*")


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
        at = self.where[role][specimen]
        return (self.names[at] if at < len(self.names) else "") or f"column {at + 1}"

    def own(self, specimen: int) -> list[int]:
        """The columns of one specimen that no other has."""
        return [at[specimen] for at in self.where.values() if len(set(at)) == len(at)]


def wrong(path: Path, line: int | None, key: str, value: str, expected: str) -> BadInput:
    return BadInput(file=str(path), line=line, key=key, value=value, expected=expected)


# -- lines and cells --------------------------------------------------------------------------------
def lines_of(path: Path) -> list[str]:
    """The lines of a text file, whatever its encoding and line ends. Raises BadInput."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError as error:
        raise BadInput(key="data", value=str(path), expected="a file that exists") from error
    except OSError as error:
        expected = f"a file that can be read ({error.strerror})"
        raise BadInput(key="data", value=str(path), expected=expected) from error
    try:
        text = raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if "\0" in text:
        raise wrong(path, None, "data", "a binary file", "a text file: export the readings as CSV")
    if not text.strip():
        raise wrong(path, None, "data", "an empty file", "a header and readings")
    return re.split(r"\r\n|\n|\r", text)


def split(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def is_empty(line: str) -> bool:
    return not line.strip() or bool(_COMMENT.match(line))


def is_number(cell: str) -> bool:
    return any(number_in(cell, comma) is not None for comma in (False, True))


def number_in(cell: str, comma: bool) -> float | None:
    """The number in ``cell``, with a decimal comma or point; None if it is none."""
    text = cell.strip().replace("\u2212", "-")
    good = (_COMMA_NUMBER if comma else _NUMBER).fullmatch(text)
    return float(text.replace(",", ".")) if good else None


# -- columns ----------------------------------------------------------------------------------------
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
    body, below = _units_row(lines, header, separator, where)
    if first is not None and header < 0:
        body = first
    count = len(next(iter(where.values())))
    specimens = _specimens(lines, header, separator, names, where) if count > 1 else ("",)
    return Layout(separator, header, names, body, where, below, specimens)


def _listed(asked: Column | list[Column]) -> list[Column]:
    return asked if isinstance(asked, list) else [asked]


def _first_row(path: Path, lines: list[str], asked: Mapping, widest: int) -> tuple[str | None, int]:
    """Separator and line of the first row with numbers in the numbered columns."""
    where = [int(c) - 1 for role, given in asked.items() if role != LABEL for c in _listed(given)]
    full = [i for i, line in enumerate(lines) if not is_empty(line)]

    def is_row(i: int, separator: str | None) -> bool:
        cells = split(lines[i], separator)
        return len(cells) >= widest and all(is_number(cells[at]) for at in where)

    # A single row of numbers among lines above the table is none of its rows.
    for i, after in zip(full, [*full[1:], *full[-1:]], strict=True):
        if i > _HEAD:
            break
        for separator in _SEPARATORS:
            if is_row(i, separator) and is_row(after, separator):
                return separator, i
    wanted = f"a file with {widest} columns, numbers in those that are read"
    raise wrong(path, None, "columns", f"column {widest}", wanted)


def _titles(lines: list[str], separator: str | None, first: int, asked: Mapping) -> tuple[int, list[str]]:
    """Header and titles above the first row, if there are any that are as wide."""
    width = len(split(lines[first], separator))
    where = {role: tuple(int(c) - 1 for c in _listed(given)) for role, given in asked.items()}
    above = [i for i in range(first - 1, max(first - 6, -1), -1) if not is_empty(lines[i])][:2]
    for i in above:
        cells = split(lines[i], separator)
        if len(cells) != width or any(map(is_number, cells)):
            break
        if _units_row(lines, i - 1, separator, where)[1] and i == above[0] and len(above) > 1:
            continue  # the row of units; titles stand above it
        return i, cells
    return -1, [f"column {k + 1}" for k in range(width)]


def _header(path: Path, lines: list[str], asked: Mapping) -> tuple[int, str | None, list[str]]:
    """The line, separator and titles with most of the names that are looked for."""
    named = [(role, c) for role, given in asked.items() for c in _listed(given) if isinstance(c, str)]
    best: tuple[int, int, str | None, list[str]] | None = None
    for separator in _SEPARATORS:
        for i, line in enumerate(lines[:_HEAD]):
            names = split(_COMMENT.sub("", line, count=1) if _COMMENT.match(line) else line, separator)
            known = sum(bool(_matches(name, names)) for _, name in named)
            if known and (best is None or known > best[0]):
                best = (known, i, separator, names)
    if best is None:
        names = _likely_header(lines)
        role, name = named[0]
        wanted = f"a column of the file ({', '.join(names[:12])})" + _meant(name, names)
        raise wrong(path, None, f"columns.{role}", name, wanted)
    return best[1], best[2], best[3]


def _where(
    path: Path, header: int, names: Sequence[str], asked: Mapping, wide: bool
) -> dict[str, tuple[int, ...]]:
    """The columns of each role, one for each specimen; beside lists of columns a single one is shared."""
    seen, line = [n for n in names if n], header + 1 if header >= 0 else None
    found: dict[str, list[int]] = {}

    def refused(role: str, column: object, expected: str) -> BadInput:
        return wrong(path, line, f"columns.{role}", str(column), expected)

    for role, given in asked.items():
        found[role] = []
        for column in _listed(given):
            hits = [column - 1] if isinstance(column, int) else _matches(str(column), names)
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
                f"a column that stands once; it stands {_times(count)}, {asked[role]} {_times(len(at))}. Give"
                " its number, or those of all specimens, such as force = [1, 4] and displacement = [2, 5]"
            )
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
        cells = split(lines[header - 1], separator)
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
    )
    for test in tests:
        if hits := [i for i, n in enumerate(names) if test(n)]:
            return hits
    return []


def _likely_header(lines: list[str]) -> list[str]:
    """The columns of the first line that has more than one, for a message."""
    for line in lines[:_HEAD]:
        for separator in _SEPARATORS[:4]:
            cells = [c for c in split(line, separator) if c]
            if len(cells) > 1:
                return cells
    return [lines[0].strip()]


def _units_row(
    lines: list[str], header: int, separator: str | None, where: Mapping[str, tuple[int, ...]]
) -> tuple[int, dict[int, str]]:
    """Where the readings begin, and by column the units in a row of their own below the header."""
    body = header + 1
    line = next((i for i in range(body, min(body + 3, len(lines))) if lines[i].strip()), None)
    if header < 0 or line is None:
        return body, {}
    cells, found, fits = split(lines[line], separator), {}, False
    for role, columns in where.items():
        for at in columns:
            if at >= len(cells) or is_number(cells[at]):
                return body, {}
            cell = cells[at].strip("[](){}<> ")
            if role == LABEL or not cell:
                continue
            if not is_unit(cell):
                return body, {}
            found[at] = cell
            fits |= size_of(cell, UNITS.get(role, "1")) is not None
    return (line + 1, found) if fits else (body, {})
