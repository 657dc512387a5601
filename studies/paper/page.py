"""What ``python -m studies.paper`` found, for a page of documentation.

``python -m studies.paper.page DIR`` copies claims.json and the pictures of DIR into docs/figures. When the
site is built, its table has the verdicts of claims.json, without runs that a reader has not and the numbers
of each change.
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


def put(found: str | Path) -> None:
    """Renew docs/figures from the folder ``found``. Raises BadInput where that is no such thing."""
    found, figures = Path(found), Path(__file__).parents[2] / "docs" / "figures"
    try:
        record = json.loads((found / "claims.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInput(key="folder", value=str(found), expected=f"one of studies.paper ({error})") from error
    figures.mkdir(exist_ok=True)
    with replacing(figures / "claims.json") as draft:
        draft.write_text(
            json.dumps(record, ensure_ascii=False, separators=(",", ":")) + "\n", encoding="utf-8"
        )
    for name in PICTURES:
        with replacing(figures / name) as draft:
            shutil.copyfile(found / name, draft)


if __name__ == "__main__":
    try:
        put(*sys.argv[1:])
    except (BadInput, TypeError) as error:
        sys.exit(f"cutbench: {error}")
