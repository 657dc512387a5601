"""What ``python -m studies.paper`` found, on a page of documentation.

``python -m studies.paper.page DIR PAGE`` writes it, from the project's folder.

Between the page's two marks stand the verdicts of DIR's claims.json, without runs that a reader has not and
the numbers of each change; claims.json, which has them all, and the pictures are copied into docs/figures.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.files import replacing
from studies.paper.judgement import CHOICE, REPRODUCED, SOLID
from studies.paper.report import claims, summary, tips

BEGIN, END = "<!-- claims: begin -->", "<!-- claims: end -->"
PICTURES = ("published-curves.png", "published-changes.png", "published-tips.png")


def tables(record: dict) -> str:
    """What a page shows of claims.json: verdicts with what decides them, and how the tip was chosen."""
    told = [
        {**claim, "rows": [{**row, "reason": in_short(row)} for row in claim["rows"]]}
        for claim in record["claims"]
    ]
    lines = [summary(record), "", *claims({**record, "claims": told}), "", *tips(record)]
    link = r"\[[^\]]*\]\(runs/[^)]*\)"
    return re.sub(rf" \({link}\)|(?:; |, ){link}|, holds in \d+ of \d+", "", "\n".join(lines))


def in_short(row: dict) -> str:
    """Which changes decide where the paper's numerics fail, without what came out under each."""
    if row["verdict"] in (REPRODUCED, CHOICE) or row["reason"] == SOLID:
        return ""
    reason = re.sub(r"^(no single change [^:]*): .*", r"\1", row["reason"])
    number = r" \(-?[\d.]+(?:e-?\d+)?(?: [^\s()]+)?\)"
    return re.sub(number, "", re.sub(f"{number}, ", " / ", reason))


def put(found: str | Path, page: str | Path) -> None:
    """Renew ``page`` from the folder ``found``. Raises BadInput where one of them is no such thing."""
    found, page = Path(found), Path(page)
    try:
        record = json.loads((found / "claims.json").read_text(encoding="utf-8"))
        text = page.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise BadInput(
            key="page", value=f"{found}, {page}", expected=f"a folder of studies.paper and a page ({error})"
        ) from error
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise BadInput(file=str(page), key="marks", value="(missing)", expected=f"{BEGIN} and {END} in it")
    figures = Path(__file__).parents[2] / "docs" / "figures"
    figures.mkdir(exist_ok=True)
    with replacing(figures / "claims.json") as draft:
        draft.write_text(
            json.dumps(record, ensure_ascii=False, separators=(",", ":")) + "\n", encoding="utf-8"
        )
    for name in PICTURES:
        with replacing(figures / name) as draft:
            shutil.copyfile(found / name, draft)
    with replacing(page) as draft:
        draft.write_text(f"{head}{BEGIN}\n\n{tables(record)}\n\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    try:
        put(*sys.argv[1:3])
    except (BadInput, TypeError) as error:
        sys.exit(f"cutbench: {error}")
