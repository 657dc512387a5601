"""What a map's places stand for: laws and values, whatever wrote it, and cases where this cutbench can."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.base.versions import written_by
from cutbench.case.case import Case
from cutbench.case.computation import computation_here
from cutbench.case.physics import Physics
from cutbench.maps.axes import short
from cutbench.maps.dataset import axes_of, axis_of
from cutbench.maps.study import Startable, case_at


def case_on(data: xr.Dataset, values: Mapping[str, float]) -> Case:
    """The case at a place of a map (axis name -> value), as its study makes it and this cutbench computes it.

    Raises BadInput if the values do not fit one another, or the map's numerics are none of this cutbench's.
    """
    try:
        start = Case.from_dict(json.loads(data.attrs["start_case"]))
        return _by_place(start, json.loads(data.attrs["changes"]), data)(values)
    except BadInput as error:
        if not (other := other_writer(data)):
            raise
        raise BadInput(
            file=data.encoding.get("source"), key=error.key, value=error.value,
            expected=f"{error.expected}; {other} wrote this map and can compute more of it, this one cannot:"
            " sweep its study again",
        ) from error  # fmt: skip


def physics_by_place(data: xr.Dataset) -> Callable[[Mapping[str, float]], Physics]:
    """Laws and values by place of a map, whatever version and numerics it is of. Raises BadInput."""
    stored = json.loads(data.attrs["start_case"])
    changes = {k: v for k, v in json.loads(data.attrs["changes"]).items() if k not in stored["numerics"]}
    return _by_place(Physics.from_dict(stored), changes, data)


def other_writer(data: xr.Dataset) -> str:
    """What wrote a map, in words, if that was another computation than this process's; else empty."""
    here = computation_here(json.loads(data.attrs["base_case"])["mechanisms"])
    return "" if data.attrs["computation"] == here else computed_by(data)


def computed_by(data: xr.Dataset) -> str:
    """What computed a map, in words."""
    return written_by(data.attrs["cutbench"], data.attrs["computation"])


def remarks(data: xr.Dataset) -> list[str]:
    """What to know of a map before runs computed now are held against it, in sentences."""
    other = other_writer(data)
    return [f"The map is by {other}: it holds for that, and runs computed now are of another."] * bool(other)


def _by_place(
    start: Startable, changes: Mapping[str, object], data: xr.Dataset
) -> Callable[[Mapping[str, float]], Startable]:
    axes = [axis_of(data, name) for name in axes_of(data)]
    return lambda values: case_at(start, changes, axes, [short(values[axis.name]) for axis in axes])
