"""``cutbench materials``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import with_exit_status
from cutbench.cli.terminal import show


@with_exit_status
def materials(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME|FILE.toml]", help="Show one in full; with --new, where to write."),
    ] = None,
    new: Annotated[
        str | None,
        typer.Option("--new", metavar="NAME", help="Write a commented file of a material of your own."),
    ] = None,
) -> None:
    """List the known materials with their dimensionless groups, show one with its sources, or begin one of
    your own."""
    if new is not None:
        _begin(new, name)
        return
    from cutbench.cli.tables import material, material_table

    show(*(material_table() if name is None else material(name)))


def _begin(name: str, file: str | None) -> None:
    """Write the file of a material called ``name``, beside those that cutbench knows. Raises BadInput."""
    from cutbench.base.errors import BadInput
    from cutbench.case.materials import names
    from cutbench.cli.from_template import write_template
    from cutbench.cli.options import slug

    if name in names() or not name.strip() or not name.isprintable():
        expected = (
            f"a name of its own, such as 'my {name}'" if name in names() else "a name, such as 'my gel'"
        )
        raise BadInput("--new", name, expected)
    if file is None and name.endswith(".toml"):  # a file was meant
        file, name = name, Path(name).stem
    for line in write_template("material", Path(file or f"{slug(name)}.toml"), name=name):
        typer.echo(line)
