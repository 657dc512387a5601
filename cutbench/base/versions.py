"""Versions of all that a number depends on, as every file that is written records them."""

from __future__ import annotations

import platform
from functools import cache
from importlib import metadata

_PACKAGES = ("cutbench", "numpy", "scipy", "scikit-fem", "meshio", "numba", "py-mkl-pardiso")


@cache
def _installed() -> dict[str, str | None]:
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found


def versions() -> dict[str, str | None]:
    """Versions of Python, cutbench and the libraries; None where one is not installed."""
    return dict(_installed())


def written_by(version: object, computation: object) -> str:
    """What wrote a file, in words: ``cutbench 0.1.0, computation 9a6583795d3d``."""
    named = f"cutbench {version}" if version else "a cutbench that did not name its version"
    return f"{named}, computation {computation}" if computation else named
