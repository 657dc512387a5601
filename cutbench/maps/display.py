"""A map in words, as a picture, as tables, as files."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from cutbench.base.files import check_writable
from cutbench.maps.dataset import LABELS, axes_of, axis_of, places_of
from cutbench.maps.map_folder import Map
from cutbench.maps.phase import draw_plane


def summary_lines(map: Map) -> list:
    """Head, then pairs of words."""
    data = map.data
    axes = [axis_of(data, name) for name in axes_of(data)]
    labels = data["label"].values[data["run_id"].values != ""]
    counts = {label: int((labels == k).sum()) for k, label in enumerate(LABELS)}
    return [
        str(data.attrs["title"]),
        *((a.name, f"{a.values[0]:g} to {a.values[-1]:g} {a.unit}".removesuffix(" 1")) for a in axes),
        *((label, f"{n} run{'s' * (n != 1)}") for label, n in counts.items() if n),
    ]


def plot(map: Map, ax: Axes) -> None:
    """The plane of the map; the first level of what is no axis of the picture."""
    draw_plane(ax, map.data)


def table(map: Map) -> dict[str, np.ndarray]:
    """Its runs, a row each: places, label, measures, how they ended."""
    data = map.data
    places, keep = places_of(data), data["run_id"].values != ""
    found = {name: np.asarray(values)[keep] for name, values in places.items()}
    for name, part in data.data_vars.items():
        if part.dims == data["label"].dims and name not in found and part.shape == keep.shape:
            found[str(name)] = part.values[keep]
    return found | {"label": np.array(LABELS)[data["label"].values[keep]]}


def dataset(map: Map) -> xr.Dataset:
    """As it is in ``map.nc``."""
    return map.data


def write(map: Map, folder: Path) -> None:
    """Its files, without its runs."""
    folder = check_writable(folder)
    for path in map.folder.iterdir():
        if path.is_file() and path.suffix in (".nc", ".csv", ".png", ".svg", ".html", ".txt"):
            shutil.copyfile(path, folder / path.name)
