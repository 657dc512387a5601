"""Measured readings from text files as machines and spreadsheets write them; the files are only read.

Understood without being told: separators ; tab , | and blanks; decimal commas; any lines above the
header; comments; units in column names ("F [N]", "Force (mN)", "F / N", "force_N") or in a row below;
quotes; UTF-8 with or without BOM, UTF-16, Latin-1; any line ends. Whatever would have to be guessed
is refused with file, line, column and value.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.toml import nearest
from cutbench.data.titles import UNITS, parted, size_of

LABEL = "repetition"
_SEPARATORS = (";", "\t", ",", "|", None)
#: Lines among which a header is looked for.
_HEAD = 200
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?")
_COMMENT = re.compile(r"\s*(#|//|%)\s*")


@dataclass(frozen=True)
class Table:
    """Columns by role, (n,) in mm, N, s, MPa; ``labels`` (n,) of the repetitions; ``lines`` (n,)."""

    path: Path
    columns: Mapping[str, np.ndarray]
    labels: tuple[str, ...] | None
    lines: np.ndarray


@dataclass(frozen=True)
class _Layout:
    """How a file is laid out: separator, index of the header line (-1: none), column of each role."""

    separator: str | None
    header: int
    names: Sequence[str]
    where: Mapping[str, int]


def read_table(
    path: str | Path,
    columns: Mapping[str, str | int],
    units: Mapping[str, str] | None = None,
    blanks: Sequence[str] = (),
) -> Table:
    """Read the ``columns`` (role -> name in the header, or number from 1) of a text file.

    ``units`` (role -> unit) where the header does not say. In the roles ``blanks`` an empty cell or nan
    means not measured, and is nan. Raises BadInput for a file that cannot be
    read, a column that is missing or stands twice, a unit that is missing, wrong or contradicted by
    the header, and cells that are no numbers.
    """
    path, units = Path(path), dict(units or {})
    lines = _lines(path)
    layout = _find(path, lines, columns)
    body, below = _units_below(lines, layout)
    rows, numbers = _rows(path, lines, layout, body)
    read = [role for role in columns if role != LABEL]
    factors = {role: _factor(path, layout, role, units.get(role), below.get(role)) for role in read}
    comma = _decimal_comma(path, layout, rows, numbers)

    def cell(role: str, row: list[str], line: int) -> float:
        text = row[layout.where[role]]
        blank = role in blanks and text.strip().lower() in ("", "nan")
        return np.nan if blank else _number(path, layout, role, text, line, comma)

    cells = list(zip(rows, numbers, strict=True))
    found = {role: factor * np.array([cell(role, *at) for at in cells]) for role, factor in factors.items()}
    labels = None
    if LABEL in columns:
        labels = tuple(row[layout.where[LABEL]].strip() for row in rows)
        wanted = "the name of a repetition in every reading"
        for label, line in zip(labels, numbers, strict=True):
            if not label:
                raise _wrong(path, line, _title(layout, LABEL), "", wanted)
    return Table(path, found, labels, np.array(numbers, dtype=int))


def _wrong(path: Path, line: int | None, key: str, value: str, expected: str) -> BadInput:
    return BadInput(file=str(path), line=line, key=key, value=value, expected=expected)


# -- lines and layout -------------------------------------------------------------------------------
def _lines(path: Path) -> list[str]:
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
        raise _wrong(path, None, "data", "a binary file", "a text file: export the readings as CSV")
    if not text.strip():
        raise _wrong(path, None, "data", "an empty file", "a header and readings")
    return re.split(r"\r\n|\n|\r", text)


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _find(path: Path, lines: list[str], columns: Mapping[str, str | int]) -> _Layout:
    numbered = {role: c for role, c in columns.items() if isinstance(c, int)}
    named = {role: c for role, c in columns.items() if isinstance(c, str)}
    if numbered and named:
        expected = "names of columns or numbers, not both"
        raise BadInput(key="columns", value=str(dict(columns)), expected=expected)
    return _by_number(path, lines, numbered) if numbered else _by_name(path, lines, named)


def _by_number(path: Path, lines: list[str], columns: Mapping[str, int]) -> _Layout:
    where = {role: number - 1 for role, number in columns.items()}
    widest = max(columns.values())
    for i, line in enumerate(lines[:_HEAD]):
        if _COMMENT.match(line) or not line.strip():
            continue
        for separator in _SEPARATORS:
            cells = _split(line, separator)
            if len(cells) < widest:
                continue
            if all(_is_number(cells[at]) for role, at in where.items() if role != LABEL):
                names = [f"column {k + 1}" for k in range(len(cells))]
                return _Layout(separator, i - 1, names, where)
    wanted = f"a file with {widest} columns, numbers in those that are read"
    raise _wrong(path, None, "columns", f"column {widest}", wanted)


def _by_name(path: Path, lines: list[str], columns: Mapping[str, str]) -> _Layout:
    best: tuple[int, int, str | None, list[str]] | None = None
    for separator in _SEPARATORS:
        for i, line in enumerate(lines[:_HEAD]):
            names = _split(_COMMENT.sub("", line, count=1) if _COMMENT.match(line) else line, separator)
            known = sum(bool(_matches(name, names)) for name in columns.values())
            if known and (best is None or known > best[0]):
                best = (known, i, separator, names)
    if best is None:
        names = _likely_header(lines)
        role, name = next(iter(columns.items()))
        wanted = f"a column of the file ({', '.join(names[:12])})" + _meant(name, names)
        raise _wrong(path, None, f"columns.{role}", name, wanted)
    _, header, separator, names = best
    where: dict[str, int] = {}
    for role, name in columns.items():
        hits, seen = _matches(name, names), [n for n in names if n]
        taken = next((r for r, at in where.items() if hits == [at]), None)
        if not hits:
            wanted = f"one of the columns {', '.join(seen[:12])}{_meant(name, seen)}"
        elif len(hits) > 1:
            wanted = "a column that stands once; it stands twice"
        elif taken is not None:
            wanted = f"a column of its own; '{name}' is read as {taken}"
        else:
            where[role] = hits[0]
            continue
        raise _wrong(path, header + 1, f"columns.{role}", name, wanted)
    return _Layout(separator, header, names, where)


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
            cells = [c for c in _split(line, separator) if c]
            if len(cells) > 1:
                return cells
    return [lines[0].strip()]


# -- units ----------------------------------------------------------------------------------------------
def _factor(path: Path, layout: _Layout, role: str, given: str | None, below: str | None) -> float:
    """From the file's unit of ``role`` to the internal one."""
    target, title = UNITS[role], _title(layout, role)
    line = layout.header + 1 if layout.header >= 0 else None
    written = below if below is not None else parted(title, target)[1]
    wanted = "a number without unit, written '1'" if target == "1" else f"a unit such as '{target}'"
    if given is not None:
        factor = size_of(given, target)
        if factor is None:
            raise BadInput(key=f"units.{role}", value=given, expected=wanted)
        if written is not None and size_of(written, target) != factor:
            raise _wrong(path, line, title, written, f"the unit that units.{role} gives, '{given}'")
        return factor
    if written is None:
        if target == "1":
            return 1.0
        wanted = f"units = {{ {role} = '{target}' }} in the campaign, or a title '{title} [{target}]'"
        raise _wrong(path, line, title, "no unit", wanted)
    factor = size_of(written, target)
    if factor is None:
        raise _wrong(path, line, title, written, f"{wanted} for {role}")
    return factor


