"""``map.html``: a map as one page that needs no network; a point shows its curve and its force split."""

from __future__ import annotations

import json
import math
from importlib import resources
from pathlib import Path

import numpy as np
import xarray as xr

from cutbench.base.figure_style import COLOURS
from cutbench.base.files import replacing
from cutbench.maps.dataset import LABELS, OUTCOME_FLAGS, axes_of, axis_of, places_of
from cutbench.run.figures.curve import smooth_force
from cutbench.run.measures import MEASURES, forward
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

#: Points that a curve is thinned to; it stays within a pixel or so of itself.
_POINTS = 60
#: What the shares of mechanisms, which are means over a stretch of travel, leave of the force at a point.
REST = "rest"
#: Levels of an estimated map along a third axis and more: the page would grow by each of them.
_LEVELS = 17


def save_page(data: xr.Dataset, store: Store | None, folder: str | Path) -> Path:
    """Write ``map.html`` into ``folder``; curves come from ``store``, and are missing without one."""
    target = Path(folder) / "map.html"
    with replacing(target) as draft:
        draft.write_text(page(data, store), encoding="utf-8")
    return target


def page(data: xr.Dataset, store: Store | None) -> str:
    """The whole page as HTML, its data and its script in it."""
    template = page_template()
    # "</script>" in a title must not end the script.
    content = json.dumps(contents(data, store), separators=(",", ":")).replace("<", "\\u003c")
    title = data.attrs["title"].replace("&", "&amp;").replace("<", "&lt;")
    return template.replace("__TITLE__", title).replace("__DATA__", content)


def page_template() -> str:
    """The page without its data."""
    return resources.files("cutbench.maps").joinpath("page.html").read_text(encoding="utf-8")


def contents(data: xr.Dataset, store: Store | None) -> dict:
    """What the page shows, as plain data: axes, points with measures and curves, the estimated boundary."""
    names = axes_of(data)
    places = places_of(data)
    points = []
    for index in np.argwhere(data["run_id"].values != ""):
        here = tuple(index)
        id = str(data["run_id"].values[here])
        result = store.get(id) if store is not None else None
        points.append(
            {
                "id": id,
                "at": [_short(places[name][here]) for name in names],
                "label": LABELS[int(data["label"].values[here])],
                "outcome": OUTCOME_FLAGS[int(data["outcome"].values[here])],
                "message": str(data["message"].values[here]),
                "measures": {name: _short(data[name].values[here]) for name in MEASURES if name in data},
            }
            | ({} if result is None else {"curve": curve_of(result)})
        )
    shown = [data.attrs[f"plot_{which}"] for which in ("x", "y", "panel")]
    return {
        "title": data.attrs["title"],
        "axes": [_axis(data, name, np.unique(places[name])) for name in names],
        "x": names.index(shown[0]),
        "y": names.index(shown[1]) if shown[1] else -1,
        "units": {name: unit for name, (unit, _) in MEASURES.items()},
        "threshold": data.attrs["drop_threshold"],
        "points": points,
        "gridded": list(data["label"].dims) == names,
        "marks": [
            {"name": mark["name"], "at": [_short(mark[name]) for name in names]}
            for mark in json.loads(data.attrs["marks"])
        ],
        "field": _field(data, names, shown) if "margin" in data else None,
        "colours": list(COLOURS.values()),
    }


def _axis(data: xr.Dataset, name: str, values: np.ndarray) -> dict:
    axis = axis_of(data, name)
    return {
        "name": name,
        "text": axis.long_name,
        "unit": "" if axis.unit == "1" else axis.unit,
        "log": axis.scale == "log",
        "continuous": axis.continuous,
        "values": [_short(v) for v in (axis.values if list(data[name].dims) == [name] else values)],
    }


def _field(data: xr.Dataset, names: list[str], shown: list[str]) -> dict:
    """The estimated margin and its uncertainty, thinned along the axes that are walked by sliders."""
    pick = {
        name: np.unique(np.rint(np.linspace(0, data.sizes[name] - 1, _LEVELS)).astype(int))
        for name in names
        if name not in shown[:2] and data.sizes[name] > _LEVELS
    }
    if len(names) > 2:
        for name in shown[:2]:
            if name and data.sizes[name] > 2 * _LEVELS:
                pick[name] = np.arange(0, data.sizes[name], 2)
    part = data[["margin", "margin_sd"]].isel(pick).transpose(*names)
    return {
        "values": [[_short(v) for v in part[name].values] for name in names],
        "margin": np.round(part["margin"].values, 3).ravel().tolist(),
        "sd": np.round(part["margin_sd"].values, 3).ravel().tolist(),
    }


def curve_of(result: Result) -> dict:
    """Travel and force, thinned, and the force by mechanism at the same points until the blade first rests.

    A mechanism's share is the mean over half a blade's thickness of travel, as in ``curve.png``; what such
    means and the energy balance leave of the force is ``REST``, so that at each point all of it is the force.
    """
    d, force = result.displacement_mm, result.force_N
    keep = thinned(d, force, _POINTS)
    down = forward(d)
    at, travel = d[keep[keep < down]], d[:down]
    window = result.case.values.get("thickness", 0.7) / 2
    shares = {}
    for name in result.ledger:
        steps = result.curve.get(f"force_{name}_N")
        if steps is not None and at.size > 1 and np.any(steps[:down]):
            # A mechanism's force is the mean over a step: the work is its sum over steps.
            work = np.concatenate([[0.0], np.cumsum(np.diff(travel) * steps[1:down])])
            shares[name] = smooth_force(travel, work, window, at)
    if shares:
        shares[REST] = force[keep[keep < down]] - sum(shares.values())
    return {
        "d": [_short(v) for v in d[keep]],
        "force": [_short(v) for v in force[keep]],
        "split": {name: [_short(v) for v in share] for name, share in shares.items()},
    }


def thinned(x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most ``count`` points of a polygon that stay closest to it (Douglas & Peucker 1973)."""
    if x.size <= count:
        return np.arange(x.size)
    scale = max(float(np.ptp(y)), 1e-300)
    kept = [0, x.size - 1]
    spans = [_farthest(x, y / scale, 0, x.size - 1)]
    while len(kept) < count and spans:
        best = max(range(len(spans)), key=lambda k: spans[k][0])
        error, first, middle, last = spans.pop(best)
        if error <= 0:
            break
        kept.append(middle)
        spans += [_farthest(x, y / scale, *ends) for ends in ((first, middle), (middle, last))]
    return np.array(sorted(kept))


def _farthest(x: np.ndarray, y: np.ndarray, first: int, last: int) -> tuple[float, int, int, int]:
    if last - first < 2:
        return 0.0, first, first, last
    inner = slice(first + 1, last)
    run = x[last] - x[first]
    part = (x[inner] - x[first]) / run if run > 0 else np.zeros(last - first - 1)
    away = np.abs(y[inner] - (y[first] + part * (y[last] - y[first])))
    k = int(np.argmax(away))
    return float(away[k]), first, first + 1 + k, last


def _short(value: float) -> float | None:
    """Four digits; None, JSON's null, for what is not a number."""
    value = float(value)
    return float(f"{value:.4g}") if math.isfinite(value) else None
