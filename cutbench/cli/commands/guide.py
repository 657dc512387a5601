"""``cutbench guide``: what moves a material across the boundary of a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import with_exit_status


@with_exit_status
def guide(
    source: Annotated[Path, typer.Argument(metavar="DIR|MAP.nc", help="Folder of a sweep, or its map.")],
    material: Annotated[str, typer.Option(metavar="MATERIAL|FILE.toml", help="What is to be cut.")],
    check: Annotated[
        bool, typer.Option(help="Try the first change by two runs, kept with those of the map.")
    ] = False,
) -> None:
    """Say how far a material is from the other regime, and which change gets it there soonest."""
    from cutbench.maps import guidance as guides
    from cutbench.maps.dataset import load_map, store_of
    from cutbench.maps.map_cases import remarks

    path = source / "map.nc" if source.is_dir() else source
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
