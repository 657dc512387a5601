"""From the columns of a file to repetitions in internal units: stretch, nominal stress, traction, time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.units import parse_quantity
from cutbench.data.experiment import HOMOGENEOUS, area_of
from cutbench.data.repetition import Repetition, first_return
from cutbench.data.table import Table


def repetitions_of(
    table: Table, kind: str, label: str | None, written: Mapping, specimen: Mapping[str, float],
    speed: float | None, factors: Mapping[str, float],
) -> list[Repetition]:  # fmt: skip
    """The repetitions in one file, in internal units."""
    columns = {role: factors.get(role, 1.0) * values for role, values in table.columns.items()}
    names = np.array(table.labels if table.labels is not None else ["1"] * table.lines.size)
    found = []
    for name in dict.fromkeys(names):
        here = {role: values[names == name] for role, values in columns.items()}
        title = str(name) if label is None else label if table.labels is None else f"{label}/{name}"
        file, lines = str(table.path), table.lines[names == name]
        x, y = _abscissa(here, kind, specimen, speed), _ordinate(here, kind, specimen)
        if kind in HOMOGENEOUS and written.get("stress", "nominal") == "cauchy":
            y = y / np.where(x > 0, x, np.nan)
        pressure = here.get("pressure")
        if "normal_force" in here:
            pressure = here["normal_force"] / area_of(kind, specimen)
        time = here.get("time")
        keep = _until(written, kind, x)
        if time is None and speed is not None and not (kind == "cut" and first_return(x) is not None):
            way = np.cumsum(np.append(abs(x[0] - (kind in HOMOGENEOUS)), np.abs(np.diff(x))))
            # Equal abscissas, as coarse sensors give them, need times that differ.
            time = (way + 1e-9 * way[-1] * np.arange(x.size)) / speed
        time, pressure = (None if a is None else a[keep] for a in (time, pressure))
        found.append(Repetition(x[keep], y[keep], time, title, pressure, file, lines[keep]))
    return found


def _abscissa(here: Mapping, kind: str, specimen: Mapping[str, float], speed: float | None) -> np.ndarray:
    if "stretch" in here:
        return here["stretch"]
    if "strain" in here:
        return 1 + here["strain"]
    if "displacement" in here:
        u = here["displacement"]
        return 1 + u / specimen["length"] if kind in HOMOGENEOUS else u
    if speed is None:
        expected = "the sliding speed, or a column of displacement"
        raise BadInput(key="speed", value="(missing)", expected=expected)
    return speed * (here["time"] - here["time"][0])


def _ordinate(here: Mapping, kind: str, specimen: Mapping[str, float]) -> np.ndarray:
    if "stress" in here:
        return here["stress"]
    return here["force"] if kind == "cut" else here["force"] / area_of(kind, specimen)


def _until(written: Mapping, kind: str, x: np.ndarray) -> slice:
    """Readings up to the first beyond ``until``."""
    if "until" not in written:
        return slice(None)
    limit = parse_quantity(written["until"], "1" if kind in HOMOGENEOUS else "mm", key="until")
    beyond = np.flatnonzero(x > limit)
    return slice(int(beyond[0]) if beyond.size else None)
