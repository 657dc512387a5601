"""What an investigation of the claims leaves: claims.json for programs, claims.md for people."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from cutbench.base.files import check_writable, replacing, write_json
from cutbench.base.versions import versions
from cutbench.run.result import Result
from cutbench.verification.paper.base import CONVERGED, NUMERICS, PAPER, Finding
from cutbench.verification.paper.cases import CHANGES
from cutbench.verification.paper.judgement import BEYOND, VERDICTS, ClaimRow, Judged, Scan
from cutbench.verification.paper.runner import Runner

#: Layout of claims.json; raised when a reader of the old one would misread the new one.
SCHEMA = 1


def write(judged: Sequence[Judged], scans: Mapping[str, Scan], runner: Runner, out: str | Path) -> list[Path]:
    """Write claims.json and claims.md into ``out``. Raises BadInput where it cannot be written to."""
    folder = check_writable(out)
    record = describe(judged, scans, runner, folder)
    write_json(record, folder / "claims.json")
    with replacing(folder / "claims.md") as draft:
        draft.write_text(markdown(record) + "\n", encoding="utf-8")
    return [folder / "claims.json", folder / "claims.md"]


def describe(
    judged: Sequence[Judged], scans: Mapping[str, Scan], runner: Runner, folder: Path
) -> dict[str, object]:
    """The content of claims.json: claims with their rows, how b was chosen, the runs behind them."""
    return {
        "schema": SCHEMA,
        "claims": [_claim(one) for one in judged],
        "changes": {name: {"text": c.text, "start": c.start} for name, c in CHANGES.items()},
        "tips": {
            name: {
                "measure": scan.measure,
                "published_mm": scan.published_mm,
                "tried": [
                    {"tip_mm": tip, "found_mm": found, "run": scan.ids[tip]}
                    for tip, found in scan.found_mm.items()
                ],
                "tip_mm": scan.tip_mm,
            }
            for name, scan in scans.items()
        },
        "runs": {id: _run(result, runner, folder) for id, result in runner.results.items()},
        "versions": versions(),
    }


def _claim(one: Judged) -> dict[str, object]:
    claim = one.claim
    return {
        "id": claim.id,
        "text": claim.text,
        "beyond": claim.beyond,
        "note": claim.note,
        "rows": [_row(row) for row in one.rows],
        "runs": {word: dict(ids) for word, ids in one.ids.items()},
    }


def _row(row: ClaimRow) -> dict[str, object]:
    published = row.findings[PAPER].published
    return {
        "what": row.what,
        "published": published,
        "unit": row.findings[PAPER].unit,
        "found": {word: _finding(one) for word, one in row.findings.items()},
        "changed": {name: _finding(one) for name, one in row.changed.items()},
        "verdict": row.verdict,
        "reason": row.reason,
    }


def _finding(one: Finding) -> dict[str, object]:
    return {"value": one.value, "text": one.text, "holds": one.holds}


def _run(result: Result, runner: Runner, folder: Path) -> dict[str, object]:
    case = result.case
    where = runner.store.path(case.id) / "run.json"
    return {
        "name": case.name,
        "test": runner.kinds.get(case.id, ""),
        "file": Path(os.path.relpath(where, folder)).as_posix(),
        "outcome": str(result.outcome),
        "seconds": result.timings.get("total", math.nan),
        "measures": result.measures,
        "case": case.to_dict(),
    }


def markdown(record: Mapping) -> str:
    """The tables of a documentation page, from the content of claims.json."""
    lines = [*_summary(record), "", *_table(record), "", *_changes(record), "", *_tips(record)]
    return "\n".join(lines)


def _summary(record: Mapping) -> list[str]:
    rows = [row["verdict"] for claim in record["claims"] for row in claim["rows"]]
    rows += [BEYOND for claim in record["claims"] if not claim["rows"]]
    counts = [f"{rows.count(verdict)} {verdict}" for verdict in VERDICTS if verdict in rows]
    return [f"{len(rows)} statements: " + ", ".join(counts) + "."]


def _table(record: Mapping) -> list[str]:
    lines = [
        "| claim | statement | the paper | paper's numerics | converged defaults | verdict | reason found |",
        "|---|---|---|---|---|---|---|",
    ]
    for claim in record["claims"]:
        head = f"**{claim['id']}** {claim['text']}"
        for row in claim["rows"]:
            cells = [
                head, row["what"], row["published"], *(_cell(claim, row, word, record) for word in NUMERICS),
                row["verdict"], row["reason"],
            ]  # fmt: skip
            lines.append(_line(cells))
            head = f"{claim['id']}"
        if claim["beyond"]:
            lines.append(
                _line([head, "in three dimensions", "see the claim", *[BEYOND] * 3, claim["beyond"]])
            )
    return lines


def _cell(claim: Mapping, row: Mapping, word: str, record: Mapping) -> str:
    links = ", ".join(f"[{name}]({record['runs'][id]['file']})" for name, id in claim["runs"][word].items())
    mark = {True: "holds", False: "does not", None: "not known"}[row["found"][word]["holds"]]
    return f"{row['found'][word]['text']} ({mark}; {links})"


def _changes(record: Mapping) -> list[str]:
    changes = record["changes"]
    lines = [
        "| claim | statement | paper's numerics | " + " | ".join(c["text"] for c in changes.values())
        + " | converged defaults |",
        "|---|---" + "|---" * (len(changes) + 2) + "|",
    ]  # fmt: skip
    for claim in record["claims"]:
        for row in claim["rows"]:
            if not row["changed"]:
                continue
            cells = [_marked(row["found"][PAPER])]
            for name in changes:
                one = row["changed"].get(name)
                links = ", ".join(
                    f"[{i}]({record['runs'][id]['file']})"
                    for i, id in enumerate(claim["runs"].get(name, {}).values(), 1)
                )
                cells.append("not run" if one is None else f"{_marked(one)} {links}")
            lines.append(_line([claim["id"], row["what"], *cells, _marked(row["found"][CONVERGED])]))
    return lines


def _marked(one: Mapping) -> str:
    return f"**{one['text']}**" if one["holds"] else one["text"]


def _tips(record: Mapping) -> list[str]:
    tips = sorted({one["tip_mm"] for scan in record["tips"].values() for one in scan["tried"]})
    lines = [
        "| material | chosen for | the paper | "
        + " | ".join(f"b = {tip:g} mm" for tip in tips)
        + " | taken |",
        "|---|---|---" + "|---" * len(tips) + "|---|",
    ]
    for name, scan in record["tips"].items():
        found = {one["tip_mm"]: one for one in scan["tried"]}
        cells = []
        for tip in tips:
            one = found.get(tip)
            value = None if one is None else one["found_mm"]
            known = value is not None and math.isfinite(value)
            link = "" if one is None else f" ([run]({record['runs'][one['run']]['file']}))"
            cells.append((f"{value:.2f} mm" if known else "none") + link)
        lines.append(
            _line([name, scan["measure"], f"{scan['published_mm']:g} mm", *cells, f"{scan['tip_mm']:g} mm"])
        )
    return lines


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"
