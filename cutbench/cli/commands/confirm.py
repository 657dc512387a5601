"""``cutbench confirm``: points of a plane-strain map in three dimensions."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.base.report import Table
from cutbench.base.threads import leave_cores_to_workers
from cutbench.cli.options import (
    Depth,
    Element,
    Keep,
    Sets,
    Size,
    changes,
    in_mm,
    locked_folder,
    run_with_progress,
    seconds,
    share_work,
    whole_number,
    with_exit_status,
    write_result,
)
from cutbench.cli.terminal import loudness, show

if TYPE_CHECKING:
    from cutbench.case.case import Case
    from cutbench.run.result import Result


@with_exit_status
def confirm(
    map_: Annotated[Path, typer.Argument(metavar="MAP.nc", help="A map that a sweep has written.")],
    points: Annotated[
        str | None, typer.Option(metavar="N", help="Least certain points of the map (3).", show_default=False)
    ] = None,
    materials: Annotated[bool, typer.Option(help="The marked materials too.")] = True,
    sets: Sets = None,
    h: Size = None,
    depth: Depth = None,
    element: Element = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A first look: blocks with --numerics fast.")
    ] = False,
    checkpoint: Keep = None,
    limit: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Longest that a run may take, as '2 h'; then the next one begins."),
    ] = None,
    workers: Annotated[
        str | None,
        typer.Option(
            metavar="N", help="Runs at once, in N processes; default: one after the other, on all cores."
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Run the sections only, and say about how long the blocks take.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where to write; default: confirm beside the map.")
    ] = None,
) -> None:
    """Run the least certain points of a map and its materials in three dimensions, compare, and mark them
    in the phase diagram: as far as the layers of blocks resolve their cohesive zone, else points near them.

    Each point is run as the map has it, as a section with the block's numerics, and as a block, of which the
    middle is judged: only where the two sections agree can it confirm. Options change blocks and the sections
    with their numerics.
    What blocks cost is said before the first begins. Start the same command again to go on where it stopped.
    """
    hands = whole_number("--workers", workers) or 0
    leave_cores_to_workers()
    share_work("1" if hands else None)
    from cutbench.base.errors import BadInput
    from cutbench.maps import dataset as maps
    from cutbench.maps.confirmation import confirm as compare
    from cutbench.maps.confirmation import resolved_points
    from cutbench.maps.dataset import remarks
    from cutbench.maps.markers import FOLDER, NUMERICS, RECORD, UNFINISHED
    from cutbench.maps.phase import save_phase

    count, every_s = whole_number("--points", points), seconds("--checkpoint", checkpoint, 60.0)
    limit_s = seconds("--limit", limit, math.inf)
    options = {
        "h": in_mm(h),
        "depth": in_mm(depth),
        "element": element,
        "numerics": "fast" if quick else None,
    }
    asked = changes(sets, options, None, None)
    data = maps.load_map(map_)
    for note in remarks(data):
        typer.echo(note)
    chosen, left_out = resolved_points(data, 3 if count is None else count, materials, asked)
    for sentence in left_out:
        typer.echo(sentence)
    if not chosen:
        expected = "points to compare: the map has none that were computed"
        raise BadInput("--points", str(count), expected)
    folder = locked_folder(out if out is not None else map_.parent / FOLDER)
    run = partial(_run, every_s=every_s, limit_s=limit_s, alone=not hands)
    done = compare(
        data, chosen, folder, run, source=str(map_), changes=asked, announce=typer.echo, limit_s=limit_s,
        workers=hands, sections_only=dry_run,
    )  # fmt: skip
    if dry_run:
        return
    pairs = {"onset_mm": "onset (mm)", "peak_N": "peak (N)", "drop_rel": "drop"}
    rows = [
        (point.name, " / ".join(str(one) for one in (point.label_2d, point.label_like, point.label_3d)),
         *(" / ".join(f"{one[k]:.3g}" for one in (point.two, point.like, point.middle)) for k in pairs),
         point.verdict)
        for point in done
    ]  # fmt: skip
    title = "section / section with the block's numerics / the block's middle"
    show(Table(("point", "label", *pairs.values(), "verdict"), rows, title))
    for point in done:
        ends = f"onset {point.ratio['onset_mm']:.3g}, peak {point.ratio['peak_N']:.3g}"
        typer.echo(f"{point.name}: what the ends do, block over section of equal numerics: {ends}")
    counts = Counter(point.verdict for point in done)
    said = ", ".join(f"{n} {name}" for name, n in counts.items()) or "none"
    typer.echo(f"{said}; {len(done)} of {len(chosen)} points compared")
    if counts[NUMERICS]:
        typer.echo(
            "Where the two sections have other labels, a block of these elements can confirm nothing:"
            " smaller ones (--h, --set corner=...) may."
        )
    # The map's own diagram shows what stands beside it.
    for picture in save_phase(data, map_.parent if out is None else folder, folder / RECORD):
        typer.echo(picture)
    typer.echo(f"written to {folder}")
    if len(done) < len(chosen):
        raise typer.Exit(130)
    if counts[UNFINISHED]:
        raise typer.Exit(1)


def _run(case: Case, folder: Path, *, every_s: float, limit_s: float, alone: bool) -> Result:
    """Compute ``case`` into ``folder``, with a bar where it is ``alone``."""
    if not alone:
        loudness(quiet=True, loud=False)
    result = run_with_progress(case, folder, every_s, limit_s=limit_s)
    write_result(result, folder)
    return result
