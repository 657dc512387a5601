"""Materials that a map marks: where each lies on its axes, and its own run with all that is its own."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cutbench.base.errors import BadInput, require
from cutbench.case import materials
from cutbench.case.case import Case, load_case
from cutbench.case.motion import TRANSITION
from cutbench.case.physics import Physics
from cutbench.maps.axes import Axis, values_on


@dataclass(frozen=True)
class Mark:
    """Where a material lies: axis name -> value in the axis' unit; its own ``case``; and in words in what
    that differs from the map's at this place, empty where it does not."""

    name: str
    at: Mapping[str, float]
    case: Case
    differs: str


def read_mark(
    source: str, folder: Path, base: Case, axes: Sequence[Axis], place: Callable[[Sequence[float]], Case]
) -> Mark:
    """A material by name, or a case file as seen from ``folder``; ``place`` is the map's case at its values.

    Its run has its own laws and values, and as the map's ``base`` its numerics, its depth at most, and its
    end. Raises BadInput.
    """
    near = folder / source
    own = load_case(materials.find(near if near.is_file() else source, key="mark"))
    at, missing = values_on(axes, own)
    require(not missing, "mark", source, f"materials that have a value of {', '.join(missing)}")
    values = dict(own.values) | {"depth": min(own.values["depth"], base.values["depth"])}
    motion = () if base.until == TRANSITION else own.motion
    try:
        case = replace(own, numerics=base.numerics, values=values, motion=motion, until=base.until)
    except BadInput as error:
        raise BadInput("mark", source, f"a material that this study can run: {error}") from error
    differs = ""
    with contextlib.suppress(BadInput):  # off the axes there may be no such case
        differs = differences(place([at[axis.name] for axis in axes]), own)
    return Mark(own.name, at, case, differs)


def differing_groups(here: Case | Physics, own: Case) -> dict[str, tuple[float, float]]:
    """Dimensionless groups of a map's own case and of a material where they differ by a per cent."""
    ours, theirs = here.groups(), own.groups()
    return {
        name: (ours[name], theirs[name])
        for name in theirs
        if name in ours and not math.isclose(ours[name], theirs[name], rel_tol=0.01, abs_tol=1e-9)
    }


def differences(here: Case | Physics, own: Case) -> str:
    """``μ = 0.35``, ``with gent``: what is the material's own and not the map's."""
    declared = own.model.parameters()
    parts = [
        f"{declared[name].symbol if name in declared else name} = {theirs:.3g}"
        for name, (_, theirs) in differing_groups(here, own).items()
    ]
    for word, a, b in (("with", own, here), ("without", here, own)):
        parts += [f"{word} {name}" for name in a.mechanisms if name not in b.mechanisms]
    return ", ".join(parts)
