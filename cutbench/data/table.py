"""Measured readings from text files as machines and spreadsheets write them; the files are only read.

Understood without being told: separators ; tab , | and blanks; decimal commas; any lines above the
header; comments; units in column names ("F [N]", "Force (mN)", "F / N", "force_N") or in a row below;
specimens side by side; quotes; UTF-8 with or without BOM, UTF-16, Latin-1; any line ends. Whatever would
have to be guessed is refused with file, line, column and value.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.data.layout import (
    LABEL,
    Column,
    Layout,
    find_layout,
    is_empty,
    lines_of,
    number_in,
    split,
    wrong,
)
from cutbench.data.titles import UNITS, parted, size_of

#: Separators that no number has in it, so that cells beyond the header harm nothing.
_SAFE = (";", "\t", "|")


@dataclass(frozen=True)
class Table:
    """Columns by role, (n,) in mm, N, s, MPa; ``labels`` (n,) of the repetitions; ``lines`` (n,);
    ``specimens`` that stand side by side, by name."""

    path: Path
    columns: Mapping[str, np.ndarray]
    labels: tuple[str, ...] | None
    lines: np.ndarray
    specimens: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Rows:
    """Readings that a file holds: cells, and the number of the line of each row."""

    cells: list[list[str]]
    lines: list[int]


def read_table(
    path: str | Path,
    columns: Mapping[str, Column | Sequence[Column]],
    units: Mapping[str, str] | None = None,
    blanks: Sequence[str] = (),
    *,
    wide: bool = False,
) -> Table:
    """Read the ``columns`` (role -> name in the header, or number from 1) of a text file.

    ``units`` (role -> unit) where the header does not say. In the roles ``blanks`` an empty cell or nan
    means not measured, and is nan. ``wide``: specimens may stand side by side, each with its columns, under
    names that all stand several times or in lists of columns; their readings come one after another, labelled
    by specimen. Raises BadInput for a file that cannot be read, a column that is missing or stands twice, a
    unit that is missing, wrong or contradicted by the header, and cells that are no numbers.
    """
    path, units = Path(path), dict(units or {})
    lines = lines_of(path)
    layout = find_layout(path, lines, columns, wide)
    rows = _rows(path, lines, layout)
    comma = _decimal_comma(path, layout, rows)
    read = [role for role in columns if role != LABEL]
    found: dict[str, list[float]] = {role: [] for role in read}
    labels: list[str] = []
    numbers: list[int] = []
    for k, specimen in enumerate(layout.specimens):
        part = _of_specimen(layout, rows, k)
        for role in read:
            factor = _factor(path, layout, role, k, units.get(role))
            for row, line in zip(part.cells, part.lines, strict=True):
                text = row[layout.where[role][k]]
                blank = role in blanks and text.strip().lower() in ("", "nan")
                value = np.nan if blank else _number(path, layout.title(role, k), text, line, comma)
                found[role].append(factor * value)
        numbers += part.lines
        labels += [specimen] * len(part.lines)
    if LABEL in columns:
        labels = [row[layout.where[LABEL][0]].strip() for row in rows.cells]
        for label, line in zip(labels, numbers, strict=True):
            if not label:
                wanted = "the name of a repetition in every reading"
                raise wrong(path, line, layout.title(LABEL), "", wanted)
    beside = layout.specimens if len(layout.specimens) > 1 else ()
    values = {role: np.array(read) for role, read in found.items()}
    named = tuple(labels) if beside or LABEL in columns else None
    return Table(path, values, named, np.array(numbers, dtype=int), beside)


def _factor(path: Path, layout: Layout, role: str, specimen: int, given: str | None) -> float:
    """From the file's unit of ``role`` to the internal one."""
    target, title = UNITS[role], layout.title(role, specimen)
    line = layout.header + 1 if layout.header >= 0 else None
    written = layout.below.get(layout.where[role][specimen]) or parted(title, target)[1]
    wanted = "a number without unit, written '1'" if target == "1" else f"a unit such as '{target}'"
    if given is not None:
        factor = size_of(given, target)
        if factor is None:
            raise BadInput(key=f"units.{role}", value=given, expected=wanted)
        if written is not None and size_of(written, target) != factor:
            raise wrong(path, line, title, written, f"the unit that units.{role} gives, '{given}'")
        return factor
    if written is None:
        if target == "1":
            return 1.0
        wanted = f"units = {{ {role} = '{target}' }} in the campaign, or a title '{title} [{target}]'"
        raise wrong(path, line, title, "no unit", wanted)
    factor = size_of(written, target)
    if factor is None:
        raise wrong(path, line, title, written, f"{wanted} for {role}")
    return factor


def _rows(path: Path, lines: list[str], layout: Layout) -> _Rows:
    found = _Rows([], [])
    need, width = max(max(at) for at in layout.where.values()) + 1, len(layout.names)
    for number, line in enumerate(lines[layout.body :], start=layout.body + 1):
        if is_empty(line):
            continue
        try:
            cells = split(line, layout.separator)
        except csv.Error as error:
            raise wrong(path, number, "row", line[:40], f"a row of cells ({error})") from error
        if not any(cells):
            continue
        if len(layout.specimens) > 1 and layout.separator is not None:
            cells += [""] * (need - len(cells))  # of specimens that have ended
        if len(cells) < need or (any(cells[max(width, need) :]) and layout.separator not in _SAFE):
            wanted = f"{width} cells as in the header, not {len(cells)}"
            if layout.separator == "," and len(cells) > width:
                wanted += "; decimal commas need another separator, such as a semicolon"
            raise wrong(path, number, "row", line.strip()[:60], wanted)
        found.cells.append(cells)
        found.lines.append(number)
    if not found.cells:
        raise wrong(path, layout.body, "data", "no reading below the header", "readings")
    return found


def _of_specimen(layout: Layout, rows: _Rows, specimen: int) -> _Rows:
    """The rows up to the last in which this specimen has a reading."""
    if len(layout.specimens) == 1:
        return rows
    own = layout.own(specimen)
    last = max((i for i, row in enumerate(rows.cells) if any(row[at] for at in own)), default=-1)
    return _Rows(rows.cells[: last + 1], rows.lines[: last + 1])


def _decimal_comma(path: Path, layout: Layout, rows: _Rows) -> bool:
    """Whether numbers are written 1,5. Both 1,5 and 1.5 in one file are refused."""
    seen: dict[str, tuple[str, int]] = {}
    read = [at for role, columns in layout.where.items() if role != LABEL for at in columns]
    for row, line in zip(rows.cells, rows.lines, strict=True):
        for at in read:
            for sign in ",.":
                if sign in row[at]:
                    seen.setdefault(sign, (row[at], line))
        if len(seen) == 2:
            text, last = max(seen.values(), key=lambda item: item[1])
            wanted = "one decimal sign in all of the file, and no sign between thousands"
            raise wrong(path, last, "number", text, wanted)
    return "," in seen


def _number(path: Path, title: str, cell: str, line: int, comma: bool) -> float:
    value = number_in(cell, comma)
    if value is None:
        wanted = "a number in every reading" + ("" if cell.strip() else "; the cell is empty")
        raise wrong(path, line, title, cell, wanted)
    return value
