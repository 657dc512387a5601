"""The lines of a text file and the cells of a line: numbers, units, clock times, words for what was
not measured, comments."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.unit_spelling import is_unit

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


# -- times as a clock shows them ----------------------------------------------------------------------
#: Seconds in a day; a clock that falls by more than half of it has passed midnight.
DAY = 86_400.0
#: A clock stands still where it shows one time so many times as often as any other.
STANDS = 3
_CLOCK = re.compile(
    r"(?:(\d[\d./-]*\d)(?:[T,]\s*|\s+))?(\d+):(\d\d)(?::(\d\d))?([.,:]\d+)?\s*([ap]\.?m\.?)?(?:Z|[+-]\d\d:\d\d)?",
    re.IGNORECASE,
)


def is_clock(cell: str) -> bool:
    """Whether ``cell`` is a time as a clock shows it."""
    return ":" in cell and _CLOCK.fullmatch(cell.strip()) is not None


def seconds(cells: Sequence[str], unit: str | None = None) -> tuple[np.ndarray, int | None, str]:
    """Seconds (n,) of clock times, the first that cannot be read, and what it should be.

    Times of day go on over midnight. Two parts are minutes and seconds where they have decimals, else what
    ``unit`` says of the first, min or h. Dates are ISO, or the same in all cells.
    """
    found, dates = np.zeros(len(cells)), set()
    for k, cell in enumerate(cells):
        if (match := _CLOCK.fullmatch(cell.strip())) is None:
            return found, k, "a time such as 12:03:04.5 in every reading"
        day, first, second, third, part, half = match.groups()
        if third is None and part is None and unit not in ("min", "h"):
            return (
                found,
                k,
                "a time such as 12:03:04, or units.time = 'min' or 'h', what the first part counts",
            )
        hours = int(first) % 12 + 12 * (half[0] in "pP") if half else int(first)
        scale = 60 if third is None and unit in (None, "min") else 3600
        found[k] = scale * (hours + int(second) / 60) + int(third or 0) + float("0." + (part or ".0")[1:])
        if day:
            dates.add(day)
            try:
                found[k] += DAY * (date.fromisoformat(day).toordinal() - date(2000, 1, 1).toordinal())
            except ValueError:
                if len(dates) > 1:
                    return found, k, "dates as in 2024-05-02, where they change"
    if not dates:
        found += DAY * np.append(0.0, np.cumsum(np.diff(found) < -DAY / 2))
    return found, None, ""


def between_ticks(times: np.ndarray) -> np.ndarray:
    """Times (n,) of a clock that ticked more slowly than it was read, evenly from tick to tick; others as
    they are, also those of a clock that stood still."""
    starts = np.flatnonzero(np.diff(times, prepend=np.nan) != 0)
    ticks, counts = times[starts], np.diff(starts, append=times.size)
    *_, third, second, most = 1, 1, 1, *np.sort(counts)
    if third == 1 or most > STANDS * second or np.diff(ticks).min() <= 0:
        return times
    # The first tick may have begun before the first reading, and the last one ends after the last.
    whole = counts.copy()
    whole[[0, -1]] = max(counts[0], counts[1]), max(counts[-1], counts[-2])
    behind = np.arange(times.size) - np.repeat(starts, counts)
    behind[: counts[0]] += whole[0] - counts[0]
    return np.repeat(ticks, counts) + np.diff(ticks).min() * behind / np.repeat(whole, counts)
