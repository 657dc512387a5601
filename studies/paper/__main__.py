"""The claims of the paper held against runs.

``python -m studies.paper --out DIR``, from the project's folder. Runs are kept in DIR/runs and computed once:
start it again to go on.
"""

from __future__ import annotations

import argparse
import sys

from cutbench.base.errors import BadInput
from cutbench.base.report import Table
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show
from studies.paper.investigation import investigate, select
from studies.paper.judgement import BEYOND


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m studies.paper", description=__doc__)
    parser.add_argument("--out", metavar="DIR", help="a folder for claims.json, claims.md, pictures and runs")
    parser.add_argument(
        "--only", metavar="ID", action="append", default=[], help="this claim; may be repeated"
    )
    parser.add_argument("--workers", metavar="N", type=int, help="processes; default: one a core")
    parser.add_argument("--list", action="store_true", help="show the claims, compute nothing")
    asked = parser.parse_args()
    try:
        if asked.list:
            rows = [(c.id, c.text, ", ".join(c.asks) or c.beyond) for c in select(asked.only)]
            show(Table(("claim", "what was published", "runs"), rows))
            return 0
        if asked.out is None:
            raise BadInput("--out", "(missing)", "a folder for the runs behind the claims")
        with bar("claims", "runs") as on_progress:
            found = investigate(asked.out, only=asked.only, workers=asked.workers, on_progress=on_progress)
    except BadInput as error:
        print(f"studies.paper: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted: runs that ended are kept, the same command goes on", file=sys.stderr)
        return 130
    rows = []
    for one in found.judged:
        for row in one.rows:
            seen = (finding.text for finding in row.findings.values())
            rows.append((one.claim.id, row.what, row.findings["paper"].published, *seen, row.verdict))
        if one.claim.beyond:
            rows.append((one.claim.id, one.claim.beyond, "", "", "", BEYOND))
    show(Table(("claim", "statement", "the paper", "paper's numerics", "converged", "verdict"), rows))
    print(f"{len(found.runner.results)} runs, {found.runner.computed} of them computed now")
    print(*found.paths, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
