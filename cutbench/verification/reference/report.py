"""What a verification leaves: verify.json for programs, verify.md for people."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from pathlib import Path

from cutbench.base.files import check_writable, replacing
from cutbench.base.versions import versions
from cutbench.verification.reference.base import Check
from cutbench.verification.reference.runner import Verified

#: Layout of verify.json; raised when a reader of the old one would misread the new one.
SCHEMA = 1


def write(done: Sequence[Verified], out: str | Path, *, complete: bool) -> list[Path]:
    """Write verify.json and verify.md into ``out``. Raises BadInput where it cannot be written to."""
    folder = check_writable(out)
    texts = {
        "verify.json": json.dumps(describe(done, complete), indent=2, ensure_ascii=False, allow_nan=False),
        "verify.md": markdown(done),
    }
    paths = []
    for name, text in texts.items():
        with replacing(folder / name) as draft:
            draft.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
        paths.append(folder / name)
    return paths


def describe(done: Sequence[Verified], complete: bool) -> dict:
    """The content of verify.json. ``complete``: whether every problem that was asked for was computed."""
    return {
        "schema": SCHEMA,
        "passed": complete and all(one.passed for one in done),
        "complete": complete,
        "problems": [
            {
                "name": one.reference.name,
                "title": one.reference.title,
                "source": one.reference.source,
                "laws": list(one.reference.laws),
                "quick": one.reference.quick,
                "passed": one.passed,
                "failure": one.failure,
                "seconds": round(one.seconds, 3),
                "checks": [_plain(check, one) for check in one.checks],
            }
            for one in done
        ],
        "versions": versions(),
        "platform": {"system": platform.platform(), "machine": platform.machine()},
    }


def _plain(check: Check, one: Verified) -> dict:
    def number(value: float) -> float | None:
        return float(value) if abs(value) < float("inf") else None  # JSON has neither nan nor infinity

    return {
        "what": check.what,
        "unit": check.unit,
        "reference": number(check.reference),
        "source": check.source or one.reference.source,
        "obtained": number(check.obtained),
        "error": number(check.error),
        "error_is": "relative" if check.reference else "absolute",
        "tolerance": float(check.tolerance),
        "passed": check.passed,
    }


def texts(check: Check) -> tuple[str, str, str, str, str, str]:
    """A check as a row: what, reference, obtained, error, tolerance, verdict."""
    unit = "" if check.unit == "1" else f" {check.unit}"
    if check.reference:
        error, tolerance = f"{100 * check.error:+.3g} %", f"{100 * check.tolerance:g} %"
    else:
        error, tolerance = f"{check.error:.1e}{unit}", f"{check.tolerance:g}{unit}"
    verdict = "passed" if check.passed else "FAILED"
    return (
        check.what,
        f"{check.reference:.6g}{unit}",
        f"{check.obtained:.6g}{unit}",
        error,
        tolerance,
        verdict,
    )


def markdown(done: Sequence[Verified]) -> str:
    """The tables of a documentation page."""
    lines = []
    for one in done:
        lines += [
            f"### {one.reference.name}",
            "",
            f"{one.reference.title} *Reference:* {one.reference.source}.",
        ]
        if one.failure is not None:
            lines += ["", f"**Failed:** {one.failure}"]
        if one.checks:
            lines += [
                "",
                "| quantity | reference | obtained | error | tolerance | |",
                "|---|---|---|---|---|---|",
            ]
            for check in one.checks:
                what, *rest = texts(check)
                what += f" ({check.source})" if check.source else ""
                lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in (what, *rest)) + " |")
        lines.append("")
    return "\n".join(lines)
