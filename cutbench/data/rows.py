"""The rows of readings in a file, and what stands between and behind them: headings, names, footers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cutbench.base.errors import BadInput
from cutbench.data.layout import LABEL, Layout, units_row
from cutbench.data.text_cells import error_at_line, is_empty, split_line

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
            if words and not heading and not _names_a_block(words[-1]):
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


def _names_a_block(row: Row) -> bool:
    text = " ".join(cell for cell in row.cells if cell)
    return bool(CYCLES.match(text) or SPECIMENS.match(text))


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
