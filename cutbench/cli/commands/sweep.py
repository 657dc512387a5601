"""``cutbench sweep``: a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.base.threads import leave_cores_to_workers
from cutbench.cli.options import locked_folder, print_doubts, whole_number, with_exit_status
from cutbench.cli.progress import bar


@with_exit_status
def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="The axes and the base of the map.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the map and its runs are written; default: maps/STUDY."),
    ] = None,
    workers: Annotated[
        str | None, typer.Option(metavar="N", help="Processes; default: one a core.", show_default=False)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT, or local; needs Dask."),
    ] = None,
    store: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where runs are kept and looked up; default: OUT/runs.")
    ] = None,
    also: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="Take over runs kept there, too; may be repeated."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say how many runs are to be computed, and about how long.")
    ] = False,
    estimate: Annotated[
        bool,
        typer.Option("--estimate", help="Run nothing: a map at once, from runs that cutbench brings along."),
    ] = False,
    retry_failed: Annotated[bool, typer.Option(help="Compute again what fell short before.")] = False,
) -> None:
    """Compute a map; what is finished is never computed twice, so start it again to go on."""
    leave_cores_to_workers()
    from cutbench.base.errors import BadInput
    from cutbench.maps.study import load_study
    from cutbench.maps.sweep import run_study

    if estimate:
        for option, value in zip(
            ("--workers", "--scheduler", "--store", "--also"), (workers, scheduler, store, also), strict=True
        ):
            if value is not None:
                raise BadInput(option, str(value), "none with --estimate, which runs nothing")
    out = out or Path("maps") / (f"{study.stem}-estimate" if estimate else study.stem)
    plan, processes = load_study(study), whole_number("--workers", workers)
    if dry_run:
        from cutbench.maps.sampling_plan import forecast

        typer.echo(forecast(plan, store or out / "runs", processes, also or ()).text())
        return
    locked_folder(out)
    if estimate:
        from cutbench.maps.atlas_map import write_estimated

        write_estimated(plan, out)
        typer.echo(f"estimated map in {out}; hatched where it is unsure (95 %)")
        return
    print_doubts(plan.base, *plan.cases())
    with bar(plan.title, "runs") as on_progress:
        done = run_study(
            plan, out, workers=processes, on_progress=on_progress, retry_failed=retry_failed,
            scheduler=scheduler, store=store, also=also or (),
        )  # fmt: skip
    status = done.status
    typer.echo(f"{status.finished} of {status.total} runs, {status.failed} not to the end; map in {done.out}")
    for line in done.words():
        typer.echo(line)
    if done.interrupted:
        typer.echo("interrupted: start the same command again to go on", err=True)
        raise typer.Exit(130)
