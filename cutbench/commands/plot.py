"""``cutbench plot``: pictures again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.face import exits


@exits
def plot(
    source: Annotated[
        Path, typer.Argument(metavar="DIR|MAP.nc", help="Folder of a run or a sweep, or a map.")
    ],
) -> None:
    """Draw the pictures of a run or a map again."""
    from cutbench.errors import BadInput

    grid = source / "map.nc" if source.is_dir() else source
    if source.is_dir() and (source / "run.json").is_file():
        from cutbench.output import read_run
        from cutbench.plots import plot_curve, save

        paths = save(plot_curve(read_run(source)), source / "curve.png")
    elif grid.is_file():
        from cutbench.maps import load_map
        from cutbench.phase import save_phase

        paths = save_phase(load_map(grid), grid.parent)
    else:
        raise BadInput(
            key="DIR|MAP.nc",
            value=str(source),
            expected="a folder with run.json or map.nc in it, or a map.nc",
        )
    for path in paths:
        typer.echo(path)
