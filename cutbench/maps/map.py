"""A map with the folder that it lies in."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import xarray as xr

from cutbench.base.display import Displayed
from cutbench.maps.dataset import load_map

if TYPE_CHECKING:
    from cutbench.maps.guidance import Guide


@dataclass(frozen=True, repr=False, eq=False)
class Map(Displayed):
    """What a sweep has left: ``data`` as in ``map.nc``, in ``folder``."""

    display_module: ClassVar[str] = "cutbench.maps.display"

    data: xr.Dataset
    folder: Path

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Map:
        """The map of a folder or a ``map.nc``. Raises BadInput if it is none."""
        found = Path(path)
        found = found / "map.nc" if found.is_dir() else found
        return cls(load_map(found), found.parent)

    def guide(self, material: str) -> Guide:
        """What would move ``material`` (a name or a case file) across the boundary. Raises BadInput."""
        from cutbench.maps.guidance import guide

        return guide(self.data, material)
