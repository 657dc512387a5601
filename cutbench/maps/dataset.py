"""A study's runs as one labelled array: what ``map.nc`` and ``map.csv`` hold and phase diagrams show; and
what its places stand for: laws and values whatever wrote it, and cases where this cutbench can."""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.base.files import csv_text, replacing, write_text
from cutbench.base.versions import versions, written_by
from cutbench.case.case import Case
from cutbench.case.computation import computation_here
from cutbench.case.physics import Physics
from cutbench.case.values import parameter_of
from cutbench.maps.axes import Axis, short
from cutbench.maps.boundary import BoundaryEstimate, levels_of, margin
from cutbench.maps.marked_materials import Mark
from cutbench.maps.regimes import AT_REST, KIND, KINDS, rest_variables
from cutbench.maps.study import Startable, Study, case_at
from cutbench.maps.study_sections import Regime
from cutbench.maps.uncertainty import (
    CAUSES,
    RATIOS,
    RepeatedRuns,
    log_ratio,
    total_change,
    uncertainty_strips,
    uncertainty_variables,
    undecided,
)
from cutbench.run.measures import ABRUPT, MEASURES, NOTED, SMOOTH, UNCUT, UNDECIDED
from cutbench.run.result import OUTCOMES, Result

NOT_COMPUTED = "not_computed"
#: Values of the variable ``label``: position in this tuple.
LABELS = (NOT_COMPUTED, SMOOTH, ABRUPT, UNCUT, UNDECIDED)
#: Values of the variable ``outcome``; 0 where no run has ended yet.
OUTCOME_FLAGS = ("missing", *OUTCOMES)
#: Variables that are numbers of runs, with unit and meaning.
NUMBERS = MEASURES | NOTED
#: The attribute of a map that is estimated, in all or where there are no runs yet: pictures say it.
ESTIMATE = "estimate"
_RUN_ID = "hash of the run's inputs; its folder in the store"


@dataclass(frozen=True)
class MapRow:
    """One point of a map. Only a run that reached its depth has measures and a regime."""

    outcome: str = "missing"
    message: str = ""
    reached_mm: float = math.nan
    label: str = NOT_COMPUTED
    measures: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(NUMBERS, math.nan))

    def margin(self, regime: Regime) -> float:
        """Against the thresholds of a study; nan if the run did not end well, or is not cut at its depth."""
        if self.outcome != "done":
            return math.nan
        drop_rel, surge = (np.array(self.measures[name]) for name in ("drop_rel", "surge"))
        least = math.nan if regime.surge_min is None else regime.surge_min
        uncut = np.array(self.label == UNCUT)
        return float(margin(drop_rel, surge, uncut, drop=regime.drop, surge_min=least))


def row_of(result: Result, regime: Regime) -> MapRow:
    """What a map keeps of a run. The measures come from the curve, not from what the run noted:
    a study's own thresholds hold for runs that an earlier study left in the store."""
    outcome = result.outcome
    if not outcome.done:
        return MapRow(outcome.kind, outcome.message, outcome.reached_mm)
    try:
        label, measures = regime.of(result)
    except (ValueError, KeyError) as error:
        return MapRow("failed", f"the curve cannot be read: {error}", outcome.reached_mm)
    noted = {name: result.measures.get(name, math.nan) for name in NOTED}
    return MapRow(outcome.kind, outcome.message, outcome.reached_mm, label, {**measures, **noted})


