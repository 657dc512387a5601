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

from cutbench.base.errors import BadInput, require
from cutbench.base.unit_spelling import meant_unit, size_of
from cutbench.data.columns import (
    LABEL,
    UNITS,
    Asked,
    Cells,
    Layout,
    between_ticks,
    bracketed,
    decimal_comma,
    find_layout,
    is_clock,
    is_empty,
    lines_of,
    parted,
    split_line,
    units_row,
)
from cutbench.data.repetition import Channel


@dataclass(frozen=True)
class Table:
    """Columns by role, (n,) in mm, N, s, MPa; of each reading the label of its repetition ('' where there is
    one), the file and the line where it stands, and which of the parts below each other it is in.

    ``specimens`` stand side by side, by name, and ``titles`` above each part. ``notes`` say what was passed
    over or overruled; ``clock``: the times are those of a clock.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    labels: np.ndarray
    lines: np.ndarray
    files: np.ndarray
    blocks: np.ndarray
    titles: tuple[str, ...]
    specimens: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    clock: bool = False
    channels: Mapping[str, Channel] = field(default_factory=dict)

    @property
    def labelled(self) -> bool:
        """Whether it holds several repetitions by name."""
        return bool(self.labels.size and self.labels[0])

    @property
    def names(self) -> list[str]:
        """The labels, each once."""
        return list(dict.fromkeys(self.labels))

    def called(self, file: str) -> Table:
        """Its repetitions by the name of their ``file``, where that is told, and by their own."""
        names = ["/".join(filter(None, (file, own))) or "1" for own in self.labels]
        return replace(self, labels=np.array(names, dtype=object))

    def having(self, **columns: np.ndarray) -> Table:
        """With these columns beside its own, or in their place."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, which: np.ndarray) -> Table:
        """Of ``which`` readings alone, a mask or indices (k,)."""
        return replace(
            self,
            columns={role: values[which] for role, values in self.columns.items()},
            labels=self.labels[which],
            lines=self.lines[which],
            files=self.files[which],
            blocks=self.blocks[which],
        )


