"""``cutbench data``: what was measured."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import with_exit_status
from cutbench.cli.terminal import show


@with_exit_status
def data(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="Tests and their readings.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where data.png and data.csv are written; default: nowhere."),
    ] = None,
) -> None:
    """Read a campaign and show what it holds, with the spread over repetitions."""
    from cutbench.cli.tables import averages, data_table
    from cutbench.data.campaign import load_campaign

    loaded = load_campaign(campaign)
    show(data_table(loaded))
    for note in loaded.all_notes():
        typer.echo(f"note: {note}")
    typer.echo(f"baseline: {loaded.model.described}")
    if out is not None:
        from cutbench.base.files import check_writable, csv_text, write_text
        from cutbench.data.figure import plot_data
        from cutbench.run.figures import save

        folder = check_writable(out)
        typer.echo(write_text(csv_text(*averages(loaded)), folder / "data.csv"))
        for path in save(plot_data(loaded), folder / "data.png"):
            typer.echo(path)