def build_map(
    study: Study,
    rows: Mapping[str, MapRow],
    ids: Mapping[tuple[int, ...], str] | None = None,
    estimates: Mapping[tuple[int, ...], BoundaryEstimate] | None = None,
    rest: Mapping[str, str] | None = None,
    checks: RepeatedRuns | None = None,
) -> xr.Dataset:
    """Put the runs of a study together into a map, as ``map.nc`` has it, with units in the attributes. Its
    dimensions are the study's axes, or ``point`` where the runs do not lie on a grid.

    ``rows`` are the runs by their ids as far as they are known, ``ids`` those by index (the study's grid
    unless said), ``rest`` the run at rest of each. ``estimates`` are those of a search for the boundary, by
    the indices of the levels; ``checks`` is what was repeated to see how far the line may be off: within
    that labels are undecided."""
    dims = [axis.name for axis in study.axes] if study.on_grid else ["point"]
    table_ids = np.full(study.shape, "", dtype=object)
    table = np.full(study.shape, MapRow(), dtype=object)
    for index, id in (ids or {index: case.id for index, case in study.points()}).items():
        table_ids[index] = id
        table[index] = rows.get(id, MapRow())

    data = _columns(table, dims)
    data["run_id"] = dims, table_ids.astype(str), {"long_name": _RUN_ID}
    if not study.on_grid:
        samples = np.array(study.samples, dtype=float).reshape(-1, len(study.axes))
    coords: dict[str, tuple] = {
        axis.name: (
            axis.name if study.on_grid else "point",
            np.array(axis.values) if study.on_grid else samples[:, k],
            {"units": axis.unit, "long_name": axis.long_name, "symbol": axis.symbol, "scale": axis.scale}
            | ({"mechanism": axis.mechanism} if axis.mechanism else {}),
        )
        for k, axis in enumerate(study.axes)
    }
    if rest:
        measured = {id: row.measures for id, row in rows.items()}
        at_rest = rest_variables(table_ids, rest, measured)
        data |= {name: (dims, *column) for name, column in at_rest.items()}
    if estimates:
        data |= _boundary_variables(study, estimates)
    if marks := study.marks():
        data |= _marked_runs(marks, rows)
        coords["mark"] = "mark", [mark.name for mark in marks], {"long_name": "marked material"}
    whole = xr.Dataset(data, coords, _about(study))
    return with_strips(whole, checks, rows) if checks and (checks.refined or checks.alternatives) else whole


def _about(study: Study) -> dict[str, object]:
    """Attributes of a map: all of its study, so that the map can be read without it."""
    return {
        "title": study.title,
        "mode": study.mode,
        "axes": json.dumps([axis.name for axis in study.axes]),
        "continuous": json.dumps([axis.name for axis in study.axes if axis.continuous]),
        "tolerance": json.dumps({a.name: a.tolerance for a in study.axes if math.isfinite(a.tolerance)}),
        "study": study.text,
        "base_case": json.dumps(study.base.to_dict(), default=str),
        ESTIMATE: "",
        "cutbench": versions()["cutbench"] or "",
        "computation": study.base.computation,
        "start_case": json.dumps((study.start or study.base).to_dict(), default=str),
        "changes": json.dumps(dict(study.changes), default=str),
        "drop_threshold": study.regime.drop,
        "surge_threshold": math.nan if study.regime.surge_min is None else study.regime.surge_min,
        "onset_length_mm": math.nan if study.regime.onset_length_mm is None else study.regime.onset_length_mm,
        "window": "blade thickness",
        "plot_x": study.plot.x,
        "plot_y": study.plot.y,
        "plot_panel": study.plot.panel,
        "marks": json.dumps([{"name": m.name} | dict(m.at) for m in study.marks()]),
    }


def with_strips(data: xr.Dataset, checks: RepeatedRuns, rows: Mapping[str, MapRow]) -> xr.Dataset:
    """A map with what was repeated of it, and labels undecided where that leaves either."""
    regime, decided = regime_of(data), (LABELS.index(SMOOTH), LABELS.index(ABRUPT))
    r = {id: log_ratio(row.margin(regime)) for id, row in rows.items()}
    ids = data["run_id"].values
    new = uncertainty_variables(checks, r, ids, [str(dim) for dim in data["run_id"].dims])
    data = data.assign(new).assign_coords(cause=list(CAUSES), end=["low", "high"])
    low, high = total_change(uncertainty_strips(data).values())
    for name, runs in (("label", "run_id"), ("mark_label", "mark_run_id")):
        if name in data:
            here = np.array([r.get(str(id), math.nan) for id in data[runs].values.ravel()])
            open_ = undecided(here, low, high).reshape(data[runs].shape) & np.isin(data[name], decided)
            data[name].values[open_] = LABELS.index(UNDECIDED)
    return data


