"""``cutbench mechanisms``."""

from __future__ import annotations

from typing import Annotated

import typer

from cutbench.cli.options import exits, show


@exits
def mechanisms(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Show all about one.")] = None,
) -> None:
    """List the known mechanisms with parameters, units and groups, or show one with its source."""
    from cutbench.cli.tables import mechanism, mechanism_table

    show(mechanism_table() if name is None else mechanism(name))
