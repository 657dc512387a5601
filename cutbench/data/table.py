"""Measured readings from text files as machines and spreadsheets write them; the files are only read.

Understood by itself: separators ; tab , | and blanks; decimal commas; any lines above the header; comments;
units in column names ("F [N]", "Force (mN)", "F / N", "force_N") or in a row below; clock times; specimens
side by side; blocks below each other under repeated headings; lines of words behind the readings; quotes;
UTF-8 with or without BOM, UTF-16, Latin-1; any line ends. Whatever would have to be guessed is refused with
file, line, column and value.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.unit_spelling import meant_unit, size_of
from cutbench.data.layout import LABEL, UNITS, Column, Layout, bracketed, find_layout, parted, units_row
from cutbench.data.repetition import Channel
from cutbench.data.text_cells import (
    between_ticks,
    error_at_line,
    is_clock,
    is_empty,
    is_missing,
    lines_of,
    number_in,
    seconds,
    split_line,
    with_unit,
)


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
    read = {role: np.array(values) for role, values in found.items()}
    if "time" in read:
        parts = np.split(read["time"], np.flatnonzero(np.diff(read["time"]) < 0) + 1)
        times = np.concatenate([between_ticks(part) for part in parts])
        if not np.array_equal(times, read["time"]):
            notes.append(f"{path.name}: readings that share a coarse clock's time are even between its ticks")
        read["time"] = times
    return Table(
        path,
        read,
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


# -- rows, and what stands between and behind them ----------------------------------------------------
#: Separators that no number has in it, so that cells beyond the header harm nothing.
_SAFE = (";", "\t", "|")
#: Words by which a line begins a cycle of one specimen, or another specimen.
CYCLES = re.compile(
    r"\W*(cycle|zyklus|loop|segment|step|stage|ramp|hold|load|unload|phase|part)", re.IGNORECASE
)
SPECIMENS = re.compile(r"\W*(specimen|sample|test|probe|run|repetition|replicate|curve|trial)", re.IGNORECASE)
#: What can be done about lines that are no readings.
_SKIP = "; lines that are no readings are passed over by how they begin, as in skip = ['Mean']"
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}[,.]\d{3}")
#: Lines that are shown of those that are passed over.
_MAX_LINES_SHOWN = 3


class Row(NamedTuple):
    """The cells of a line, its number from 1, and the block that it is in."""

    cells: list[str]
    line: int
    block: int = 0


def rows_of(
    path: Path, lines: list[str], layout: Layout, skip: Sequence[str]
) -> tuple[list[Row], list[str], list[str]]:
    """The readings, what stands above each block of them, and a note on lines that were passed over.

    Lines of words stand above a block, whose heading is repeated or which they name, or behind all readings;
    those that begin with one of ``skip`` anywhere. Raises BadInput for others.
    """
    above = next((line for line in reversed(lines[: max(layout.header, 0)]) if line.strip()), "")
    rows: list[Row] = []
    titles, words, passed = [_title(layout, above)], list[Row](), list[int]()
    heading, number = False, layout.body
    while number < len(lines):
        line, number = lines[number], number + 1
        heads = layout.repeats(line)
        if heads:
            body, below = units_row(lines, number - 1, layout.separator, layout.where)
            if below != layout.below:
                wanted = "the units of the first heading in all of the file"
                raise error_at_line(path, number + 1, "row", lines[number][:60], wanted)
            number = body
        else:
            row = Row([] if is_empty(line) else _cells(path, layout, line, number), number)
            if not any(row.cells):
                continue
            if skip and line.strip().startswith(tuple(skip)):
                passed.append(number)
                continue
            short = bool(words) and len(row.cells) < layout.needed
            if short or layout.is_text(row.cells, rows[0].cells if rows else None):
                words.append(row)
                continue
            last = " ".join(filter(None, words[-1].cells)) if words else ""
            if words and not heading and not (CYCLES.match(last) or SPECIMENS.match(last)):
                raise _no_reading(path, layout, lines, words[0])
        if heads or (words and not heading):
            title = _title(layout, lines[words[-1].line - 1]) if words else ""
            if rows and rows[-1].block == len(titles) - 1:
                titles.append(title)
            else:
                titles[-1] = title or titles[-1]
            passed += [word.line for word in words[:-1]]
            words.clear()
        heading = heads
        if not heads:
            if fault := _width(layout, row.cells):
                raise error_at_line(path, row.line, "row", line.strip()[:60], fault)
            rows.append(Row(row.cells, number, len(titles) - 1))
    if not rows and words:
        raise _no_reading(path, layout, lines, words[0])
    if not rows:
        raise error_at_line(path, layout.body, "data", "no reading below the header", "readings")
    titles = titles[: rows[-1].block + 1]
    passed = sorted(passed + [word.line for word in words])
    if not passed:
        return rows, titles, []
    shown = ", ".join(f"line {at} '{lines[at - 1].strip()[:40]}'" for at in passed[:_MAX_LINES_SHOWN])
    more = f" and {len(passed) - _MAX_LINES_SHOWN} more" if len(passed) > _MAX_LINES_SHOWN else ""
    return rows, titles, [f"{path.name}: no readings, and passed over: {shown}{more}"]


def _title(layout: Layout, line: str) -> str:
    """What a line of words above a block says, without signs around it."""
    words = split_line(line, layout.separator) if layout.separator else [line]
    return " ".join(word for word in words if word).strip(" \t#%/[]()<>:*=-")


def _cells(path: Path, layout: Layout, line: str, number: int) -> list[str]:
    try:
        cells = split_line(line, layout.separator)
    except csv.Error as error:
        raise error_at_line(path, number, "row", line[:40], f"a row of cells ({error})") from error
    if len(layout.specimens) > 1 and layout.separator is not None and any(cells):
        cells += [""] * (layout.needed - len(cells))  # of specimens that have ended
    return cells


def _width(layout: Layout, cells: list[str]) -> str:
    """What is wrong with the number of cells in a row."""
    need, width = layout.needed, len(layout.names)
    if len(cells) >= need and not (any(cells[max(width, need) :]) and layout.separator not in _SAFE):
        return ""
    wanted = f"{width} cells as in the header, not {len(cells)}"
    comma = layout.separator == "," and len(cells) > width
    return wanted + ("; decimal commas need another separator, such as a semicolon" if comma else _SKIP)


def _no_reading(path: Path, layout: Layout, lines: list[str], row: Row) -> BadInput:
    if fault := _width(layout, row.cells):
        return error_at_line(path, row.line, "row", lines[row.line - 1].strip()[:60], fault)
    role = next(role for role in layout.where if role != LABEL)
    cell = row.cells[layout.where[role][0]]
    return error_at_line(path, row.line, layout.title(role), cell, "a number in every reading" + _SKIP)


def decimal_comma(path: Path, layout: Layout, rows: list[Row]) -> bool:
    """Whether numbers are written 1,5. Both 1,5 and 1.5 in one file, and 1,234 beside 987, are refused."""
    first: dict[str, tuple[int, str]] = {}
    wanted = "one decimal sign in all of the file, and no sign between thousands"
    for at in layout.read:
        column = [(row.line, row.cells[at]) for row in rows if ":" not in row.cells[at]]
        signed = [(line, text) for line, text in column if "," in text or "." in text]
        for sign in ",.":
            here = next(((line, text) for line, text in signed if sign in text), None)
            first |= {sign: min(first.get(sign, here), here)} if here else {}
        # All have three digits behind the sign; all others are whole, below a thousand, and not only small.
        if signed and all(_THOUSANDS.fullmatch(text) for _, text in signed):
            whole = [len(text.lstrip("+-")) for _, text in column if text.lstrip("+-").isdigit()]
            if max(whole, default=0) == 3:
                raise error_at_line(path, signed[0][0], "number", signed[0][1], wanted)
    if len(first) == 2:
        line, text = max(first.values())
        raise error_at_line(path, line, "number", text, wanted)
    return "," in first


# -- parts of one test, and times that go on ----------------------------------------------------------
CYCLE, SPECIMEN = "cycles", "specimens"
#: What blocks below each other may be.
BLOCKS = (CYCLE, SPECIMEN)
#: A part that begins within so many steps of where the one before began has a clock of its own.
_RESTART_STEPS = 2.0
#: Travel between files that follow one another, as a part of the way, which is spoken of.
_NOTED_GAP = 0.05


def with_blocks_read(table: Table, blocks: str | None = None) -> Table:
    """A file with blocks below each other as cycles of one specimen or as specimens: as ``blocks`` says, else
    what stands above them, else the time, which goes on over cycles and begins anew with each specimen.

    A note says what was taken. Raises BadInput where nothing decides.
    """
    count = len(table.titles)
    if count == 1:
        return table
    how, why = (blocks, "as blocks says") if blocks else _kind(table)
    note = f"{table.path.name} holds {count} blocks below each other, read as {how}, {why}"
    distinct = all(table.titles) and len(set(table.titles)) == count
    if how == CYCLE:
        names = table.titles if distinct else tuple(f"block {k + 1}" for k in range(count))
        return _continued(replace(table, titles=names, notes=(*table.notes, note)))
    names = table.titles if distinct else tuple(str(k + 1) for k in range(count))
    own = [names[block] for block in table.blocks]
    if table.labels is not None:
        own = [f"{a}/{b}" for a, b in zip(table.labels, own, strict=True)]
    note += f": {', '.join(dict.fromkeys(own))}"
    return replace(table, labels=tuple(own), titles=("",), notes=(*table.notes, note))


def joined_files(tables: Sequence[Table]) -> Table:
    """Files that follow one another as one. Raises BadInput if only one has labels, or a clock."""
    first = tables[0]
    for other in tables[1:]:
        if (other.labels is None, other.clock) != (first.labels is None, first.clock):
            expected = f"specimens and times as in {first.path.name}, which it follows"
            raise BadInput(key="data", value=other.path.name, expected=expected)
    if len(tables) == 1:
        return first
    whole = replace(
        first,
        columns={role: np.concatenate([t.columns[role] for t in tables]) for role in first.columns},
        labels=None if first.labels is None else sum((t.labels or () for t in tables), ()),
        lines=np.concatenate([t.lines for t in tables]),
        files=sum((t.files for t in tables), ()),
        blocks=np.repeat(np.arange(len(tables)), [t.lines.size for t in tables]),
        titles=tuple(t.path.name for t in tables),
        notes=sum((t.notes for t in tables), ()),
    )
    apart = []
    for a, b in pairwise(tables):
        if "displacement" in first.columns:
            x, begins = a.columns["displacement"], b.columns["displacement"][0]
            if abs(begins - x[-1]) > _NOTED_GAP * np.ptp(x):
                gap = f"{abs(begins - x[-1]):.4g} mm"
                apart.append(f"{b.path.name} begins {gap} from where {a.path.name} ends")
    return _continued(replace(whole, notes=(*whole.notes, *apart)))


def _kind(table: Table) -> tuple[str, str]:
    """What the blocks are, and why."""
    if table.labels is not None and not table.specimens:
        return CYCLE, "as a column names the specimens"
    for how, words in ((CYCLE, CYCLES), (SPECIMEN, SPECIMENS)):
        named = list(dict.fromkeys(title for title in table.titles if words.match(title)))
        if len(named) >= len(table.titles) - 1:
            return how, f"as '{named[-1]}' says"
    second = np.searchsorted(table.blocks, 1)
    if "time" in table.columns and not table.specimens:
        parts = [table.columns["time"][table.blocks == k] for k in range(len(table.titles))]
        if all(b[0] >= a[-1] for a, b in pairwise(parts)):
            return CYCLE, "as their time goes on"
        if all(b[0] < (a[0] + a[-1]) / 2 for a, b in pairwise(parts)):
            return SPECIMEN, "as their time begins anew"
    raise BadInput(
        file=str(table.path), line=int(table.lines[second]), key="blocks", value="a heading once more",
        expected="blocks = 'cycles' in the campaign, for parts of one specimen, or blocks = 'specimens'",
    )  # fmt: skip


def _continued(table: Table) -> Table:
    """The parts of each specimen as one, with times that go on, and notes on how they do.

    A part whose time begins where that of the one before began has a clock of its own, and follows at its own
    step; one that begins before the end of that is recorded twice up to there, and the later record counts.
    """
    labels = np.array(table.labels if table.labels is not None else [""] * table.lines.size)
    each = [np.flatnonzero(labels == label) for label in dict.fromkeys(labels)]
    columns, keep = dict(table.columns), np.ones(labels.size, dtype=bool)
    notes: dict[str, str] = {}
    if "time" in columns:
        recorded, columns["time"] = columns["time"], columns["time"].copy()
        for mine in each:
            parts = [mine[table.blocks[mine] == k] for k in range(len(table.titles))]
            shift = 0.0
            for before, part in pairwise([part for part in parts if part.size]):
                begins, began, ended = recorded[part[0]], recorded[before[0]], recorded[before[-1]]
                step = float(np.median(np.diff(recorded[part]))) if part.size > 1 else 1.0
                if begins > ended:
                    how = "goes on by the clock of"
                elif begins < began + _RESTART_STEPS * step:
                    shift += float(ended + step - begins)
                    how = f"has a clock of its own, and follows {step:.4g} s after"
                else:
                    again = before[recorded[before] >= begins]
                    keep[again] = False
                    how = f"begins before the end; left out are {again.size} of the last readings of"
                columns["time"][part] += shift
                names = [table.titles[table.blocks[rows[0]]] for rows in (part, before)]
                notes.setdefault(how, f"{names[0]} {how} {names[1]}")
    rows = np.concatenate(each)
    rows = rows[keep[rows]]
    return replace(
        table,
        columns={role: values[rows] for role, values in columns.items()},
        labels=None if table.labels is None else tuple(labels[rows].tolist()),
        lines=table.lines[rows],
        files=tuple(table.files[k] for k in rows),
        blocks=table.blocks[rows],
        titles=("",),
        notes=(*table.notes, *notes.values()),
    )
