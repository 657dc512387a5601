"""``cutbench discover``: what a model gets wrong of measured curves, which mechanism explains it, what it
gains."""

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
def discover(
    campaign: CampaignFile,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where discovery.json and discovery.html are written.")
    ] = Path("discovery"),
    workers: Workers = None,
    refine: Refine = True,
    limit: Limit = None,
    by_atlas: ByAtlas = False,
) -> None:
    """Fit the baseline, show where it fails, name the mechanism that explains it and what it gains."""
    from cutbench.calibration.fitting import INTERRUPTED
    from cutbench.discovery import report, search

    found = search_campaign(search.discover, report, campaign, out, workers, limit, refine=refine,
                            by_atlas=by_atlas)  # fmt: skip
    if found.stopped == INTERRUPTED:
        raise typer.Exit(130)
    if found.verdict == "undecided":
        raise typer.Exit(1)
