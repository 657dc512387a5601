"""Known materials, one TOML file each, with where the numbers come from and how they were read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.toml import among, one_of, path_hint, read_toml

_HERE = Path(__file__).parent
_ABOUT = ("name", "source", "doi", "note", "corrections")
_CORRECTION = ("quantity", "printed", "read", "why")


def names() -> list[str]:
    """Names of the known materials, in alphabetical order."""
    return sorted(path.stem for path in _HERE.glob("*.toml"))


def find(source: str | Path, *, key: str = "material") -> Path:
    """The file of a known material, or ``source`` itself if it is a file. Raises BadInput."""
    if isinstance(source, str) and source in names():
        return _HERE / f"{source}.toml"
    path = Path(source)
    if path.is_file():
        return path
    if path.is_dir():
        raise BadInput(key=key, value=str(source), expected="a TOML file, not a folder")
    if path.suffix == ".toml" or len(path.parts) > 1:
        raise BadInput(
            key=key, value=str(source), expected="a TOML file that exists" + path_hint(str(source))
        )
    raise BadInput(key=key, value=str(source), expected=f"a TOML file, or {one_of(str(source), names())}")


def about(source: str | Path) -> dict:
    """The ``[material]`` section: name, source, doi, note, corrections. Raises BadInput."""
    return check_about(read_toml(find(source))[0].get("material", {}))


def check_about(section: Mapping) -> dict:
    """``section`` if it is a ``[material]`` section as it should be. Raises BadInput."""
    for key, value in section.items():
        among(key, key, _ABOUT, value=value)
        if key == "corrections":
            for row in value if isinstance(value, list) else [value]:
                if not isinstance(row, Mapping) or set(row) - set(_CORRECTION):
                    raise BadInput(key=key, value=row, expected=f"tables with {', '.join(_CORRECTION)}")
        elif not isinstance(value, str) or not value.strip():
            raise BadInput(key=key, value=value, expected="a text in quotes")
    return dict(section)
