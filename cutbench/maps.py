"""A study's runs as one labelled array: what ``map.nc`` and ``map.csv`` hold and phase diagrams show."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from cutbench.curve import ABRUPT, MEASURES, SMOOTH, UNCUT, label, measures
from cutbench.errors import BadInput
from cutbench.result import OUTCOMES, Result

if TYPE_CHECKING:
    from cutbench.study import Study

NOT_COMPUTED = "not_computed"
#: Values of the variable ``label``: position in this tuple.
LABELS = (NOT_COMPUTED, SMOOTH, ABRUPT, UNCUT)
#: Values of the variable ``outcome``; 0 where no run has ended yet.
OUTCOME_FLAGS = ("missing", *OUTCOMES)


@dataclass(frozen=True)
class Row:
    """One point of a map. Only a run that reached its depth has measures and a regime."""

    outcome: str = "missing"
    message: str = ""
    reached_mm: float = math.nan
    label: str = NOT_COMPUTED
    measures: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(MEASURES, math.nan))


def row_of(result: Result, study: Study) -> Row:
    """What a map keeps of a run. The measures come from the curve, not from what the run noted:
    a study's own thresholds hold for runs that an earlier study left in the store."""
    outcome = result.outcome
    if not outcome.done:
        return Row(outcome.kind, outcome.message, outcome.reached_mm)
    try:
        found = measures(
            result.curve, window_mm=result.case.p.thickness, onset_length_mm=study.onset_length_mm
        )
    except (ValueError, KeyError) as error:
        return Row("failed", f"the curve cannot be read: {error}", outcome.reached_mm)
    regime = label(found["drop_rel"], found["surge"], drop=study.drop, surge_min=study.surge_min)
    return Row(outcome.kind, outcome.message, outcome.reached_mm, regime, found)


def build_map(study: Study, rows: Mapping[str, Row]) -> xr.Dataset:
    """The map with the study's axes as dimensions; ``rows`` by run id, as far as there are any."""
    dims = [axis.name for axis in study.axes]
    ids = np.full(study.shape, "", dtype=object)
    table = np.full(study.shape, None, dtype=object)
    for index, case in study.points():
        ids[index] = case.id
        table[index] = rows.get(case.id, Row())

    def collect(pick, dtype):
        flat = [pick(row) for row in table.ravel()]
        return dims, np.array(flat, dtype=dtype).reshape(study.shape)

    data = {
        name: (*collect(lambda row, name=name: row.measures[name], float), {"units": unit, "long_name": text})
        for name, (unit, text) in MEASURES.items()
    }
    data["label"] = (*collect(lambda row: LABELS.index(row.label), np.int8), _flags(LABELS, "regime"))
    data["outcome"] = (
        *collect(lambda row: OUTCOME_FLAGS.index(row.outcome), np.int8),
        _flags(OUTCOME_FLAGS, "how the run ended"),
    )
    data["reached_mm"] = (
        *collect(lambda row: row.reached_mm, float),
        {"units": "mm", "long_name": "blade travel reached"},
    )
    data["message"] = (
        *collect(lambda row: row.message, object),
        {"long_name": "what the run said at its end"},
    )
    data["run_id"] = (dims, ids, {"long_name": "hash of the run's inputs; its folder in the store"})
    coords = {
        axis.name: (
            axis.name,
            np.array(axis.values),
            {"units": axis.unit, "long_name": axis.long_name, "symbol": axis.symbol, "scale": axis.scale},
        )
        for axis in study.axes
    }
    return xr.Dataset(
        data,
        coords,
        {
            "title": study.title,
            "study": study.text,
            "base_case": json.dumps(study.base.to_dict(), default=str),
            "drop_threshold": study.drop,
            "surge_threshold": math.nan if study.surge_min is None else study.surge_min,
            "onset_length_mm": study.onset_length_mm,
            "window": "blade thickness",
            "plot_x": study.plot.x,
            "plot_y": study.plot.y,
            "plot_panel": study.plot.panel,
            "marks": json.dumps([{"name": m.name} | dict(m.at) for m in study.marks()]),
        },
    )


def load_map(path: str | os.PathLike[str]) -> xr.Dataset:
    """A map from ``map.nc``; BadInput if the file is not there or is none."""
    try:
        with xr.open_dataset(path, engine="h5netcdf") as file:
            data = file.load()
    except (OSError, ValueError) as error:
        raise BadInput(key="map", value=str(path), expected=f"a map.nc of a sweep ({error})") from error
    if "label" not in data or "plot_x" not in data.attrs:
        raise BadInput(key="map", value=str(path), expected="a map.nc of a sweep, with labels and axes")
    return data


def save_map(data: xr.Dataset, folder: Path) -> None:
    """Write ``map.nc`` and ``map.csv`` into ``folder``, each whole or not at all."""
    handle, name = tempfile.mkstemp(prefix=".map-", suffix=".nc", dir=folder)
    os.close(handle)
    try:
        data.to_netcdf(name, engine="h5netcdf")
        _move(name, folder / "map.nc")
    finally:
        Path(name).unlink(missing_ok=True)
    handle, name = tempfile.mkstemp(prefix=".map-", suffix=".csv", dir=folder)
    try:
        with open(handle, "w", encoding="utf-8", newline="") as file:
            file.write(to_csv(data))
        _move(name, folder / "map.csv")
    finally:
        Path(name).unlink(missing_ok=True)


def to_csv(data: xr.Dataset) -> str:
    """One line a point, axes first (the unit in the header), the same for the same runs."""
    dims = list(data["label"].dims)
    heads = [
        name if data[name].attrs["units"] == "1" else f"{name} [{data[name].attrs['units']}]" for name in dims
    ]
    columns = ["label", *MEASURES, "outcome", "reached_mm", "run_id", "message"]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*heads, *columns])
    for index in np.ndindex(data["label"].shape):
        line = [f"{data[dim].values[i]:.10g}" for dim, i in zip(dims, index, strict=True)]
        for name in columns:
            value = data[name].values[index]
            if name == "label":
                line.append(LABELS[int(value)])
            elif name == "outcome":
                line.append(OUTCOME_FLAGS[int(value)])
            elif name in ("run_id", "message"):
                line.append(str(value))
            else:
                line.append("" if math.isnan(value) else f"{value:.10g}")
        writer.writerow(line)
    return out.getvalue()


def _flags(names: tuple[str, ...], text: str) -> dict[str, object]:
    return {
        "units": "1",
        "long_name": text,
        "flag_values": np.arange(len(names), dtype=np.int8),
        "flag_meanings": " ".join(names),
    }


def _move(name: str, target: Path) -> None:
    mask = os.umask(0)
    os.umask(mask)
    os.chmod(name, 0o666 & ~mask)  # mkstemp lets only its owner read
    os.replace(name, target)
