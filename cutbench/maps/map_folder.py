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
    """A map holds the results of a study: where in its parameters cutting is smooth, and where it is abrupt.

    ``Map.of`` reads one from the folder of a sweep.

    Attributes
    ----------
    data : xarray.Dataset
        Labels, outcomes and measures of the runs over the study's axes, units in the attributes.
    folder : Path
        The folder of the sweep.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import cutbench
    >>> from cutbench.maps import build_map
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
    ...     study = cutbench.load_study(file)
    ...     found = cutbench.Map(build_map(study, {}), file.parent)  # no run has ended yet
    >>> found
    Map: Toughness
      cohesion      4 to 8
      not_computed  2 runs
    """

    display_module: ClassVar[str] = "cutbench.maps.display"

    data: xr.Dataset
    folder: Path

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Map:
        """Read the map of a sweep.

        Parameters
        ----------
        path : str or path
            The folder of a sweep, or its ``map.nc``.

        Returns
        -------
        Map
            With its folder.

        Raises
        ------
        BadInput
            If it is none.
        """
        file = Path(path)
        file = file / "map.nc" if file.is_dir() else file
        return cls(load_map(file), file.parent)

    def guide(self, material: str) -> Guide:
        """Find what would move a material across the boundary between smooth and abrupt cutting.

        Parameters
        ----------
        material : str
            A known name, or a case file.

        Returns
        -------
        Guide
            Where the material is, and the changes that would move it across, soonest first.

        Raises
        ------
        BadInput
            If it has no place on the map, or the map too few runs.
        """
        from cutbench.maps.guidance import guide

        return guide(self.data, material)
