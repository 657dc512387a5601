"""``map.html``: a map as one page that needs no network; a point shows its curve and its force split."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import to_hex

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import COLOURS
from cutbench.base.files import replacing
from cutbench.base.greek import plain_formula, plain_symbol
from cutbench.case.case import Case
from cutbench.case.physics import Physics
from cutbench.maps.boundary_line import shown_strips
from cutbench.maps.dataset import LABELS, NUMBERS, OUTCOME_FLAGS, axes_of, axis_of, places_of
from cutbench.maps.map_cases import computed_by, physics_by_place
from cutbench.maps.page_curves import MAX_CURVE_POINTS, curve_of, titles_of
from cutbench.maps.page_layers import layers_of
from cutbench.maps.plot_coordinates import DROP_COLOURS
from cutbench.run.measures import NOTED
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

#: Of more runs than these the curves have half the points.
_MAX_RUNS_IN_DETAIL = 300
#: Parts of the page in the order in which its script has them.
_SCRIPTS = ("plot.js", "map.js", "detail.js", "page.js")
#: Numbers of a run whose names alone do not tell them apart.
_TITLES = {
    "drop_rel": "force drop",
    "peak_mm": "peak at",
    "max_N": "largest force",
    "steady_N": "steady force",
    "crossed_mm": "crossed from",
    "crossed_mm2": "crossed area",
    "snap_rel": "work in jumps",
}


def save_page(data: xr.Dataset, store: Store | None, folder: str | Path) -> Path:
    """Write ``map.html`` into ``folder``; curves come from ``store``, and are missing without one."""
    target = Path(folder) / "map.html"
    with replacing(target) as draft:
        draft.write_text(page(data, store), encoding="utf-8")
    return target


def page(data: xr.Dataset, store: Store | None) -> str:
    """The whole page as HTML, its data, its style and its script in it."""
    # "</script>" in a title must not end the script.
    content = json.dumps(contents(data, store), separators=(",", ":"), ensure_ascii=False)
    title = data.attrs["title"].replace("&", "&amp;").replace("<", "&lt;")
    parts = {
        "__TITLE__": title,
        "__STYLE__": web("page.css"),
        "__DATA__": content.replace("<", "\\u003c"),
        "__SCRIPT__": "".join(map(web, _SCRIPTS)),
    }
    return re.sub("|".join(parts), lambda match: parts[match[0]], web("page.html"))


def web(name: str) -> str:
    """A part of the page as the package has it."""
    return resources.files("cutbench.maps").joinpath("web", name).read_text(encoding="utf-8")


def contents(data: xr.Dataset, store: Store | None) -> dict:
    """What the page shows, as plain data: axes, layers, runs and materials with their numbers and curves."""
    names, runs = axes_of(data), _runs(data)
    results = [store.get(run.id) if store is not None and run.id else None for run in runs]
    most = MAX_CURVE_POINTS if len(runs) <= _MAX_RUNS_IN_DETAIL else MAX_CURVE_POINTS // 2
    curves = [curve_of(result, most) if result else None for result in results]
    quantities, values = _quantities(data, runs, results)
    numbers = [name for name in NUMBERS if name in data]
    shown = [data.attrs[f"plot_{which}"] for which in ("x", "y", "panel")]
    entries = list(dict.fromkeys(name for curve in curves if curve for name in curve["split"]))
    return {
        "title": data.attrs["title"],
        "by": [f"Computed by {computed_by(data)}."],
        "axes": [_axis(data, name, np.unique(places_of(data)[name])) for name in names],
        "x": names.index(shown[0]),
        "y": names.index(shown[1]) if shown[1] else -1,
        "numbers": [_number(name) for name in numbers],
        "threshold": float(data.attrs["drop_threshold"]),
        "surge": _short(data.attrs["surge_threshold"]),
        "gridded": list(data["label"].dims) == names,
        "sought": "margin" in data,
        "points": [
            run.plain(names, numbers) | {"values": own, "curve": curve, "closure": _closure(result)}
            for run, own, curve, result in zip(runs, values, curves, results, strict=True)
        ],
        "quantities": quantities,
        "layers": layers_of(data),
        "strips": shown_strips(data),
        "entries": [{"name": name, "title": title} for name, title in titles_of(entries).items()],
        "colours": [colour for name, colour in COLOURS.items() if name != "black"],
        "drops": [to_hex(DROP_COLOURS(k / 16)) for k in range(17)],
        "error": max((curve["error"] for curve in curves if curve), default=None),
    }


@dataclass(frozen=True)
class _Run:
    """One run of a map, or the own run of a marked material: ``mark`` is its name, ``differs`` in what it is
    not the map's. ``columns`` are the map's variables there; without a run (``id`` is empty) it has none."""

    id: str
    at: Mapping[str, float]
    columns: Mapping[str, Any]
    mark: str = ""
    differs: str = ""

    def plain(self, names: list[str], numbers: list[str]) -> dict:
        """For the page: places by axis, measures in the order of ``numbers``."""
        told = self.columns
        return {
            "id": self.id or f"mark-{self.mark}",
            "mark": self.mark,
            "differs": plain_formula(self.differs),
            "at": [_short(self.at[name]) for name in names],
            "label": LABELS[int(told["label"])] if told else "",
            "outcome": OUTCOME_FLAGS[int(told["outcome"])] if told else "",
            "reached": _short(told["reached_mm"]) if told else None,
            "message": str(told["message"]) if told else "",
            "measures": [_short(told.get(name, math.nan)) for name in numbers],
        }


def _runs(data: xr.Dataset) -> list[_Run]:
    """All runs, then the marked materials."""
    places, found = places_of(data), []
    known = [n for n in (*NUMBERS, "label", "outcome", "reached_mm", "message", "run_id") if n in data]
    columns = {name: data[name].values for name in known}
    for index in np.argwhere(columns["run_id"] != ""):
        i = tuple(index)
        at = {name: float(values[i]) for name, values in places.items()}
        found.append(_Run(str(columns["run_id"][i]), at, {name: v[i] for name, v in columns.items()}))
    for mark in json.loads(data.attrs["marks"]):
        at = {name: float(mark[name]) for name in places}
        if "mark" in data.coords and mark["name"] in data["mark"].values:
            own = data.sel(mark=mark["name"])
            told = {name: own[f"mark_{name}"].item() for name in known if f"mark_{name}" in data}
            found.append(_Run(told["run_id"], at, told, mark["name"], str(own["mark_differs"].item())))
        else:
            found.append(_Run("", at, {}, mark["name"]))
    return found


def _number(name: str) -> dict:
    unit, text = NUMBERS[name]
    title = _TITLES.get(name, re.sub(r"_(rel|mm2?|N|mJ|N_per_mm)$", "", name).replace("_", " "))
    return {"name": name, "title": title, "unit": unit, "text": text, "noted": name in NOTED}


def _axis(data: xr.Dataset, name: str, values: np.ndarray) -> dict:
    axis = axis_of(data, name)
    return {
        "name": name,
        "text": axis.long_name,
        "symbol": plain_symbol(axis.symbol),
        "unit": "" if axis.unit == "1" else axis.unit,
        "log": axis.scale == "log",
        "switch": bool(axis.mechanism),
        "values": [_short(v) for v in (axis.values if list(data[name].dims) == [name] else values)],
    }


def _quantities(
    data: xr.Dataset, runs: list[_Run], results: list[Result | None]
) -> tuple[list[dict], list[list[tuple[float | None, float | None]]]]:
    """The groups of the runs' laws with the parameter that each of them sets, and the other parameters that
    they are made of; and by run, group and parameter of those that are not the same everywhere. Nothing where
    places stand for no physics."""
    try:
        by_place = physics_by_place(data)
    except BadInput:
        return [], [[] for _ in runs]
    physics: list[Physics | Case | None] = []
    for run, result in zip(runs, results, strict=True):
        try:
            physics.append(result.case if result else by_place(run.at) if not run.mark else None)
        except BadInput:
            physics.append(None)
    models = {p.model for p in physics if p is not None}
    known = {n: q for model in models for n, q in model.parameters().items()}
    made = {n: g for model in models for n, g in model.settable_groups().items()}
    told = {n: (plain_symbol(g.symbol), g.unit, known[g.parameter]) for n, g in made.items()}
    # What groups are made of and none sets: without it they are no values.
    scales = {n for g in made.values() for n in g.needs} - {g.parameter for g in made.values()}
    told |= {n: (plain_symbol(q.symbol), q.unit, q) for n, q in known.items() if n in scales}
    found, columns = [], []
    for name, (symbol, unit, parameter) in told.items():
        pairs = [_pair(p, name) for p in physics]
        alike = len(set(pairs)) == 1
        found.append(
            {
                "name": name,
                "symbol": symbol,
                "unit": "" if unit == "1" else unit,
                "sets": plain_symbol(parameter.symbol),
                "text": parameter.doc,
                "in": "" if parameter.unit == "1" else parameter.unit,
                "fixed": pairs[0] if alike else None,
            }
        )
        if not alike:
            columns.append(pairs)
    return found, [list(row) for row in zip(*columns, strict=True)] or [[] for _ in runs]


def _pair(physics: Physics | Case | None, name: str) -> tuple[float | None, float | None]:
    if physics is None:
        return None, None
    if name not in (known := physics.model.settable_groups()):
        if name not in physics.values:
            return None, None
        own = _short(physics.values[name] / physics.model.parameters()[name].factor)
        return own, own
    group = known[name]
    factor = physics.model.parameters()[group.parameter].factor
    return _short(group.value(physics.p)), _short(physics.values[group.parameter] / factor)


def _closure(result: Result | None) -> float | None:
    return None if result is None else _short(result.measures.get("closure", math.nan))


def _short(value: float) -> float | None:
    """Four digits; None, JSON's null, for what is not a number."""
    value = float(value)
    return float(f"{value:.4g}") if math.isfinite(value) else None
