"""``cutbench guide``: what moves a material across the boundary between the regimes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.base.errors import BadInput
from cutbench.cli.options import with_exit_status


@with_exit_status
def guide(
    source: Annotated[
        str,
        typer.Argument(
            metavar="MATERIAL|DIR|MAP.nc",
            help="What is to be cut; or the folder of a sweep, or its map, with --material.",
        ),
    ],
    material: Annotated[
        str, typer.Option(metavar="MATERIAL|FILE.toml", help="What is to be cut, on a map.")
    ] = "",
    check: Annotated[
        bool, typer.Option(help="Try the first change by two runs, kept with those of the map.")
    ] = False,
) -> None:
    """Say how far a material is from the other regime, and which change gets it there soonest."""
    from cutbench.maps import guidance as guides
    from cutbench.maps.dataset import load_map, remarks, store_of

    path = Path(source) / "map.nc" if Path(source).is_dir() else Path(source)
    if not material and path.suffix == ".nc":
        raise BadInput("--material", "(missing)", "what is to be cut, on this map")
    if not material:
        if check:
            raise BadInput("--check", "true", "it only with a map, whose runs it goes with")
        typer.echo(guides.guide_by_atlas(source).text())
        return
    data = load_map(path)
    found = guides.guide(data, material)
    typer.echo(found.text())
    if check:
        for note in remarks(data):
            typer.echo(note)
        tried = guides.check(data, found, store_of(data, path.parent))
        typer.echo(tried.text())
        if not tried.crosses:
            raise typer.Exit(1)
