"""The example studies, campaigns and notebooks, as they come with cutbench: to copy, run and change."""

from __future__ import annotations

import shutil
from pathlib import Path

from cutbench.base.errors import BadInput

#: In an installed package, and in a working copy of the source.
_PLACES = (Path(__file__).parent / "examples", Path(__file__).parents[2] / "studies")


def copy_examples(folder: str | Path) -> Path:
    """Copy the examples that come with cutbench into a new folder.

    They are studies of maps, measured campaigns with their readings and licences, and notebooks.

    Parameters
    ----------
    folder : str or Path
        The folder to make.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    BadInput
        For a folder that is there already or cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import cutbench
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     examples = cutbench.copy_examples(folder + "/examples")
    ...     (examples / "boundary.toml").is_file()
    True
    """
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
    except OSError as error:
        old, written = "a folder that is not there yet", f"a folder that can be written ({error.strerror})"
        expected = old if isinstance(error, FileExistsError) else written
        raise BadInput(key="--out", value=str(folder), expected=expected) from error
    return folder