def read_table(
    path: str | Path,
    columns: Asked,
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
    several = len(layout.specimens) > 1
    if several:
        notes.insert(0, f"{path.name} holds specimens side by side: {', '.join(layout.specimens)}")
    numbers, blocks = ([getattr(row, name) for row in rows] for name in ("line", "block"))

    def cells_of(at: int) -> Cells:
        return Cells(path, layout.title(at), [row.cells[at] for row in rows], numbers, layout.below.get(at))

    cells = {at: cells_of(at).without_units() for at in layout.read}
    comma = decimal_comma([cells[at] for at in layout.read])
    heading = layout.header + 1 if layout.header >= 0 else None
    values: dict[str, list[np.ndarray]] = {role: [] for role in columns if role != LABEL}
    counts, clock, channels = [], False, dict[str, Channel]()
    for k in range(len(layout.specimens)):
        counts.append(_length([cells[at] for at in layout.own(k)]) if several else len(rows))
        for role, read in values.items():
            own = cells[layout.where[role][k]].until(counts[-1])
            if role == "time" and own.texts and is_clock(own.texts[0]):
                clock = True
                read.append(own.seconds(units.get(role)))
                continue
            factor, unit, note = _unit_of(own, role, units.get(role), heading)
            channels.setdefault(role, Channel(own.title, unit))
            notes += [note] if note and note not in notes else []
            read.append(factor * own.numbers(comma, role in blanks))
    labels = np.repeat(np.array(layout.specimens, dtype=object), counts)
    if LABEL in columns:
        by = cells_of(layout.where[LABEL][0])
        labels = np.array(by.texts, dtype=object)
        if "" in by.texts:
            raise by.wrong(by.texts.index(""), "the name of a repetition in every reading")
    joined = {role: np.concatenate(parts) for role, parts in values.items()}
    if "time" in joined:
        parts = np.split(joined["time"], np.flatnonzero(np.diff(joined["time"]) < 0) + 1)
        times = np.concatenate([between_ticks(part) for part in parts])
        if not np.array_equal(times, joined["time"]):
            notes.append(f"{path.name}: readings that share a coarse clock's time are even between its ticks")
        joined["time"] = times
    order = np.concatenate([np.arange(count) for count in counts])
    files = np.full(order.size, str(path), dtype=object)
    return Table(
        path, joined, labels, np.array(numbers)[order], files, np.array(blocks)[order], tuple(titles),
        layout.specimens if several else (), tuple(notes), clock, channels,
    )  # fmt: skip


def _length(columns: Sequence[Cells]) -> int:
    """How many readings there are up to the last of any of these columns."""
    return max((k for cells in columns for k, text in enumerate(cells.texts, 1) if text), default=0)


def _unit_of(
    cells: Cells, role: str, told: str | None, heading: int | None
) -> tuple[float, str | None, str | None]:
    """From the file's unit of ``role`` to the internal one, the unit that is written, and what to know of it:
    the unit that was ``told`` by the campaign overrules the file's."""
    target, title = UNITS[role], cells.title
    if not target:
        return 1.0, None, None
    written = cells.unit or parted(title, target)[1]
    factor = size_of(written or "", target)
    if told is not None:
        own = size_of(told, target)
        if own is None:
            raise BadInput(f"units.{role}", told, meant_unit(told, target))
        overruled = (
            f"{cells.path.name}: {title} is read in '{told}', as units.{role} says, not in '{written}'"
        )
        return own, told, overruled if written is not None and factor != own else None
    other = written or bracketed(title)
    if factor is None and (other is not None or target != "1"):
        instead = (
            f"units = {{ {role} = '{target}' }} in the campaign says it where the file does not, or wrongly"
        )
        expected = f"{meant_unit(other or '', target)}; {instead}"
        raise BadInput(title, other or "no unit", expected, file=str(cells.path), line=heading)
    return (1.0, None, None) if factor is None else (factor, written, None)


# -- rows, and what stands between and behind them ----------------------------------------------------
#: Words by which a line begins a cycle of one specimen, or another specimen.
CYCLES = re.compile(
    r"\W*(cycle|zyklus|loop|segment|step|stage|ramp|hold|load|unload|phase|part)", re.IGNORECASE
)
SPECIMENS = re.compile(r"\W*(specimen|sample|test|probe|run|repetition|replicate|curve|trial)", re.IGNORECASE)
#: What can be done about lines that are no readings.
_SKIP = "; lines that are no readings are passed over by how they begin, as in skip = ['Mean']"


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
        cells = [] if heads or is_empty(line) else _cells(path, layout, line, number)
        if heads:
            body, below = units_row(lines, number - 1, layout.separator, layout.where)
            if below != layout.below:
                expected = "the units of the first heading in all of the file"
                raise BadInput("row", lines[number][:60], expected, file=str(path), line=number + 1)
            number = body
        elif not any(cells):
            continue
        elif skip and line.strip().startswith(tuple(skip)):
            passed.append(number)
            continue
        elif (words and len(cells) < layout.needed) or layout.is_text(cells, rows[0].cells if rows else None):
            words.append(Row(cells, number))
            continue
        elif words and not heading:
            last = " ".join(filter(None, words[-1].cells))
            if not (CYCLES.match(last) or SPECIMENS.match(last)):
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
            fault = _width(layout, cells)
            require(not fault, "row", line.strip(), fault, path, number)
            rows.append(Row(cells, number, len(titles) - 1))
    if not rows and words:
        raise _no_reading(path, layout, lines, words[0])
    require(rows, "data", "no reading below the header", "readings", path, layout.body)
    passed = sorted(passed + [word.line for word in words])
    listed = ", ".join(f"line {at} '{lines[at - 1].strip()[:40]}'" for at in passed[:3])
    listed += f" and {len(passed) - 3} more" * (len(passed) > 3)
    notes = [f"{path.name}: no readings, and passed over: {listed}"] if passed else []
    return rows, titles[: rows[-1].block + 1], notes


def _title(layout: Layout, line: str) -> str:
    """What a line of words above a block says, without signs around it."""
    words = split_line(line, layout.separator) if layout.separator else [line]
    return " ".join(filter(None, words)).strip(" \t#%/[]()<>:*=-")


def _cells(path: Path, layout: Layout, line: str, number: int) -> list[str]:
    try:
        cells = split_line(line, layout.separator)
    except csv.Error as error:
        expected = f"a row of cells ({error})"
        raise BadInput("row", line[:40], expected, file=str(path), line=number) from error
    if len(layout.specimens) > 1 and layout.separator is not None and any(cells):
        cells += [""] * (layout.needed - len(cells))  # of specimens that have ended
    return cells


def _width(layout: Layout, cells: list[str]) -> str:
    """What is wrong with the number of cells in a row. Where no number has the separator in it, cells beyond
    the header harm nothing."""
    need, width = layout.needed, len(layout.names)
    if len(cells) >= need and (layout.separator in (";", "\t", "|") or not any(cells[max(width, need) :])):
        return ""
    comma = layout.separator == "," and len(cells) > width
    cure = "; decimal commas need another separator, such as a semicolon" if comma else _SKIP
    return f"{width} cells as in the header, not {len(cells)}{cure}"


def _no_reading(path: Path, layout: Layout, lines: list[str], row: Row) -> BadInput:
    key, value, expected = "row", lines[row.line - 1].strip()[:60], _width(layout, row.cells)
    if not expected:
        at = layout.read[0]
        key, value, expected = layout.title(at), row.cells[at], "a number in every reading" + _SKIP
    return BadInput(key, value, expected, file=str(path), line=row.line)


# -- parts of one test, and times that go on ----------------------------------------------------------
CYCLE, SPECIMEN = "cycles", "specimens"
#: What blocks below each other may be.
BLOCKS = (CYCLE, SPECIMEN)


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
    unnamed = "block {}" if how == CYCLE else "{}"
    names = table.titles if distinct else tuple(unnamed.format(k + 1) for k in range(count))
    if how == CYCLE:
        return _continued(replace(table, titles=names, notes=(*table.notes, note)))
    both = zip(table.labels, table.blocks, strict=True)
    labels = [f"{label}/{names[k]}" if label else names[k] for label, k in both]
    note += f": {', '.join(dict.fromkeys(labels))}"
    return replace(table, labels=np.array(labels, dtype=object), titles=("",), notes=(*table.notes, note))


def joined_files(tables: Sequence[Table]) -> Table:
    """Files that follow one another as one. Raises BadInput if only one has labels, or a clock."""
    first = tables[0]
    notes = [note for table in tables for note in table.notes]
    for before, table in pairwise(tables):
        alike = (table.labelled, table.clock) == (first.labelled, first.clock)
        expected = f"specimens and times as in {first.path.name}, which it follows"
        require(alike, "data", table.path.name, expected)
        x = before.columns.get("displacement", np.zeros(1))
        gap = abs(table.columns.get("displacement", x)[0] - x[-1])
        if gap > 0.05 * np.ptp(x):
            notes.append(f"{table.path.name} begins {gap:.4g} mm from where {before.path.name} ends")
    if len(tables) == 1:
        return first
    whole = replace(
        first,
        columns={role: np.concatenate([t.columns[role] for t in tables]) for role in first.columns},
        labels=np.concatenate([table.labels for table in tables]),
        lines=np.concatenate([table.lines for table in tables]),
        files=np.concatenate([table.files for table in tables]),
        blocks=np.repeat(np.arange(len(tables)), [table.lines.size for table in tables]),
        titles=tuple(table.path.name for table in tables),
        notes=tuple(notes),
    )
    return _continued(whole)


def _kind(table: Table) -> tuple[str, str]:
    """What the blocks are, and why."""
    if table.labelled and not table.specimens:
        return CYCLE, "as a column names the specimens"
    for how, words in ((CYCLE, CYCLES), (SPECIMEN, SPECIMENS)):
        named = list(dict.fromkeys(title for title in table.titles if words.match(title)))
        if len(named) >= len(table.titles) - 1:
            return how, f"as '{named[-1]}' says"
    if "time" in table.columns and not table.specimens:
        parts = [table.columns["time"][table.blocks == k] for k in range(len(table.titles))]
        if all(b[0] >= a[-1] for a, b in pairwise(parts)):
            return CYCLE, "as their time goes on"
        if all(b[0] < (a[0] + a[-1]) / 2 for a, b in pairwise(parts)):
            return SPECIMEN, "as their time begins anew"
    raise BadInput(
        "blocks", "a heading once more",
        "blocks = 'cycles' in the campaign, for parts of one specimen, or blocks = 'specimens'",
        file=str(table.path), line=int(table.lines[np.searchsorted(table.blocks, 1)]),
    )  # fmt: skip


def _continued(table: Table) -> Table:
    """The parts of each specimen as one, with times that go on, and notes on how they do.

    A part whose time begins where that of the one before began, within two steps, has a clock of its own,
    and follows at its own step; one that begins before the end of that is recorded twice up to there, and the
    later record counts.
    """
    each = [np.flatnonzero(table.labels == label) for label in table.names]
    recorded = table.columns.get("time", np.zeros(0))
    times, keep = recorded.copy(), np.ones(table.lines.size, dtype=bool)
    notes: dict[str, str] = {}
    for mine in each if recorded.size else ():
        parts = [(mine[table.blocks[mine] == k], title) for k, title in enumerate(table.titles)]
        shift = 0.0
        for (before, last), (part, title) in pairwise([part for part in parts if part[0].size]):
            begins, began, ended = recorded[part[0]], recorded[before[0]], recorded[before[-1]]
            step = float(np.median(np.diff(recorded[part]))) if part.size > 1 else 1.0
            if begins > ended:
                how = "goes on by the clock of"
            elif begins < began + 2 * step:
                shift += float(ended + step - begins)
                how = f"has a clock of its own, and follows {step:.4g} s after"
            else:
                again = before[recorded[before] >= begins]
                keep[again] = False
                how = f"begins before the end; left out are {again.size} of the last readings of"
            times[part] += shift
            notes.setdefault(how, f"{title} {how} {last}")
    rows = np.concatenate(each)
    whole = table.having(time=times) if recorded.size else table
    whole = replace(whole, titles=("",), notes=(*table.notes, *notes.values()))
    return whole.rows(rows[keep[rows]])
