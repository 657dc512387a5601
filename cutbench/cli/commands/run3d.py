"""``cutbench run3d``: a block in three dimensions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.cli.options import (
    RunRequest,
    Threads,
    finish,
    run_options,
    run_with_progress,
    share_work,
    with_exit_status,
)

if TYPE_CHECKING:
    from cutbench.case.case import Case
    from cutbench.run.result import Result

#: Where the plane-strain section beside a block lies, in the block's folder.
SECTION = "section"


@with_exit_status
@run_options(dim=3)
def run3d(
    wanted: RunRequest,
    plane_strain: Annotated[
        bool, typer.Option(help="Compute the same case in plane strain too, for the end effect.")
    ] = True,
    threads: Threads = None,
) -> None:
    """Cut a block in three dimensions: as run2d, with the front of the cut along the blade.

    It ends where its transition is known, unless --until depth is given. The same case in plane strain comes
    first, and says about how long the block takes.
    """
    from cutbench.run.block_cost import cost_sentence, layers_sentence, pace_of
    from cutbench.run.checkpoint import NAME

    case, folder = wanted.case, wanted.folder
    share_work(threads)
    if layers := layers_sentence(case):
        typer.echo(f"{case.name}: {layers}", err=True)
    plane, pace = None, None
    if plane_strain:
        # First, as it says what the block will cost, and shows what it will look like.
        plane = _section(_flat(case, case.p.depth), folder)
        if not (folder / NAME).exists():
            pace = pace_of(case, plane)
            typer.echo(cost_sentence(case.name, pace.expected_s), err=True)
            typer.echo(f"{case.name}: its section is drawn in {folder / SECTION}", err=True)
    result = run_with_progress(case, folder, wanted.every_s, wanted.frames, pace=pace)
    if plane is not None and result.outcome.kind != "interrupted":
        from cutbench.run.front import end_effect

        reached = result.outcome.reached_mm
        if result.whole and reached < case.p.depth - 1e-9:
            # Curves are compared as far as both go.
            plane = _section(_flat(case, reached), folder)
        result.measures |= end_effect(result.measures, plane.measures)
    finish(result, folder, plane)


def _section(case: Case, folder: Path) -> Result:
    """The run of a section beside a block: the one that lies there, or a new one, with its pictures."""
    from cutbench.run.files import write_run
    from cutbench.run.store.runs import Store

    store = Store(folder / SECTION / "runs")
    if (known := store.get(case.id)) is not None:
        return known
    found = run_with_progress(case)
    if found.outcome.kind == "interrupted":
        raise KeyboardInterrupt
    store.put(found)
    write_run(found, folder / SECTION)
    return found


def _flat(case: Case, depth_mm: float) -> Case:
    """The same case in plane strain, as far as the block came."""
    values = {**case.values, "depth": depth_mm}
    values |= {name: 0.0 for name in ("tilt", "incline", "overhang") if name in values}
    numerics = replace(case.numerics, symmetry="auto", mesh=None)
    return replace(case, name=f"{case.name} (plane strain)", dim=2, values=values, numerics=numerics)
