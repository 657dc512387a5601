"""``cutbench converge``: what a curve owes to how it was computed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.base.threads import leave_cores_to_workers
from cutbench.cli.options import Workers, print_written, whole_number, with_exit_status
from cutbench.cli.progress import bar


@with_exit_status
def converge(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY.toml", help="Materials, and changes of the numerics.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the tables and the runs are written.")],
    workers: Workers = None,
) -> None:
    """Change the numerics one by one and say how far each measure moves; start it again to go on."""
    leave_cores_to_workers()
    from cutbench.base.files import check_writable
    from cutbench.run.convergence import compute, load_plan, markdown, write

    plan, processes = load_plan(study), whole_number("--workers", workers)
    check_writable(out)

    with bar("converge", "runs") as on_progress:
        rows = compute(plan, out, workers=processes, on_progress=on_progress)
    paths = write(plan, rows, out)
    typer.echo(markdown(rows))
    failed = [f"{row.material}, {row.change}" for row in rows if row.holds is False]
    if failed:
        typer.echo(f"moved by more than 3 %: {'; '.join(failed)}")
    print_written(paths)
