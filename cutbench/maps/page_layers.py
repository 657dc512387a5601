"""What lies behind the points of ``map.html``: the drop, the chance of abrupt cutting, and the boundary."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.maps.axes import Axis
from cutbench.maps.closed_form_estimates import estimated_margin
from cutbench.maps.dataset import LABELS, axes_of, axis_of
from cutbench.maps.guidance import MapReader
from cutbench.maps.plot_coordinates import SMALLEST_IN_LOG, between
from cutbench.run.measures import UNCUT

#: Levels of an estimate along an axis that is walked by a slider; points along those that are shown.
LEVELS, FINE = 17, 41
#: Points of the classical estimates along an axis that is shown.
_ESTIMATED_POINTS = 13
#: Points of an estimate at the most: the page grows by each of them.
_MAX_POINTS = 60_000
#: Numbers of a layer are thousandths.
PER = 1000


def layers_of(data: xr.Dataset) -> dict[str, dict]:
    """Layers by name, each with the ``values`` of all axes and whole thousandths in their order, nulls where
    nothing is known. Of runs that lie on no grid there are none.

    ``drop``: the relative force drop, of a sought boundary's map between its runs. ``chance``: ``margin`` and
    its standard deviation ``sd`` by the Gaussian process through all runs. ``line``, of a grid: 0 on the
    boundary between the runs; where it was sought, that is where the margin is 0. ``classical``: 0 on the
    boundary of the classical estimates, where these have one.
    """
    if list(data["label"].dims) != axes_of(data):
        return {}
    if "margin" in data:
        part = _thinned(data)
        return {
            "drop": _layer(part, z=between(data, "drop_rel").isel(_pick(data))),
            "chance": _layer(part, margin=part["margin"], sd=part["margin_sd"]),
        } | _classical(data)
    found = {"drop": _layer(data, z=data["drop_rel"]), "line": _layer(data, z=_line(data))}
    if (chance := _chance(data)) is not None:
        found["chance"] = chance
    return found | _classical(data)


def _line(data: xr.Dataset) -> xr.DataArray:
    """The logarithm of measure over threshold: it keeps a steep drop from pushing the line aside."""
    with np.errstate(divide="ignore", invalid="ignore"):
        over = data["drop_rel"] / data.attrs["drop_threshold"]
        if math.isfinite(data.attrs["surge_threshold"]):
            over = np.minimum(over, data["surge"] / data.attrs["surge_threshold"])
        over = xr.where(data["label"] == LABELS.index(UNCUT), np.nan, over)
        return np.log(np.maximum(over, SMALLEST_IN_LOG))


def _pick(data: xr.Dataset) -> dict[str, np.ndarray]:
    """What is kept of a lattice of runs that were sought."""
    shown = [name for name in (data.attrs["plot_x"], data.attrs["plot_y"]) if name]
    pick = {
        name: np.unique(np.rint(np.linspace(0, data.sizes[name] - 1, LEVELS)).astype(int))
        for name in axes_of(data)
        if name not in shown and data.sizes[name] > LEVELS
    }
    if pick:
        pick |= {name: np.arange(0, data.sizes[name], 2) for name in shown if data.sizes[name] > 2 * LEVELS}
    return pick


def _thinned(data: xr.Dataset) -> xr.Dataset:
    return data[["margin", "margin_sd"]].isel(_pick(data))


def _layer(data: xr.Dataset, **arrays: xr.DataArray) -> dict:
    names = axes_of(data)
    values = [[float(f"{v:.5g}") for v in data[name].values] for name in names]
    return {"values": values} | {key: _whole(a.transpose(*names).values) for key, a in arrays.items()}


def _whole(values: np.ndarray) -> list[int | None]:
    return [round(PER * v) if math.isfinite(v) else None for v in map(float, values.ravel())]


def _chance(data: xr.Dataset) -> dict | None:
    """Margin and standard deviation between the points of a grid; None where too few runs say."""
    names = axes_of(data)
    axes = {name: axis_of(data, name) for name in names}
    shown = [n for n in (data.attrs["plot_x"], data.attrs["plot_y"]) if n]
    for fine in (FINE, FINE // 2, FINE // 4, 0):
        values = [refined(axes[n], fine if n in shown else 0) for n in names]
        if math.prod(map(len, values)) <= _MAX_POINTS or not fine:
            break
    shape = tuple(map(len, values))
    margin, sd = np.full(shape, math.nan), np.full(shape, math.nan)
    switches = [k for k, n in enumerate(names) if axes[n].mechanism]
    for chosen in itertools.product(*(range(shape[k]) for k in switches)):
        where: list[slice | int] = [slice(None)] * len(names)
        for k, i in zip(switches, chosen, strict=True):
            where[k] = i
        here: Mapping[str, float] = {names[k]: values[k][i] for k, i in zip(switches, chosen, strict=True)}
        try:
            reader = MapReader(data, dict(here))
        except BadInput:
            continue
        free = [n for n in names if n not in here]
        at = [
            dict(zip(free, place, strict=True))
            for place in itertools.product(*(values[names.index(n)] for n in free))
        ]
        mean, spread = reader.margin(at)
        part = margin[tuple(where)].shape
        margin[tuple(where)], sd[tuple(where)] = mean.reshape(part), spread.reshape(part)
    if not np.isfinite(margin).any():
        return None
    short = [[float(f"{v:.5g}") for v in some] for some in values]
    return {"values": short, "margin": _whole(margin), "sd": _whole(sd)}


def _classical(data: xr.Dataset) -> dict[str, dict]:
    shown, values = (data.attrs["plot_x"], data.attrs["plot_y"]), []
    for name in axes_of(data):
        v, axis = data[name].values, axis_of(data, name)
        if name in shown and v.size > 1 and not axis.mechanism:
            v = (np.geomspace if axis.scale == "log" else np.linspace)(v[0], v[-1], _ESTIMATED_POINTS)
        elif v.size > LEVELS:
            v = v[np.rint(np.linspace(0, v.size - 1, LEVELS)).astype(int)]
        values.append([float(f"{u:.5g}") for u in v])
    margin = estimated_margin(data)
    if math.prod(map(len, values)) > _MAX_POINTS:
        return {}
    z = np.array([margin(dict(zip(axes_of(data), at, strict=True))) for at in itertools.product(*values)])
    known = z[np.isfinite(z)]
    there = known.size and known.min() < 0 <= known.max()
    return {"classical": {"values": values, "z": _whole(z)}} if there else {}


def refined(axis: Axis, count: int) -> list[float]:
    """The values of an axis with others between them on its scale, about ``count`` in all."""
    v = np.asarray(axis.values, dtype=float)
    if axis.mechanism or v.size < 2 or v.size >= count:
        return v.tolist()
    parts = max(1, round((count - 1) / (v.size - 1)))
    at = np.arange((v.size - 1) * parts + 1) / parts
    if axis.scale == "log":
        return np.exp(np.interp(at, np.arange(v.size), np.log(v))).tolist()
    return np.interp(at, np.arange(v.size), v).tolist()
