"""Name and unit in the title of a column: "F [N]", "Force (mN)", "F / N", "F, N", "F in N", "force_N"."""

from __future__ import annotations

import re

from cutbench.base.unit_spelling import COMMON, exactly, is_unit, size_of
from cutbench.run.read_off import READ_OFF

#: Unit of each role inside; ``repetition`` is a label, and ``valid`` a number as it stands.
UNITS = {
    "displacement": "mm",
    "force": "N",
    "time": "s",
    "speed": "mm/s",
    "stretch": "1",
    "strain": "1",
    "stress": "MPa",
    "pressure": "MPa",
    "normal_force": "N",
    **dict.fromkeys(("x", "y", "u_x", "u_y", "travel"), "mm"),
    "valid": "",
    **{name: unit for name, (unit, _, _) in READ_OFF.items()},
}

_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\])}>]*?)\s*[\])}>]")
#: Without brackets only a unit of the right kind is one: F_m may be a force's name.
_BARE = (
    re.compile(r"(.*\S)\s+/\s+(\S+)"),
    re.compile(r"(.*\S)\s+in\s+(\S+)"),
    re.compile(r"(.*[^\s/])(?:/|,\s*)([\w%]+)"),
    re.compile(r"(.*[^_])_([^_]+)"),
)


def parted(title: str, target: str | None = None) -> tuple[str, str | None]:
    """Name and unit of a column's title; None where it has no unit.

    ``target`` is a unit of the kind that the column should have; without it any kind that readings have.
    """
    title = title.strip()
    match = _BRACKETS.fullmatch(title)
    if match and is_unit(match[2]):
        return match[1], match[2]
    for pattern in _BARE:
        match = pattern.fullmatch(title)
        targets = set(COMMON) if target is None else {target}
        if match and any(size_of(match[2], kind) is not None for kind in targets):
            # F_g and F_p may be names, and not of weights.
            exact = any(exactly(match[2], kind) is not None for kind in targets)
            if pattern is not _BARE[-1] or exact or len(match[2]) > 1 or "s" in targets:
                return match[1], match[2]
    return title, None


def bracketed(title: str) -> str | None:
    """What a title has in brackets at its end, a unit or not."""
    match = _BRACKETS.fullmatch(title.strip())
    return match[2] if match else None
