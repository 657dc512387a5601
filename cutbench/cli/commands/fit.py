"""``cutbench fit``: the parameters of a model from measured curves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import (
    ByAtlas,
    CampaignFile,
    Limit,
    Refine,
    Workers,
    search_campaign,
    with_exit_status,
)


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
    by_atlas: ByAtlas = False,
) -> None:
    """Fit a campaign's free parameters to all its train experiments, predict its test experiments."""
    from cutbench.calibration import fitting, report

    found = search_campaign(
        fitting.fit, report, campaign, out, workers, limit, refine=refine, profile=tuple(profile or ()),
        by_atlas=by_atlas,
    )  # fmt: skip
    if found.status != "converged":
        raise typer.Exit(130 if found.status == "interrupted" else 1)