def _columns(table: np.ndarray, dims: list[str]) -> dict[str, tuple]:
    """Variables of the ``MapRow``s of a table, shaped as it."""
    rows: list[MapRow] = list(table.ravel())
    columns: dict[str, tuple] = {
        name: ([row.measures.get(name, math.nan) for row in rows], float, {"units": unit, "long_name": text})
        for name, (unit, text) in NUMBERS.items()
    } | {
        "label": ([LABELS.index(row.label) for row in rows], np.int8, _flags(LABELS, "regime")),
        "outcome": (
            [OUTCOME_FLAGS.index(row.outcome) for row in rows], np.int8,
            _flags(OUTCOME_FLAGS, "how the run ended"),
        ),
        "reached_mm": (
            [row.reached_mm for row in rows], float, {"units": "mm", "long_name": "blade travel reached"}
        ),
        "message": ([row.message for row in rows], str, {"long_name": "what the run said at its end"}),
    }  # fmt: skip
    return {
        name: (dims, np.array(values, dtype=dtype).reshape(table.shape), about)
        for name, (values, dtype, about) in columns.items()
    }


def _marked_runs(marks: Sequence[Mark], rows: Mapping[str, MapRow]) -> dict[str, tuple]:
    """The marked materials' own runs: the variables of runs as ``mark_...`` along ``mark``."""
    table = np.empty(len(marks), dtype=object)
    table[:] = [rows.get(mark.case.id, MapRow()) for mark in marks]
    data = {f"mark_{name}": column for name, column in _columns(table, ["mark"]).items()}
    data["mark_run_id"] = ["mark"], [mark.case.id for mark in marks], {"long_name": _RUN_ID}
    text = "in what a material's own run differs from the map's at its place"
    data["mark_differs"] = ["mark"], [mark.differs for mark in marks], {"long_name": text}
    return data


def _boundary_variables(
    study: Study, estimates: Mapping[tuple[int, ...], BoundaryEstimate]
) -> dict[str, tuple]:
    """The boundary that was sought, on the map's own dimensions."""
    dims = [axis.name for axis in study.axes]
    informed = all(e.drop is not None for e in estimates.values())
    names = ("mean", "spread", "unsure", *(["drop"] if informed else []))
    arrays = {name: np.empty(study.shape) for name in names}
    for chosen, where in levels_of(study.axes):
        for name, array in arrays.items():
            array[where] = getattr(estimates[chosen], name)
    mean = "estimated margin, tanh(log(measure/threshold)): above 0 abrupt, below 0 smooth"
    sd = "standard deviation of the estimated margin"
    unsure = _flags(("sure", "unsure"), "whether the regime is unknown (95 %) beyond the tolerance")
    variables: dict[str, tuple] = {
        "margin": (dims, arrays["mean"], {"units": "1", "long_name": mean}),
        "margin_sd": (dims, arrays["spread"], {"units": "1", "long_name": sd}),
        "unsure": (dims, arrays["unsure"].astype(np.int8), unsure),
    }
    if informed:
        about = {"units": "1", "long_name": "drop_rel as it was thought to be beforehand"}
        variables["drop_rel_expected"] = dims, arrays["drop"], about
    return variables


