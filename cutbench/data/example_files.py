"""The example studies, campaigns and notebooks, as they come with cutbench: to copy, run and change."""

from __future__ import annotations

import shutil
from pathlib import Path

from cutbench.base.errors import BadInput

#: In an installed package, and in a working copy of the source.
_PLACES = (Path(__file__).parent / "examples", Path(__file__).parents[2] / "studies")


def copy_examples(folder: str | Path) -> Path:
    """Copy the examples into a new ``folder`` and return it: studies of maps, measured campaigns with
    their readings and licences, and notebooks. Raises BadInput for a folder that is there already or
    cannot be written."""
    folder = Path(folder)
    source = next((place for place in _PLACES if place.is_dir()), None)
    if source is None:
        raise BadInput(key="examples", value=str(_PLACES[0]), expected="the examples that come with cutbench")
    try:
        shutil.copytree(
            source,
            folder,
            ignore=shutil.ignore_patterns("results", "__pycache__", "make.py", ".ipynb_checkpoints"),
        )
    except FileExistsError as error:
        raise BadInput(key="--out", value=str(folder), expected="a folder that is not there yet") from error
    except OSError as error:
        expected = f"a folder that can be written ({error.strerror})"
        raise BadInput(key="--out", value=str(folder), expected=expected) from error
    return folder
