"""Times as a clock shows them: 12:03:04.5, 00:01:10, 1:10.5, 2024-05-02T12:03:04, 12:03:04 PM."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

#: Seconds in a day; a clock that falls by more than half of it has passed midnight.
DAY = 86_400.0
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
