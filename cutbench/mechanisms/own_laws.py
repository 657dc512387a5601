"""Laws of your own, taken up from folders beside the known ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.mechanisms.base import Tool
from cutbench.mechanisms.law_registry import file_of, folders_in_use, look_in, registry


def use_mechanisms(*folders: str | Path) -> tuple[str, ...]:
    """Take up laws of your own, from folders with files of Python, beside the known ones.

    Cases carry the folders of their laws to the processes of a sweep.

    Parameters
    ----------
    *folders : str or Path
        Folders with files of Python, each with one law or several.

    Returns
    -------
    tuple of str
        The names of the laws in these folders.

    Raises
    ------
    BadInput
        For a folder that is not there, a file that cannot be imported, a law that lacks something, a blade
        that fails its checks, and a cohesive law whose damage does not say what is cut; then nothing is taken
        up.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import cutbench
    >>> text = '''
    ... from cutbench.mechanisms import NeoHookean
    ...
    ... class Renamed(NeoHookean):
    ...     "Neo-Hooke under a name of its own."
    ...     name = "renamed"
    ... '''
    >>> folder = tempfile.TemporaryDirectory()
    >>> _ = (Path(folder.name) / "renamed.py").write_text(text)
    >>> cutbench.use_mechanisms(folder.name)
    ('renamed',)
    >>> "renamed" in cutbench.known_mechanisms()
    True
    >>> folder.cleanup()
    """
    before = folders_in_use()
    new = [Path(folder).resolve() for folder in folders]
    for folder in new:
        if not folder.is_dir():
            raise BadInput(key="--mechanisms", value=str(folder), expected="a folder with files of laws")
    look_in(dict.fromkeys([*before, *new]))
    try:
        taken = [law for law in registry().values() if file_of(law).parent in new]
        for law in taken:
            if isinstance(law, Tool) or law.role == "cohesive":
                from cutbench.mechanisms.checks import refuse_wrong  # takes a while to load

                refuse_wrong(law)
        return tuple(law.name for law in taken)
    except BadInput:
        look_in(before)
        raise


def take_up(folders: Sequence[Path]) -> None:
    """``use_mechanisms`` where a process, a worker say, does not have all of ``folders`` yet."""
    if not set(folders) <= set(folders_in_use()):
        use_mechanisms(*folders)


def folders_of(names: tuple[str, ...]) -> tuple[Path, ...]:
    """The folders in use that laws of these ``names`` come from."""
    places = {file_of(registry()[name]).parent for name in names}
    return tuple(folder for folder in folders_in_use() if folder in places)
