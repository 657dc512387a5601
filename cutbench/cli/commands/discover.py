"""``cutbench discover``: what a model gets wrong of measured curves, which mechanism explains it, what it
gains."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import (
    CampaignFile,
    Limit,
    Refine,
    Workers,
    locked_folder,
    print_written,
    seconds,
    whole_number,
    with_exit_status,
)
from cutbench.cli.progress import bar


@with_exit_status
def discover(
    campaign: CampaignFile,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where discovery.json and discovery.html are written.")
    ] = Path("discovery"),
    workers: Workers = None,
    refine: Refine = True,
    limit: Limit = None,
) -> None:
    """Fit the baseline, show where it fails, name the mechanism that explains it and what it gains."""
    from cutbench.data.campaign import load_campaign

    loaded = load_campaign(campaign)
    count, limit_s = whole_number("workers", workers), seconds("--limit", limit, math.inf)
    folder = locked_folder(out)

    from cutbench.calibration.fitting import INTERRUPTED
    from cutbench.discovery import discover as run
    from cutbench.discovery.report import summary, write_discovery

    with bar("discover") as on_progress:
        store = folder / "runs"
        found = run(
            loaded, workers=count, refine=refine, on_progress=on_progress, store=store, limit_s=limit_s
        )  # fmt: skip
    paths = write_discovery(found, folder)
    typer.echo(summary(found))
    print_written(paths)
    if found.stopped == INTERRUPTED:
        raise typer.Exit(130)
    if found.verdict == "undecided":
        raise typer.Exit(1)
