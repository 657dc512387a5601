"""The columns of a text file of readings: its lines and cells, the header, separator, titles and units,
specimen by specimen, and what cells hold: numbers, units, times of a clock, words for what was not measured.

A column is looked for by its name or its number. Names that all stand several times are those of several
specimens side by side, each with columns of its own.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property
from operator import itemgetter
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.base.toml import nearest
from cutbench.base.unit_spelling import COMMON, exactly, is_unit, size_of
from cutbench.run.measures import READ_OFF

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}[,.]\d{3}")
_COMMENT = re.compile(r"\s*(#(?!N/?[AV]\b|DIV|VAL)|//|%)\s*", re.IGNORECASE)
_WITH_UNIT = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_].*|%)")
#: What stands where nothing was measured.
_MISSING = re.compile(
    r"[-+]?nan(\(\w+\))?|[-+]?\d\.#\w+|#?n[/.]?[av]\.?|#(div/0|value)!|null|none|-+", re.IGNORECASE
)
_CLOCK = re.compile(
    r"(?:(\d[\d./-]*\d)(?:[T,]\s*|\s+))?(\d+):(\d\d)(?::(\d\d))?([.,:]\d+)?\s*([ap]\.?m\.?)?(?:Z|[+-]\d\d:\d\d)?",
    re.IGNORECASE,
)


def lines_of(path: Path) -> list[str]:
    """The lines of a text file, whatever its encoding and line ends. Raises BadInput."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        absent = isinstance(error, FileNotFoundError)
        expected = "a file that exists" if absent else f"a file that can be read ({error.strerror})"
        raise BadInput(key="data", value=str(path), expected=expected) from error
    try:
        text = raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    require("\0" not in text, "data", "a binary file", "a text file: export the readings as CSV", path)
    require(text.strip(), "data", "an empty file", "a header and readings", path)
    return re.split(r"\r\n|\n|\r", text)


