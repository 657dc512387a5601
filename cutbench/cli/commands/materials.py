"""``cutbench materials``."""

from __future__ import annotations

from typing import Annotated

import typer

from cutbench.cli.options import exits
from cutbench.cli.show import show


@exits
def materials(
    name: Annotated[str | None, typer.Argument(metavar="[NAME|FILE.toml]", help="Show one in full.")] = None,
) -> None:
    """List the known materials with their dimensionless groups, or show one with its sources."""
    from cutbench.cli.tables import material, material_table

    show(material_table() if name is None else material(name))
