"""``cutbench fit``: the parameters of a model from measured curves."""

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
def fit(
    campaign: CampaignFile,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where fit.json and fit.png are written.")] = Path(
        "fit"
    ),
    workers: Workers = None,
    profile: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Profile likelihood of a parameter, at several fits; repeatable."),
    ] = None,
    refine: Refine = True,
    limit: Limit = None,
) -> None:
    """Fit a campaign's free parameters to all its train experiments, predict its test experiments."""
    from cutbench.data.campaign import load_campaign

    loaded = load_campaign(campaign)
    count, limit_s = whole_number("workers", workers), seconds("--limit", limit, math.inf)
    folder = locked_folder(out)

    from cutbench.calibration.fitting import fit as run
    from cutbench.calibration.report import summary, write_fit

    with bar("fit") as on_progress:
        found = run(
            loaded, workers=count, refine=refine, profile=tuple(profile or ()), on_progress=on_progress,
            store=folder / "runs", limit_s=limit_s,
        )  # fmt: skip
    paths = write_fit(found, folder)
    typer.echo(summary(found))
    print_written(paths)
    if found.status != "converged":
        raise typer.Exit(130 if found.status == "interrupted" else 1)
