"""``cutbench examples``: studies, measured campaigns and notebooks to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import with_exit_status


@with_exit_status
def examples(
    out: Annotated[Path, typer.Option(metavar="DIR", help="A new folder to copy them into.")] = Path(
        "examples"
    ),
) -> None:
    """Copy the example studies, campaigns, readings and all, and notebooks into a folder."""
    from cutbench.data.example_files import copy_examples

    folder = copy_examples(out)
    for path in sorted([*folder.rglob("*.toml"), *folder.rglob("*.ipynb")]):
        typer.echo(path)
