"""Times as a clock shows them: 12:03:04.5, 00:01:10, 1:10.5, 2024-05-02T12:03:04, 12:03:04 PM."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

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
