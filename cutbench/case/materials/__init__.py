"""Known materials, one TOML file each, with where the numbers come from and how they were read."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.sections import Entry, read_section
from cutbench.base.toml import one_of, path_hint, read_toml

_HERE = Path(__file__).parent
_CORRECTION = tuple(Entry(key, object, default="") for key in ("quantity", "printed", "read", "why"))
#: The section [material]: what is known of one beside its numbers.
ABOUT = (
    *(Entry(key, str, "a text in quotes") for key in ("name", "source", "doi", "note")),
    Entry("corrections", _CORRECTION, default=(), count=(0, math.inf), single=True),
)


def names() -> list[str]:
    """Names of the known materials, in alphabetical order."""
    return sorted(path.stem for path in _HERE.glob("*.toml"))


def find(source: str | Path, *, key: str = "material") -> Path:
    """The file of a known material, or ``source`` itself if it is a file. Raises BadInput."""
    if isinstance(source, str) and source in names():
        return _HERE / f"{source}.toml"
    path, name = Path(source), str(source)
    if path.is_file():
        return path
    if path.is_dir():
        expected = "a TOML file, not a folder"
    elif path.suffix == ".toml" or len(path.parts) > 1:
        expected = "a TOML file that exists" + path_hint(name)
    else:
        expected = f"a TOML file, or {one_of(name, names())}"
    raise BadInput(key, name, expected)


def about(source: str | Path) -> dict[str, Any]:
    """The section [material] of a known material or of a file, by key. Raises BadInput."""
    return read_section(read_toml(find(source)).table.get("material", {}), ABOUT, "material.")
