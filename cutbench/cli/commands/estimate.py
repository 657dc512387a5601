"""``cutbench estimate``: what a run would give, at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import (
    Depth,
    Sets,
    Source,
    Until,
    With,
    Without,
    changes,
    in_mm,
    print_doubts,
    with_exit_status,
)


@with_exit_status
def estimate(
    material: Source,
    sets: Sets = None,
    depth: Depth = None,
    until: Until = None,
    without: Without = None,
    with_: With = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write estimate.json, estimate.csv and estimate.png there."),
    ] = None,
) -> None:
    """Say at once what a run would give, and how surely: from runs that cutbench brings along."""
    from cutbench.case.case import load_case
    from cutbench.emulator.atlas import shipped

    given = changes(sets, {"depth": in_mm(depth), "until": until}, with_, without)
    case = load_case(material, given)
    print_doubts(case)
    found = shipped().estimate(case)
    for name, text in found.lines():
        typer.echo(f"{name:<12} {text}")
    if out is not None:
        found.save(out)
        typer.echo(f"written to {out}")