def _units_below(lines: list[str], layout: _Layout) -> tuple[int, dict[str, str]]:
    """Where the readings begin, and units that stand in a row of their own below the header."""
    body = layout.header + 1
    if layout.header < 0 or body >= len(lines):
        return body, {}
    cells = _split(lines[body], layout.separator)
    found = {}
    for role, at in layout.where.items():
        if at >= len(cells) or _is_number(cells[at]):
            return body, {}
        cell = cells[at].strip("[](){}<> ")
        if role == LABEL or not cell:
            continue
        if size_of(cell, UNITS.get(role, "1")) is None:
            return body, {}
        found[role] = cell
    return (body + 1, found) if found else (body, {})


# -- cells ------------------------------------------------------------------------------------------
def _rows(path: Path, lines: list[str], layout: _Layout, body: int) -> tuple[list[list[str]], list[int]]:
    rows, numbers = [], []
    need, width = max(layout.where.values()) + 1, len(layout.names)
    for number, line in enumerate(lines[body:], start=body + 1):
        if not line.strip() or _COMMENT.match(line):
            continue
        try:
            cells = _split(line, layout.separator)
        except csv.Error as error:
            raise _wrong(path, number, "row", line[:40], f"a row of cells ({error})") from error
        if not any(cells):
            continue
        if len(cells) < need or any(cells[width:]):
            wanted = f"{width} cells as in the header, not {len(cells)}"
            if layout.separator == "," and len(cells) > width:
                wanted += "; decimal commas need another separator, such as a semicolon"
            raise _wrong(path, number, "row", line.strip()[:60], wanted)
        rows.append(cells)
        numbers.append(number)
    if not rows:
        raise _wrong(path, body, "data", "no reading below the header", "readings")
    return rows, numbers


def _decimal_comma(path: Path, layout: _Layout, rows: list[list[str]], numbers: list[int]) -> bool:
    """Whether numbers are written 1,5. Both 1,5 and 1.5 in one file are refused."""
    seen: dict[str, tuple[str, int]] = {}
    for row, line in zip(rows, numbers, strict=True):
        for role, at in layout.where.items():
            for sign in ",.":
                if role != LABEL and sign in row[at]:
                    seen.setdefault(sign, (row[at], line))
        if len(seen) == 2:
            text, last = max(seen.values(), key=lambda item: item[1])
            wanted = "one decimal sign in all of the file, and no sign between thousands"
            raise _wrong(path, last, "number", text, wanted)
    return "," in seen


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell.strip()) or _COMMA_NUMBER.fullmatch(cell.strip()))


def _number(path: Path, layout: _Layout, role: str, cell: str, line: int, comma: bool) -> float:
    text = cell.strip().replace("\u2212", "-")
    if (_COMMA_NUMBER if comma else _NUMBER).fullmatch(text):
        return float(text.replace(",", "."))
    wanted = "a number in every reading" + ("" if text else "; the cell is empty")
    raise _wrong(path, line, _title(layout, role), cell, wanted)


def _title(layout: _Layout, role: str) -> str:
    return layout.names[layout.where[role]]
