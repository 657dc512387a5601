"""What a verification leaves: verify.json for programs, verify.md for people."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from pathlib import Path

from cutbench.base.files import check_writable, markdown_table, picked, write_json, write_text
from cutbench.base.versions import versions
from verification.base import Check, Verified

#: Layout of verify.json; raised when a reader of the old one would misread the new one.
SCHEMA = 1


def write(done: Sequence[Verified], out: str | Path, *, complete: bool) -> list[Path]:
    """Write verify.json and verify.md into ``out``. Raises BadInput where it cannot be written to."""
    folder = check_writable(out)
    record = describe(done, complete)
    return [write_json(record, folder / "verify.json"), write_text(markdown(done), folder / "verify.md")]


def describe(done: Sequence[Verified], complete: bool) -> dict:
    """The content of verify.json. ``complete``: whether every problem that was asked for was computed."""
    return {
        "schema": SCHEMA,
        "passed": complete and all(one.passed for one in done),
        "complete": complete,
        "problems": [
            {
                **picked(one.reference, "name", "title", "source", "laws", "quick"),
                **picked(one, "passed", "failure"),
                "seconds": round(one.seconds, 3),
                "checks": [_plain(check, one) for check in one.checks],
            }
            for one in done
        ],
        "versions": versions(),
        "platform": {"system": platform.platform(), "machine": platform.machine()},
    }


def _plain(check: Check, one: Verified) -> dict[str, object]:
    return {
        **picked(check, "what", "unit", "reference", "obtained", "error", "tolerance", "passed"),
        "source": check.source or one.reference.source,
        "error_is": "relative" if check.reference else "absolute",
    }


def texts(check: Check) -> list[str]:
    """A check as a row: what, reference, obtained, error, tolerance, verdict."""
    unit = "" if check.unit == "1" else f" {check.unit}"
    if check.reference:
        error, tolerance = f"{100 * check.error:+.3g} %", f"{100 * check.tolerance:g} %"
    else:
        error, tolerance = f"{check.error:.1e}{unit}", f"{check.tolerance:g}{unit}"
    numbers = [f"{value:.6g}{unit}" for value in (check.reference, check.obtained)]
    return [check.what, *numbers, error, tolerance, "passed" if check.passed else "FAILED"]


def summary(done: Sequence[Verified]) -> list[str]:
    """The list of a documentation page: a line a problem, with the check that comes nearest to its limit."""
    return [_line(one) for one in done]


def _line(one: Verified) -> str:
    passed = f"{sum(check.passed for check in one.checks)} of {len(one.checks)}"
    near = _nearest(one.checks) if one.failure is None and one.checks else f"**Failed:** {one.failure}"
    return f"- **`{one.reference.name}`**: {one.reference.title} *{one.reference.source}.* {passed}; {near}"


def _nearest(checks: Sequence[Check]) -> str:
    def part(check: Check) -> float:
        return abs(check.error) / check.tolerance if math.isfinite(check.error) else math.inf

    nearest = max(checks, key=part)
    what, _, _, error, tolerance, _ = texts(nearest)
    what += f" ({nearest.source})" if nearest.source else ""
    return f"{what}: {error} of {tolerance}"


def markdown(done: Sequence[Verified]) -> str:
    """A line a problem, then every check."""
    lines = [*summary(done), ""]
    for one in done:
        heading = f"{one.reference.title} *Reference:* {one.reference.source}."
        lines += [f"### {one.reference.name}", "", heading]
        if one.failure is not None:
            lines += ["", f"**Failed:** {one.failure}"]
        if one.checks:
            rows = [texts(check) for check in one.checks]
            for row, check in zip(rows, one.checks, strict=True):
                row[0] += f" ({check.source})" if check.source else ""
            head = ("quantity", "reference", "obtained", "error", "tolerance", "")
            lines += ["", *markdown_table(head, rows)]
        lines.append("")
    return "\n".join(lines)
