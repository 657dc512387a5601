"""Measured readings from text files as machines and spreadsheets write them; the files are only read.

Understood by itself: separators ; tab , | and blanks; decimal commas; any lines above the header; comments;
units in column names ("F [N]", "Force (mN)", "F / N", "force_N") or in a row below; clock times; specimens
side by side; blocks below each other under repeated headings; lines of words behind the readings; quotes;
UTF-8 with or without BOM, UTF-16, Latin-1; any line ends. Whatever would have to be guessed is refused with
file, line, column and value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.unit_spelling import meant_unit, size_of
from cutbench.data.clock_times import is_clock, seconds
from cutbench.data.column_titles import UNITS, bracketed, parted
from cutbench.data.layout import LABEL, Column, Layout, find_layout
from cutbench.data.repetition import Channel
from cutbench.data.rows import Row, decimal_comma, rows_of
from cutbench.data.text_cells import error_at_line, is_missing, lines_of, number_in, with_unit


@dataclass(frozen=True)
class Table:
    """Columns by role, (n,) in mm, N, s, MPa; ``labels`` (n,) of the repetitions; ``lines`` (n,) and
    ``files`` (n,), where each reading stands; ``specimens`` that stand side by side, by name.

    ``blocks`` (n,) count parts below each other, and ``titles`` are what stands above each. ``notes`` say
    what was passed over or overruled; ``clock``: the times are those of a clock.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    labels: tuple[str, ...] | None
    lines: np.ndarray
    files: tuple[str, ...]
    specimens: tuple[str, ...] = ()
    blocks: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    titles: tuple[str, ...] = ("",)
    notes: tuple[str, ...] = ()
    clock: bool = False
    channels: Mapping[str, Channel] = field(default_factory=dict)


def read_table(
    path: str | Path,
    columns: Mapping[str, Column | Sequence[Column]],
    units: Mapping[str, str] | None = None,
    blanks: Sequence[str] = (),
    *,
    wide: bool = False,
    skip: Sequence[str] = (),
) -> Table:
    """Read the ``columns`` (role -> name in the header, or number from 1) of a text file.

    ``units`` (role -> unit) where the header does not say, or is wrong. In the roles ``blanks`` an empty
    cell, nan, #N/A and the like mean not measured, and are nan. ``wide``: specimens may stand side by side,
    each with its columns, under names that all stand several times or in lists of columns; their readings
    come one after another, labelled by specimen. Lines that begin with one of ``skip`` are passed over.

    Raises BadInput for a file that cannot be read, a column that is missing or stands twice, a unit that is
    missing or wrong, and cells that are no numbers.
    """
    path, units = Path(path), dict(units or {})
    lines = lines_of(path)
    layout = find_layout(path, lines, columns, wide)
    rows, titles, notes = rows_of(path, lines, layout, skip)
    layout = replace(layout, below={**layout.below, **_units_of_cells(path, layout, rows)})
    comma = decimal_comma(path, layout, rows)
    found: dict[str, list[float]] = {role: [] for role in columns if role != LABEL}
    labels: list[str] = []
    ordered: list[Row] = []
    clock, channels = False, dict[str, Channel]()
    for k, specimen in enumerate(layout.specimens):
        part = _of_specimen(layout, rows, k)
        for role in found:
            title, cells = layout.title(role, k), [row.cells[layout.where[role][k]] for row in part]
            if role == "time" and cells and is_clock(cells[0]):
                times, at, wanted = seconds(cells, units.get(role))
                if at is not None:
                    raise error_at_line(path, part[at].line, title, cells[at], wanted)
                clock, found[role] = True, [*found[role], *times]
                continue
            factor, unit, note = _factor(path, layout, role, k, units.get(role))
            channels.setdefault(role, Channel(title, unit))
            notes += [note] if note and note not in notes else []
            for text, row in zip(cells, part, strict=True):
                blank = role in blanks and (not text or is_missing(text))
                found[role].append(
                    factor * (np.nan if blank else _number(path, title, text, row.line, comma))
                )
        ordered += part
        labels += [specimen] * len(part)
    if LABEL in columns:
        labels = [row.cells[layout.where[LABEL][0]] for row in rows]
        if "" in labels:
            wanted = "the name of a repetition in every reading"
            raise error_at_line(path, rows[labels.index("")].line, layout.title(LABEL), "", wanted)
    beside = layout.specimens if len(layout.specimens) > 1 else ()
    return Table(
        path,
        {role: np.array(read) for role, read in found.items()},
        tuple(labels) if beside or LABEL in columns else None,
        np.array([row.line for row in ordered], dtype=int),
        (str(path),) * len(ordered),
        beside,
        np.array([row.block for row in ordered], dtype=int),
        tuple(titles),
        tuple(notes),
        clock,
        channels,
    )


def _units_of_cells(path: Path, layout: Layout, rows: list[Row]) -> dict[int, str]:
    """By column the unit that stands in each of its cells, and is taken off. Raises BadInput for another."""
    units = {}
    for at in layout.read:
        first = next((cell for row in rows if with_unit(cell := row.cells[at])), None)
        if first is None:
            continue
        _, unit = with_unit(first) or ("", "")
        for row in rows:
            cell = row.cells[at]
            if cell and not is_missing(cell) and not cell.endswith(unit):
                expected = f"the unit of the others in each cell, as in '{first}'"
                raise error_at_line(path, row.line, layout.title_of(at), cell, expected)
            row.cells[at] = cell.removesuffix(unit).strip()
        units[at] = unit
    return units


def _of_specimen(layout: Layout, rows: list[Row], specimen: int) -> list[Row]:
    """The rows up to the last in which this specimen has a reading."""
    if len(layout.specimens) == 1:
        return rows
    own = layout.own(specimen)
    last = max((i for i, row in enumerate(rows) if any(row.cells[at] for at in own)), default=-1)
    return rows[: last + 1]


def _factor(
    path: Path, layout: Layout, role: str, specimen: int, given: str | None
) -> tuple[float, str | None, str | None]:
    """From the file's unit of ``role`` to the internal one, the unit that is written, and what to know of it:
    units of the campaign overrule the file's."""
    target, title = UNITS[role], layout.title(role, specimen)
    if not target:
        return 1.0, None, None
    written = layout.below.get(layout.where[role][specimen]) or parted(title, target)[1]
    factor = size_of(written or "", target)
    if given is not None:
        if (own := size_of(given, target)) is None:
            raise BadInput(key=f"units.{role}", value=given, expected=meant_unit(given, target))
        overruled = f"{path.name}: {title} is read in '{given}', as units.{role} says, not in '{written}'"
        return own, given, overruled if written is not None and factor != own else None
    if factor is not None:
        return factor, written, None
    other = written or bracketed(title)
    if target == "1" and other is None:
        return 1.0, None, None
    instead = f"units = {{ {role} = '{target}' }} in the campaign says it where the file does not, or wrongly"
    line = layout.header + 1 if layout.header >= 0 else None
    raise error_at_line(
        path, line, title, other or "no unit", f"{meant_unit(other or '', target)}; {instead}"
    )


def _number(path: Path, title: str, cell: str, line: int, comma: bool) -> float:
    value = number_in(cell, comma)
    if value is None:
        wanted = "a number in every reading" + ("" if cell.strip() else "; the cell is empty")
        raise error_at_line(path, line, title, cell, wanted)
    return value
