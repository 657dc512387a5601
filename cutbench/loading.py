"""Whatever cutbench has written, by its path."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.toml import read_toml
from cutbench.case.case import Case, known_materials, load_case
from cutbench.data.campaign import Campaign, load_campaign
from cutbench.maps.map_folder import Map
from cutbench.maps.study import Study, load_study
from cutbench.run.files import read_run
from cutbench.run.result import Result

_RECORDS = ("fit.json", "discovery.json", "band.json")


@dataclass(frozen=True, repr=False)
class Record(Mapping[str, Any]):
    """A fit, a discovery or a band as it was written: the content of its JSON file."""

    path: Path
    content: Mapping[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.content[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.content)

    def __len__(self) -> int:
        return len(self.content)

    def __repr__(self) -> str:
        said = self.content.get("sentence") or self.content.get("status") or ""
        return f"Record: {self.path}\n  {said}\n  keys: {', '.join(self.content)}"


def load(path: str | os.PathLike[str]) -> Result | Map | Record | Case | Study | Campaign:
    """Load whatever cutbench has written, or a file that it reads, by its path.

    Parameters
    ----------
    path : str or path
        The folder of a run, a map, a fit, a discovery or a band, or the file run.json, map.nc, fit.json,
        discovery.json or band.json in one; a case, a study or a campaign as TOML; the name of a known
        material.

    Returns
    -------
    Result, Map, Record, Case, Study or Campaign
        By what is there: a ``Record`` is a mapping with the content of a fit, a discovery or a band.

    Raises
    ------
    BadInput
        For anything else.

    Examples
    --------
    >>> import cutbench
    >>> cutbench.load("gelatin").name
    'gelatin'
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     examples = cutbench.copy_examples(folder + "/examples")
    ...     study, campaign = (cutbench.load(examples / n) for n in ("regimes.toml", "rubber/treloar.toml"))
    >>> type(study).__name__, type(campaign).__name__
    ('Study', 'Campaign')
    """
    given = Path(path)
    if given.is_dir():
        for name in ("run.json", "map.nc", *_RECORDS):
            if (given / name).is_file():
                return load(given / name)
    elif given.suffix == ".nc":
        return Map.of(given)
    elif given.name == "run.json":
        return read_run(given.parent)
    elif given.name in _RECORDS and given.is_file():
        return _record(given)
    elif given.suffix == ".toml":
        table = read_toml(given).table
        readers: dict[str, Any] = {"experiment": load_campaign, "axis": load_study}
        return next((read for key, read in readers.items() if key in table), load_case)(given)
    elif str(path) in known_materials():
        return load_case(str(path))
    expected = f"the folder of a run or a map, one of run.json, map.nc, {', '.join(_RECORDS)}, or a TOML file"
    raise BadInput("path", str(path), expected)


def _record(path: Path) -> Record:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInput("path", str(path), f"a JSON file that cutbench wrote ({error})") from error
    if not isinstance(content, dict):
        raise BadInput("path", str(path), "a JSON file that cutbench wrote")
    return Record(path, content)
