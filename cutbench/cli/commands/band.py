"""``cutbench band``: a run with what the model leaves open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from cutbench.base.report import Table, number
from cutbench.base.threads import leave_cores_to_workers
from cutbench.cli.options import (
    Depth,
    Out,
    Sets,
    Size,
    Source,
    Until,
    With,
    Without,
    Workers,
    case_and_folder,
    changes,
    in_mm,
    whole_number,
    with_exit_status,
)
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show

if TYPE_CHECKING:
    from cutbench.run.band import Band


@with_exit_status
def band(
    material: Source,
    sets: Sets = None,
    h: Size = None,
    depth: Depth = None,
    until: Until = None,
    without: Without = None,
    with_: With = None,
    workers: Workers = None,
    out: Out = None,
) -> None:
    """Repeat a run over what the model leaves open; start it again to go on.

    One thing at a time: the length of the surface, how cohesion begins, how round the edge is, how hard the
    contact. Runs end with their transition unless --until says otherwise.
    """
    leave_cores_to_workers()
    from cutbench.case.case import load_case
    from cutbench.run.band import band as repeat
    from cutbench.run.band import case_to_transition

    given = changes(sets, {"h": in_mm(h), "depth": in_mm(depth), "until": until}, with_, without)
    processes = whole_number("--workers", workers)
    given.setdefault("until", case_to_transition(load_case(material, given)).until)
    case, folder = case_and_folder(material, given, out, dim=2, under="bands")
    with bar(case.name, "runs") as on_progress:
        found = repeat(case, until=case.until, out=folder, workers=processes, on_progress=on_progress)
    show(_table(found))
    for name, reason in found.refused.items():
        typer.echo(f"left out, {name}: {reason}")
    for name in found.short:
        typer.echo(f"{name}: {found.results[name].outcome}")
    typer.echo(f"written to {folder}")
    typer.echo(found.sentence())
    if found.short:
        raise typer.Exit(1)


def _table(found: Band) -> Table:
    """A row a run, and the range of each measure below."""
    from cutbench.run.measures import MEASURES

    keys = [key for key in ("onset_mm", "peak_N", "drop_rel", "steady_N") if key in found.ranges]
    heads = [key.removesuffix("_rel") if MEASURES[key][0] == "1" else key for key in keys]
    rows = [
        [
            name,
            *(number(result.measures.get(key), ".3g") for key in keys),
            found.labels.get(name, result.outcome.kind),
        ]
        for name, result in found.results.items()
    ]
    ranges = [f"{found.ranges[key].low:.3g} to {found.ranges[key].high:.3g}" for key in keys]
    rows += [[], ["range", *ranges, found.label]]
    return Table(["", *heads, ""], rows, found.case.name, right=heads)