def load_map(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read the map of a study from its file ``map.nc``.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    xarray.Dataset
        Labels, outcomes and measures of the runs over the study's axes, units in the attributes.

    Raises
    ------
    BadInput
        If the file is not there or is none.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import cutbench
    >>> from cutbench.maps import build_map, save_map
    >>> text = '''
    ... title = "Toughness"
    ... base = "gelatin"
    ... [[axis]]
    ... name = "cohesion"
    ... values = [4.0, 8.0]
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "study.toml"
    ...     _ = file.write_text(text)
    ...     save_map(build_map(cutbench.load_study(file), {}), file.parent)  # no run has ended yet
    ...     data = cutbench.load_map(file.parent / "map.nc")
    >>> data.attrs["title"], data["cohesion"].values.tolist()
    ('Toughness', [4.0, 8.0])
    """
    if not Path(path).is_file():
        sorts = ("run", "fit", "discovery", "band")
        others = [what for what in sorts if Path(path).with_name(f"{what}.json").is_file()]
        other = f"; that folder is of a {others[0]}" if others else ""
        raise BadInput("map", str(path), f"a map that exists, map.nc in the folder of a sweep{other}")
    try:
        with xr.open_dataset(path, engine="h5netcdf") as file:
            data = file.load()
    except (OSError, ValueError) as error:
        raise BadInput("map", str(path), "a map.nc of a sweep; this file is none, or broken") from error
    if "label" not in data or "plot_x" not in data.attrs:
        raise BadInput("map", str(path), "a map.nc of a sweep, with labels and axes")
    # Maps of before there were modes are grids.
    old = {"mode": "grid", "axes": json.dumps([str(dim) for dim in data["label"].dims]), "continuous": "[]"}
    old |= {"tolerance": "{}", "start_case": data.attrs["base_case"], "changes": "{}"}
    data.attrs = old | {"cutbench": "", "computation": "", ESTIMATE: ""} | data.attrs
    return data


def path_from(target: Path, folder: Path) -> str:
    """``target`` as seen from ``folder``, so that both can be moved together; absolute across drives."""
    try:
        return Path(os.path.relpath(target, folder)).as_posix()
    except ValueError:
        return target.resolve().as_posix()


def store_of(data: xr.Dataset, folder: Path) -> Path:
    """The folder of the runs of a map that lies in ``folder``."""
    return folder / data.attrs.get("store", "runs")


def axes_of(data: xr.Dataset) -> list[str]:
    """Names of a map's axes, in the study's order."""
    return list(json.loads(data.attrs["axes"]))


def regime_of(data: xr.Dataset) -> Regime:
    """What tells the regimes of a map apart."""
    surge, length = (float(data.attrs[name]) for name in ("surge_threshold", "onset_length_mm"))
    return Regime(
        float(data.attrs["drop_threshold"]), surge if math.isfinite(surge) else None,
        length if math.isfinite(length) else None,
    )  # fmt: skip


def axis_of(data: xr.Dataset, name: str) -> Axis:
    """An axis of a map, as its study had it; where runs do not lie on a grid, with its ends as values."""
    about, values = data[name].attrs, data[name].values
    if list(data[name].dims) != [name]:
        values = np.array([values.min(), values.max()]) if values.size else values
    mechanism = str(about.get("mechanism", ""))
    return Axis(
        name, str(about["units"]), str(about.get("symbol", "")), str(about["long_name"]),
        tuple(map(float, values)), str(about.get("scale", "linear")), mechanism or parameter_of(name),
        name in json.loads(data.attrs["continuous"]),
        json.loads(data.attrs["tolerance"]).get(name, math.nan), mechanism,
    )  # fmt: skip


def places_of(data: xr.Dataset) -> dict[str, np.ndarray]:
    """The value of each axis at each point of a map, shaped as the map's variables."""
    names = axes_of(data)
    if list(data["label"].dims) != names:
        return {name: data[name].values for name in names}
    return dict(zip(names, np.meshgrid(*(data[n].values for n in names), indexing="ij"), strict=True))


@dataclass(frozen=True)
class MapRun:
    """One run of a map, or the own run of a marked material: ``mark`` is its name, ``differs`` in what it is
    not the map's. ``columns`` are the map's variables there; without a run (``id`` is empty) it has none."""

    id: str
    at: Mapping[str, float]
    columns: Mapping[str, Any]
    mark: str = ""
    differs: str = ""

    @property
    def outcome(self) -> str:
        """How it ended; empty without a run."""
        return OUTCOME_FLAGS[int(self.columns["outcome"])] if self.columns else ""

    @property
    def label(self) -> str:
        """Its regime; that of none without a run."""
        return LABELS[int(self.columns["label"])] if self.columns else NOT_COMPUTED


def runs_of(data: xr.Dataset) -> list[MapRun]:
    """All runs of a map, then its marked materials."""
    places, runs = places_of(data), []
    about = ("label", "outcome", "reached_mm", "message", "run_id")
    columns = {n: data[n].values for n in (*NUMBERS, KIND, *AT_REST, *RATIOS, *about) if n in data}
    for index in map(tuple, np.argwhere(columns["run_id"] != "")):
        at = {name: float(values[index]) for name, values in places.items()}
        runs.append(MapRun(str(columns["run_id"][index]), at, {n: v[index] for n, v in columns.items()}))
    for mark in json.loads(data.attrs["marks"]):
        at, own, differs = {name: float(mark[name]) for name in places}, {}, ""
        if "mark" in data.coords and mark["name"] in data["mark"].values:
            there = data.sel(mark=mark["name"])
            own = {name: there[f"mark_{name}"].item() for name in columns if f"mark_{name}" in data}
            differs = str(there["mark_differs"].item())
        runs.append(MapRun(own.get("run_id", ""), at, own, mark["name"], differs))
    return runs


def save_map(data: xr.Dataset, folder: Path) -> None:
    """Write ``map.nc`` and ``map.csv`` into a folder that is there, each whole or not at all."""
    # A map of runs that were sought is mostly empty.
    packed = {key: {"zlib": True} for key, v in data.variables.items() if v.ndim and v.dtype.kind in "fi"}
    with replacing(folder / "map.nc") as draft:
        # In memory first: HDF5 does not survive a disk that is full.
        whole = io.BytesIO()
        data.to_netcdf(whole, engine="h5netcdf", encoding=packed)
        draft.write_bytes(whole.getbuffer())
    write_text(to_csv(data), folder / "map.csv")


def to_csv(data: xr.Dataset) -> str:
    """One line a point, axes first (the unit in the header), the same for the same runs; at the end the
    marked materials' own runs, each at its place, with its name under ``mark``."""
    dims = axes_of(data)
    units = {name: data[name].attrs["units"] for name in dims}
    heads = [name if unit == "1" else f"{name} [{unit}]" for name, unit in units.items()]
    numbers = [name for name in (*NUMBERS, KIND, *AT_REST, *RATIOS) if name in data]  # older maps have fewer
    columns = ["label", *numbers, "outcome", "reached_mm", "run_id", "message"]
    marked = ["mark"] if "mark" in data else []
    rows = [
        [*(f"{run.at[name]:.10g}" for name in dims),
         *(_cell(name, run.columns[name]) if name in run.columns else "" for name in columns),
         *([run.mark] if marked else [])]
        for run in runs_of(data) if run.columns
    ]  # fmt: skip
    return csv_text([*heads, *columns, *marked], rows)


def _cell(name: str, value) -> str:
    if name in (words := {"label": LABELS, "outcome": OUTCOME_FLAGS, KIND: KINDS}):
        return words[name][int(value)]
    if name in ("run_id", "message"):
        return str(value)
    return "" if math.isnan(value) else f"{value:.10g}"


def _flags(names: tuple[str, ...], text: str) -> dict[str, object]:
    return {
        "units": "1",
        "long_name": text,
        "flag_values": np.arange(len(names), dtype=np.int8),
        "flag_meanings": " ".join(names),
    }


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
