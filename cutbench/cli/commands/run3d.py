"""``cutbench run3d``: a block in three dimensions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.cli.options import RunRequest, finish, run_options, run_with_progress, with_exit_status

if TYPE_CHECKING:
    from cutbench.case.case import Case


@with_exit_status
@run_options(dim=3)
def run3d(
    wanted: RunRequest,
    plane_strain: Annotated[
        bool, typer.Option(help="Compute the same case in plane strain too, for the end effect.")
    ] = True,
) -> None:
    """Cut a block in three dimensions: as run2d, with the front of the cut along the blade.

    The same case in plane strain comes first, and says about how long the block takes.
    """
    case, folder = wanted.case, wanted.folder
    plane, pace = None, None
    if plane_strain:
        from cutbench.run.block_cost import cost_sentence, pace_of

        # First, as it says what the block will cost.
        plane = run_with_progress(_flat(case, case.p.depth))
        if plane.outcome.kind == "interrupted":
            raise KeyboardInterrupt
        pace = pace_of(case, plane)
        typer.echo(cost_sentence(case.name, pace.expected_s), err=True)
    result = run_with_progress(case, folder, wanted.every_s, wanted.frames, pace=pace)
    if plane is not None and result.outcome.kind != "interrupted":
        from cutbench.run.front import end_effect

        reached = result.outcome.reached_mm
        if result.whole and reached < case.p.depth - 1e-9:
            # Curves are compared as far as both go.
            plane = run_with_progress(_flat(case, reached))
        result.measures |= end_effect(result.measures, plane.measures)
    finish(result, folder, plane)


def _flat(case: Case, depth_mm: float) -> Case:
    """The same case in plane strain, as far as the block came."""
    values = {**case.values, "depth": depth_mm}
    values |= {name: 0.0 for name in ("tilt", "incline", "overhang") if name in values}
    numerics = replace(case.numerics, symmetry="auto", mesh=None)
    return replace(case, name=f"{case.name} (plane strain)", dim=2, values=values, numerics=numerics)