def split_line(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    reader = csv.reader([line], delimiter=separator, skipinitialspace=True)
    return [cell.strip() for cell in next(reader, [])]


def is_empty(line: str) -> bool:
    return not line.strip() or bool(_COMMENT.match(line))


def uncommented(line: str) -> str:
    """``line`` without the sign of a comment before it."""
    return _COMMENT.sub("", line, count=1) if _COMMENT.match(line) else line


def is_value(cell: str) -> bool:
    """Whether a cell of a table holds a number, a clock time, or a word for what was not measured."""
    number = number_in(cell, False) is not None or number_in(cell, True) is not None
    return number or is_missing(cell) or is_clock(cell) or bool(unit_in(cell))


def is_clock(cell: str) -> bool:
    """Whether ``cell`` is a time as a clock shows it."""
    return ":" in cell and _CLOCK.fullmatch(cell.strip()) is not None


def is_missing(cell: str) -> bool:
    """Whether ``cell`` says that nothing was measured: -nan(ind), -1.#IND, #N/A, NaN, n/a and the like."""
    return _MISSING.fullmatch(cell.strip()) is not None


def unit_in(cell: str) -> str:
    """The unit behind the number in a cell that has both; '' for others."""
    match = None if number_in(cell, "," in cell) is not None else _WITH_UNIT.fullmatch(cell.strip())
    return match[2] if match and is_unit(match[2]) else ""


def number_in(cell: str, comma: bool) -> float | None:
    """The number in ``cell``, with a decimal comma or point; None if it is none."""
    text = cell.strip().replace("\u2212", "-")
    good = (_COMMA_NUMBER if comma else _NUMBER).fullmatch(text)
    return float(text.replace(",", ".")) if good else None


@dataclass(frozen=True)
class Cells:
    """The ``texts`` (n,) of a column below its ``title``, each in one of the ``lines`` (n,) of a file;
    ``unit`` is what stands in a row below the title or in each cell."""

    path: Path
    title: str
    texts: Sequence[str]
    lines: Sequence[int]
    unit: str | None = None

    def wrong(self, k: int, expected: str) -> BadInput:
        return BadInput(self.title, self.texts[k], expected, file=str(self.path), line=self.lines[k])

    def until(self, count: int) -> Cells:
        """The first so many."""
        return replace(self, texts=self.texts[:count], lines=self.lines[:count])

    def without_units(self) -> Cells:
        """The same without the unit that stands in each cell. Raises BadInput for another."""
        first = next(filter(unit_in, self.texts), None)
        if first is None:
            return self
        unit = unit_in(first)
        for k, text in enumerate(self.texts):
            if text and not is_missing(text) and not text.endswith(unit):
                raise self.wrong(k, f"the unit of the others in each cell, as in '{first}'")
        return replace(self, texts=[text.removesuffix(unit).strip() for text in self.texts], unit=unit)

    def numbers(self, comma: bool, blank: bool) -> np.ndarray:
        """As they stand; ``blank``: nan where nothing was measured. Raises BadInput."""
        read = [
            np.nan if blank and (not text or is_missing(text)) else number_in(text, comma)
            for text in self.texts
        ]
        if None in read:
            k = read.index(None)
            raise self.wrong(
                k, "a number in every reading" + "; the cell is empty" * (not self.texts[k].strip())
            )
        return np.array(read, dtype=float)

    def seconds(self, unit: str | None = None) -> np.ndarray:
        """Seconds (n,) of clock times. Raises BadInput.

        Times of day go on over midnight. Two parts are minutes and seconds where they have decimals, else
        what ``unit`` says of the first, min or h. Dates are ISO, or the same in all cells.
        """
        times, dates, day_s = np.zeros(len(self.texts)), set(), 86_400.0
        for k, text in enumerate(self.texts):
            if (match := _CLOCK.fullmatch(text.strip())) is None:
                raise self.wrong(k, "a time such as 12:03:04.5 in every reading")
            day, first, second, third, part, half = match.groups()
            if third is None and part is None and unit not in ("min", "h"):
                expected = "a time such as 12:03:04, or units.time = 'min' or 'h', what the first part counts"
                raise self.wrong(k, expected)
            hours = int(first) % 12 + 12 * (half[0] in "pP") if half else int(first)
            scale = 60 if third is None and unit in (None, "min") else 3600
            times[k] = scale * (hours + int(second) / 60) + int(third or 0) + float("0." + (part or ".0")[1:])
            if day:
                dates.add(day)
                try:
                    times[k] += day_s * (date.fromisoformat(day).toordinal() - date(2000, 1, 1).toordinal())
                except ValueError as error:
                    if len(dates) > 1:
                        raise self.wrong(k, "dates as in 2024-05-02, where they change") from error
        # A clock that falls by more than half a day has passed midnight.
        return times if dates else times + day_s * np.append(0.0, np.cumsum(np.diff(times) < -day_s / 2))


def decimal_comma(columns: Sequence[Cells]) -> bool:
    """Whether numbers are written 1,5. Both 1,5 and 1.5 in one file, and 1,234 beside 987, are refused."""
    every: list[tuple[int, str]] = []
    file, wanted = str(columns[0].path), "one decimal sign in all of the file, and no sign between thousands"
    for cells in columns:
        column = [cell for cell in zip(cells.lines, cells.texts, strict=True) if ":" not in cell[1]]
        signed = [(line, text) for line, text in column if "," in text or "." in text]
        # All have three digits behind the sign; all others are whole, below a thousand, and not only small.
        if signed and all(_THOUSANDS.fullmatch(text) for _, text in signed):
            whole = [len(text.lstrip("+-")) for _, text in column if text.lstrip("+-").isdigit()]
            require(max(whole, default=0) != 3, "number", signed[0][1], wanted, file, signed[0][0])
        every += signed
    comma, point = (min((cell for cell in every if sign in cell[1]), default=None) for sign in ",.")
    if comma and point:
        line, text = max(comma, point)
        raise BadInput("number", text, wanted, file=file, line=line)
    return comma is not None


def between_ticks(times: np.ndarray) -> np.ndarray:
    """Times (n,) of a clock that ticked more slowly than it was read, evenly from tick to tick; others as
    they are, also those of a clock that stood still: that showed one time three times as often as others."""
    starts = np.flatnonzero(np.diff(times, prepend=np.nan) != 0)
    ticks, counts = times[starts], np.diff(starts, append=times.size)
    *_, third, second, most = 1, 1, 1, *np.sort(counts)
    if third == 1 or most > 3 * second or np.diff(ticks).min() <= 0:
        return times
    # The first tick may have begun before the first reading, and the last one ends after the last.
    whole = counts.copy()
    whole[[0, -1]] = max(counts[0], counts[1]), max(counts[-1], counts[-2])
    behind = np.arange(times.size) - np.repeat(starts, counts)
    behind[: counts[0]] += whole[0] - counts[0]
    return np.repeat(ticks, counts) + np.diff(ticks).min() * behind / np.repeat(whole, counts)


# -- where columns stand -------------------------------------------------------------------------------
LABEL = "repetition"
#: One column: its name in the header, or its number from 1.
Column = str | int
#: The columns that are asked for, by role: one, or one for each specimen.
Asked = Mapping[str, Column | Sequence[Column]]
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

    def title(self, at: int) -> str:
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
        first = self.names[0].casefold()
        if self.header < 0 or not first or first not in line.casefold():
            return False
        both = split_line(uncommented(line), self.separator), self.names
        here, header = (";".join(cells).rstrip(";").casefold() for cells in both)
        return here == header

    def is_text(self, cells: Sequence[str], reading: Sequence[str] | None) -> bool:
        """Whether a line is no reading but words: none of its cells that are read is a number, or it begins
        with a word where a ``reading`` begins with a number."""
        first = next(cell for cell in cells if cell)
        ruled = not any(map(str.isalnum, "".join(cells)))
        if ruled or not (first[0].isalpha() or first[0] in "[(<*=\"'") or is_value(first):
            return ruled
        if not any(is_value(cells[at]) for at in self.read if at < len(cells) and cells[at]):
            return True
        return bool(cells[0]) and reading is not None and is_value(reading[0])


def find_layout(path: Path, lines: list[str], asked: Asked, wide: bool) -> Layout:
    """Where the columns that are ``asked`` for stand: by role a name or number, or a list of those, one for
    each specimen.

    ``wide``: names that all stand several times are those of several specimens. Raises BadInput.
    """
    each = [c for columns in asked.values() for c in _listed(columns)]
    first = -1
    if all(isinstance(c, int) for c in each):
        separator, first = _first_row(path, lines, asked, max(int(c) for c in each))
        header, names = _titles(lines, separator, first, asked)
    else:
        header, separator, names = _header(path, lines, asked)
    where = _where(path, header, names, asked, wide)
    body, below = units_row(lines, header, separator, where)
    several = len(next(iter(where.values()))) > 1
    specimens = _specimens(lines, header, separator, names, where) if several else ("",)
    return Layout(separator, header, names, body if header >= 0 else first, where, below, specimens)


def matching_titles(path: Path, columns: Mapping[str, Column], names: Sequence[str]) -> dict[str, str]:
    """The titles of those of ``names`` that stand in the header with ``columns``. Raises BadInput."""
    if all(isinstance(c, int) for c in columns.values()):
        return {}
    titles = _header(path, lines_of(path), columns)[2]
    return {name: titles[hits[0]] for name in names if (hits := _matches(name, titles))}


def _listed(columns: Column | Sequence[Column]) -> list[Column]:
    return [columns] if isinstance(columns, (str, int)) else list(columns)


def _first_row(path: Path, lines: list[str], asked: Asked, widest: int) -> tuple[str | None, int]:
    """Separator and line of the first row with numbers in the numbered columns."""
    where = [int(c) - 1 for role, columns in asked.items() if role != LABEL for c in _listed(columns)]
    full = [i for i, line in enumerate(lines) if not is_empty(line)]

    def is_row(i: int, separator: str | None) -> bool:
        cells = split_line(lines[i], separator)
        return len(cells) >= widest and all(is_value(cells[at]) for at in where)

    tried = full[: _HEAD + _TABLE]
    rows = [(separator, [is_row(i, separator) for i in tried]) for separator in _SEPARATORS]
    # A few rows of numbers among lines above the table are none of its rows.
    for least in (_TABLE, 2, 1):
        for end in range(least if least > 1 else max(len(full), 1), len(tried) + 1):
            for separator, good in rows:
                if all(good[end - least : end]):
                    return separator, full[end - least]
    expected = f"a file with {widest} columns, numbers in those that are read"
    raise BadInput("columns", f"column {widest}", expected, file=str(path))


def _titles(lines: list[str], separator: str | None, first: int, asked: Asked) -> tuple[int, list[str]]:
    """Header and titles above the first row, if there are any that are as wide."""
    width = len(split_line(lines[first], separator))
    where = {role: tuple(int(c) - 1 for c in _listed(columns)) for role, columns in asked.items()}
    above = [i for i in range(first - 1, max(first - 6, -1), -1) if not is_empty(lines[i])][:2]
    for i in above:
        cells = split_line(lines[i], separator)
        if len(cells) != width or any(is_value(cell) and not is_missing(cell) for cell in cells):
            break
        # Above a row of units stand the titles.
        if i == above[-1] or not units_row(lines, i - 1, separator, where)[1]:
            return i, cells
    return -1, [f"column {k + 1}" for k in range(width)]


def _header(path: Path, lines: list[str], asked: Asked) -> tuple[int, str | None, list[str]]:
    """The line, separator and titles with most of the names that are looked for, above a table if several
    have as many."""
    named = [(role, c) for role, columns in asked.items() for c in _listed(columns) if isinstance(c, str)]
    heads = [
        (i, separator, split_line(uncommented(line), separator))
        for separator in _SEPARATORS
        for i, line in enumerate(lines[:_HEAD])
    ]
    places = [[hits[0] for _, name in named if (hits := _matches(name, names))] for *_, names in heads]
    most = max(map(len, places))
    if most == 0:
        in_order = sorted((head for head in heads if head[1]), key=itemgetter(0))
        rows = ([cell for cell in names if cell] for *_, names in in_order)
        titles = next((row for row in rows if len(row) > 1), [lines[0].strip()])
        role, name = named[0]
        expected = f"a column of the file ({', '.join(titles[:12])})" + did_you_mean(name, titles)
        raise BadInput(f"columns.{role}", name, expected, file=str(path))
    best = [(at, head) for at, head in zip(places, heads, strict=True) if len(at) == most]
    headings = {head[0] for _, head in best}

    def above_a_table(candidate: tuple) -> bool:
        at, (i, separator, _) = candidate
        end = min((k for k in headings if k > i), default=i + 4 * _TABLE)
        rows = [split_line(line, separator) for line in lines[i + 1 : end] if not is_empty(line)]
        return sum(len(r) > max(at) and all(is_value(r[k]) for k in at) for r in rows) >= _TABLE

    return (best[0] if len(best) == 1 else next(filter(above_a_table, best), best[0]))[1]


def _where(
    path: Path, header: int, names: Sequence[str], asked: Asked, wide: bool
) -> dict[str, tuple[int, ...]]:
    """The columns of each role, one for each specimen; beside lists of columns a single one is shared."""
    where: dict[str, list[int]] = {}
    place = (path, header + 1 if header >= 0 else None)
    for role, columns in asked.items():
        key, where[role] = f"columns.{role}", []
        for column in _listed(columns):
            hits, title = _hits(column, role, names), str(column)
            seen = [name for name in names if name]
            expected = f"one of the columns {', '.join(seen[:12])}{did_you_mean(title, seen)}"
            require(hits, key, title, expected, *place)
            taken = next((r for r, other in where.items() if set(hits) & set(other)), None)
            require(not taken, key, title, f"a column of its own; '{column}' is read as {taken}", *place)
            alone = len(hits) == 1 or (wide and isinstance(columns, (str, int)) and role != LABEL)
            require(alone, key, title, f"a column that stands once; it stands {_times(len(hits))}", *place)
            where[role] += hits
    count = max(map(len, where.values()))
    many = next(role for role, at in where.items() if len(at) == count)
    for role, at in where.items():
        if len(at) == 1 < count and not isinstance(asked[many], (str, int)) and role != LABEL:
            where[role] = at * count
        elif len(at) != count:
            lists = "force = [1, 4] and displacement = [2, 5]"
            cure = f"Give its number, or those of all specimens, such as {lists}"
            if len({parted(names[k])[1] for k in where[many]}) == count:
                cure = f"Of several units name one: '{names[where[many][0]]}'"
            stands = f"it stands {_times(count)}, {asked[role]} {_times(len(at))}. {cure}"
            expected = f"a column that stands once; {stands}"
            raise BadInput(f"columns.{many}", str(asked[many]), expected, file=str(path), line=place[1])
    return {role: tuple(at) for role, at in where.items()}


def _hits(column: Column, role: str, names: Sequence[str]) -> list[int]:
    """The columns that may be meant; of a strain in % and one in mm the first is a strain."""
    if isinstance(column, int):
        return [column - 1]
    hits = _matches(column, names)
    fits = [at for at in hits if parted(names[at], UNITS.get(role))[1] is not None]
    fits = [at for at in fits if size_of(parted(names[at])[1] or "", UNITS.get(role, "1")) is not None]
    return fits if len(fits) == 1 else hits


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _specimens(
    lines: list[str], header: int, separator: str | None, names: Sequence[str], where: Mapping
) -> tuple[str, ...]:
    """What specimens side by side are called: by the row above the header, their titles, else numbers."""
    own = [at for at in where.values() if len(set(at)) == len(at)]
    count = len(own[0])
    starts = [min(at[k] for at in own) for k in range(count)]
    titles = [[parted(names[i])[0] if i < len(names) else "" for i in at] for at in own]
    if header > 0 and starts == sorted(starts):
        cells = split_line(lines[header - 1], separator)
        parts = [cells[a:b] for a, b in zip(starts, [*starts[1:], len(cells)], strict=True)]
        titles = [[next(filter(None, part), "") for part in parts], *titles]
    distinct = (each for each in titles if all(each) and len(set(each)) == count)
    return tuple(next(distinct, map(str, range(1, count + 1))))


def did_you_mean(name: str, names: Sequence[str], likeness: float = 0.5) -> str:
    """What a message adds where one of the ``names`` is near."""
    guess = nearest(name, names, likeness)
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
    hits = ([i for i, n in enumerate(names) if test(n)] for test in tests)
    return next(filter(None, hits), [])


def units_row(
    lines: list[str], header: int, separator: str | None, where: Mapping[str, tuple[int, ...]]
) -> tuple[int, dict[int, str]]:
    """Where the readings begin, and by column the units in a row of their own below the header."""
    body = header + 1
    line = next((i for i in range(body, min(body + 3, len(lines))) if lines[i].strip()), None)
    if header < 0 or line is None:
        return body, {}
    cells = split_line(lines[line], separator)
    read = [(role, at) for role, columns in where.items() for at in columns]
    if any(at >= len(cells) or (is_value(cells[at]) and not is_missing(cells[at])) for _, at in read):
        return body, {}
    texts = {at: (cells[at].strip("[](){}<> "), role) for role, at in read if role != LABEL}
    units = {at: text for at, (text, _) in texts.items() if text and not _UNIT_OF_CLOCKS.fullmatch(text)}
    fits = any(size_of(unit, UNITS.get(texts[at][1], "1")) is not None for at, unit in units.items())
    return (line + 1, units) if fits else (body, {})


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
