"""What an investigation of the claims leaves: claims.json for programs, claims.md for people."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from cutbench.base.files import check_writable, markdown_table, picked, write_json, write_text
from cutbench.base.versions import versions
from cutbench.run.result import Result
from studies.paper.base import CONVERGED, NUMERICS, PAPER, Finding
from studies.paper.cases import CHANGES, OPEN
from studies.paper.judgement import BEYOND, VERDICTS, ClaimRow, Judged, Scan
from studies.paper.runner import Runner

#: Layout of claims.json; raised when a reader of the old one would misread the new one.
SCHEMA = 1


def write(judged: Sequence[Judged], scans: Mapping[str, Scan], runner: Runner, out: str | Path) -> list[Path]:
    """Write claims.json and claims.md into ``out``. Raises BadInput where it cannot be written to."""
    folder = check_writable(out)
    record = describe(judged, scans, runner, folder)
    return [write_json(record, folder / "claims.json"), write_text(markdown(record), folder / "claims.md")]


def describe(
    judged: Sequence[Judged], scans: Mapping[str, Scan], runner: Runner, folder: Path
) -> dict[str, object]:
    """The content of claims.json: claims with their rows, how b was chosen, the runs behind them."""
    return {
        "schema": SCHEMA,
        "claims": [_claim(one) for one in judged],
        "open": {name: picked(change, "text") for name, change in OPEN.items()},
        "changes": {name: picked(change, "text", "start") for name, change in CHANGES.items()},
        "tips": {
            name: {
                **picked(scan, "measure", "published_mm", "tip_mm"),
                "tried": [
                    {"tip_mm": tip, "found_mm": found, "run": scan.ids[tip]}
                    for tip, found in scan.found_mm.items()
                ],
            }
            for name, scan in scans.items()
        },
        "runs": {id: _run(result, runner, folder) for id, result in runner.results.items()},
        "versions": versions(),
    }


def _claim(one: Judged) -> dict[str, object]:
    return {
        **picked(one.claim, "id", "text", "beyond", "note"),
        "rows": [_row(row) for row in one.rows],
        "runs": one.ids,
    }


def _row(row: ClaimRow) -> dict[str, object]:
    def found(by: Mapping[str, Finding]) -> dict[str, object]:
        return {word: picked(one, "value", "text", "holds") for word, one in by.items()}

    first = picked(row.findings[PAPER], "what", "published", "unit")
    both = {"found": found(row.findings), "changed": found(row.changed), "choices": found(row.choices)}
    return {**first, **both, **picked(row, "verdict", "reason")}


def _run(result: Result, runner: Runner, folder: Path) -> dict[str, object]:
    case = result.case
    return {
        "name": case.name,
        "test": runner.kinds.get(case.id, ""),
        "file": Path(os.path.relpath(runner.store.path(case.id) / "run.json", folder)).as_posix(),
        "outcome": str(result.outcome),
        "seconds": result.timings.get("total", math.nan),
        "measures": result.measures,
        "case": case.to_dict(),
    }


def markdown(record: Mapping) -> str:
    """claims.md, from the content of claims.json."""
    return "\n".join([summary(record), "", *claims(record), "", *_changes(record), "", *tips(record)])


def summary(record: Mapping) -> str:
    """How many statements have which verdict."""
    rows = [row["verdict"] for claim in record["claims"] for row in claim["rows"]]
    rows += [BEYOND for claim in record["claims"] if not claim["rows"]]
    counts = ", ".join(f"{rows.count(verdict)} {verdict}" for verdict in VERDICTS if verdict in rows)
    return f"{len(rows)} statements: {counts}."


def claims(record: Mapping) -> list[str]:
    """A line a statement: what the paper says, what runs say, the verdict and its reason."""
    lines = []
    for claim in record["claims"]:
        head = f"**{claim['id']}** {claim['text']}"
        for row in claim["rows"]:
            found = [_cell(claim, row, word, record) for word in NUMERICS]
            lines.append([head, row["what"], row["published"], *found, row["verdict"], row["reason"]])
            head = claim["id"]
        if claim["beyond"]:
            lines.append([head, "in three dimensions", "see the claim", *[BEYOND] * 3, claim["beyond"]])
    numerics = ("paper's numerics; range of what it leaves open", "converged defaults")
    return markdown_table(("claim", "statement", "the paper", *numerics, "verdict", "reason found"), lines)


def _cell(claim: Mapping, row: Mapping, word: str, record: Mapping) -> str:
    links = ", ".join(f"[{name}]({record['runs'][id]['file']})" for name, id in claim["runs"][word].items())
    mark = {True: "holds", False: "does not", None: "not known"}[row["found"][word]["holds"]]
    return f"{row['found'][word]['text']} ({mark}{_range(row) if word == PAPER else ''}; {links})"


def _range(row: Mapping) -> str:
    """What the paper's numerics say with all choices of what the paper leaves open."""
    choices = [*row.get("choices", {}).values()]
    if not choices:
        return ""
    every = [row["found"][PAPER], *choices]
    values = [one["value"] for one in every if one["value"] is not None and math.isfinite(one["value"])]
    span = f"; {min(values):.3g} to {max(values):.3g}" if values else ""
    return f"{span}, holds in {sum(one['holds'] is True for one in every)} of {len(every)}"


def _changes(record: Mapping) -> list[str]:
    changes, lines = record["changes"], []
    for claim in record["claims"]:
        for row in claim["rows"]:
            if not row["changed"]:
                continue
            cells = []
            for name in changes:
                one, ids = row["changed"].get(name), claim["runs"].get(name, {}).values()
                links = ", ".join(f"[{i}]({record['runs'][id]['file']})" for i, id in enumerate(ids, 1))
                cells.append("not run" if one is None else f"{_marked(one)} {links}")
            paper, converged = (_marked(row["found"][word]) for word in (PAPER, CONVERGED))
            lines.append([claim["id"], row["what"], paper, *cells, converged])
    texts = [change["text"] for change in changes.values()]
    return markdown_table(["claim", "statement", "paper's numerics", *texts, "converged defaults"], lines)


def _marked(one: Mapping) -> str:
    return f"**{one['text']}**" if one["holds"] else one["text"]


def tips(record: Mapping) -> list[str]:
    """How the length of the tip was chosen."""
    tried = sorted({one["tip_mm"] for scan in record["tips"].values() for one in scan["tried"]})
    lines = []
    for name, scan in record["tips"].items():
        cells = dict.fromkeys(tried, "none")
        for one in scan["tried"]:
            value = one["found_mm"]
            known = value is not None and math.isfinite(value)
            link = f" ([run]({record['runs'][one['run']]['file']}))"
            cells[one["tip_mm"]] = (f"{value:.2f} mm" if known else "none") + link
        published, taken = (f"{scan[key]:g} mm" for key in ("published_mm", "tip_mm"))
        lines.append([name, scan["measure"], published, *cells.values(), taken])
    heads = [f"b = {tip:g} mm" for tip in tried]
    return markdown_table(["material", "chosen for", "the paper", *heads, "taken"], lines)
