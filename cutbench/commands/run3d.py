"""``cutbench run3d``: a block in three dimensions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.face import (
    Depth,
    Element,
    Keep,
    Normal,
    Out,
    Preset,
    Sets,
    Size,
    Source,
    With,
    Without,
    asked,
    changes,
    computed,
    exits,
    finish,
    in_mm,
    seconds,
)

if TYPE_CHECKING:
    from cutbench.case import Case


#: Blade travel of the pictures, in parts of the whole: the front runs sideways within a short travel.
_SNAPSHOTS = tuple(i / 12 for i in range(1, 13))


@exits
def run3d(
    material: Source,
    sets: Sets = None,
    h: Size = None,
    depth: Depth = None,
    element: Element = None,
    normal: Normal = None,
    numerics: Preset = None,
    without: Without = None,
    with_: With = None,
    out: Out = None,
    checkpoint: Keep = None,
    plane_strain: Annotated[
        bool, typer.Option(help="Compute the same case in plane strain too, for the end effect.")
    ] = True,
) -> None:
    """Cut a block in three dimensions: as run2d, with the front of the cut along the blade."""
    every_s = seconds("--checkpoint", checkpoint, 60.0)
    options = {
        "h": in_mm(h),
        "depth": in_mm(depth),
        "element": element,
        "normal": normal,
        "numerics": numerics,
    }
    case, folder = asked(material, changes(sets, options, with_, without), out, dim=3)
    result = computed(case, _SNAPSHOTS, folder, every_s)
    plane = None
    if plane_strain and result.outcome.kind != "interrupted":
        from cutbench.front import end_effect

        plane = computed(_flat(case, result.outcome.reached_mm))
        result.measures |= end_effect(result.measures, plane.measures)
    finish(result, folder, plane)


def _flat(case: Case, depth_mm: float) -> Case:
    """The same case in plane strain, as far as the block came."""
    values = {**case.values, "depth": depth_mm}
    values |= {name: 0.0 for name in ("tilt", "overhang") if name in values}
    numerics = replace(case.numerics, symmetry="auto", mesh=None)
    return replace(case, name=f"{case.name} (plane strain)", dim=2, values=values, numerics=numerics)
