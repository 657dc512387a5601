"""The lines of a text file and the cells of a line: numbers, words for what was not measured, comments."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.unit_spelling import is_unit
from cutbench.data.clock_times import is_clock

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?")
_COMMENT = re.compile(r"\s*(#(?!N/?[AV]\b|DIV|VAL)|//|%)\s*", re.IGNORECASE)
_WITH_UNIT = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_].*|%)")
#: What stands where nothing was measured.
_MISSING = re.compile(
    r"[-+]?nan(\(\w+\))?|[-+]?\d\.#\w+|#?n[/.]?[av]\.?|#(div/0|value)!|null|none|-+", re.IGNORECASE
)


def error_at_line(path: Path, line: int | None, key: str, value: str, expected: str) -> BadInput:
    return BadInput(file=str(path), line=line, key=key, value=value, expected=expected)


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
        raise error_at_line(path, None, "data", "a binary file", "a text file: export the readings as CSV")
    if not text.strip():
        raise error_at_line(path, None, "data", "an empty file", "a header and readings")
    return re.split(r"\r\n|\n|\r", text)


def split_line(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    reader = csv.reader([line], delimiter=separator, skipinitialspace=True)
    return [cell.strip() for cell in next(reader, [])]


def is_empty(line: str) -> bool:
    return not line.strip() or bool(_COMMENT.match(line))


def is_value(cell: str) -> bool:
    """Whether a cell of a table holds a number, a clock time, or a word for what was not measured."""
    number = number_in(cell, False) is not None or number_in(cell, True) is not None
    return number or is_missing(cell) or is_clock(cell) or with_unit(cell) is not None


def with_unit(cell: str) -> tuple[str, str] | None:
    """The number and the unit in a cell that has both; None for others."""
    match = None if number_in(cell, "," in cell) is not None else _WITH_UNIT.fullmatch(cell.strip())
    return (match[1], match[2]) if match and is_unit(match[2]) else None


def is_missing(cell: str) -> bool:
    """Whether ``cell`` says that nothing was measured: -nan(ind), -1.#IND, #N/A, NaN, n/a and the like."""
    return _MISSING.fullmatch(cell.strip()) is not None


def number_in(cell: str, comma: bool) -> float | None:
    """The number in ``cell``, with a decimal comma or point; None if it is none."""
    text = cell.strip().replace("\u2212", "-")
    good = (_COMMA_NUMBER if comma else _NUMBER).fullmatch(text)
    return float(text.replace(",", ".")) if good else None


def uncommented(line: str) -> str:
    """``line`` without the sign of a comment before it."""
    return _COMMENT.sub("", line, count=1) if _COMMENT.match(line) else line
