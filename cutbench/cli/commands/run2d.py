"""``cutbench run2d``: a block in plane strain."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.base.report import Table, number
from cutbench.cli.options import RunRequest, finish, run_options, run_with_progress, with_exit_status
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show

if TYPE_CHECKING:
    from cutbench.run.result import Result

#: What --follow writes: what was found, the path, the picture.
_FOLLOWED = ("follow.json", "path.csv", "follow.png")


@with_exit_status
@run_options(dim=2)
def run2d(
    wanted: RunRequest,
    follow: Annotated[
        bool,
        typer.Option(
            "--follow", help="Say whether a drop is physical: trace the equilibria that the blade jumps over."
        ),
    ] = False,
) -> None:
    """Cut a block in plane strain: force curve, energy by mechanism, fields, pictures."""
    case, folder = wanted.case, wanted.folder
    for name in _FOLLOWED:
        (folder / name).unlink(missing_ok=True)
    if follow:
        from cutbench.run.snap_back import rate_independent_case

        rate_independent_case(case)  # what cannot be followed is refused before anything is computed
    result = run_with_progress(case, folder, wanted.every_s, wanted.frames)
    try:
        finish(result, folder)
    finally:
        if follow and result.outcome.kind != "interrupted":
            _follow(result, folder)


def _follow(result: Result, folder: Path) -> None:
    """Trace the path of ``result``'s case and say what it shows; leaves with 130 if it was interrupted."""
    from cutbench.base.files import write_json
    from cutbench.run.figures import save
    from cutbench.run.files import write_curve
    from cutbench.run.snap_back import (
        INTERRUPTED,
        describe_followed,
        plot_followed,
        sentence,
        trace_snap_back,
    )

    with bar(result.case.name, "mm") as on_progress:
        found = trace_snap_back(result.case, result, on_progress=on_progress)
    record, path, picture = (folder / name for name in _FOLLOWED)
    write_curve(found.curve, path, list(found.curve))
    save(plot_followed(found), picture)
    describe = describe_followed(found)
    write_json(describe, record)
    show(_limit(describe))
    typer.echo(sentence(found))
    typer.echo(f"written to {record}, {path}, {picture}")
    if found.stopped == INTERRUPTED:
        raise typer.Exit(130)


def _limit(record: dict) -> Table:
    """The rows of follow.json's limit as a table."""
    columns = {"drop_rel": ".3f", "onset_mm": ".3f", "peak_N": ".4g", "peak_mm": ".3f"}
    rows = [
        (str(row["what"]), *(number(row[key], form) for key, form in columns.items()))
        for row in record["limit"]
    ]
    heads = ("", "drop", "onset (mm)", "peak (N)", "at (mm)")
    return Table(heads, rows, "less and less viscosity")
