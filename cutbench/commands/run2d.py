"""``cutbench run2d``: a block in plane strain."""

from __future__ import annotations

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

#: Blade travel of the pictures of the section, in parts of the whole.
_SNAPSHOTS = (0.25, 0.5, 0.75, 1.0)


@exits
def run2d(
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
) -> None:
    """Cut a block in plane strain: force curve, energy by mechanism, fields, pictures."""
    every_s = seconds("--checkpoint", checkpoint, 60.0)
    options = {
        "h": in_mm(h),
        "depth": in_mm(depth),
        "element": element,
        "normal": normal,
        "numerics": numerics,
    }
    case, folder = asked(material, changes(sets, options, with_, without), out, dim=2)
    result = computed(case, _SNAPSHOTS, folder, every_s)
    finish(result, folder)
