"""Name and unit in the title of a column: "F [N]", "Force (mN)", "F / N", "F in N", "force_N".

Where a force is due, a unit of mass is that of its weight: g is gram-force, kg/cm^2 a pressure.
"""

from __future__ import annotations

import re
from contextlib import suppress

from cutbench.base.errors import BadInput
from cutbench.base.units import parse_quantity, ureg

#: Unit of each role inside; ``repetition`` is a label.
UNITS = {
    "displacement": "mm",
    "force": "N",
    "time": "s",
    "stretch": "1",
    "strain": "1",
    "stress": "MPa",
    "pressure": "MPa",
    "normal_force": "N",
    **dict.fromkeys(("x", "y", "u_x", "u_y", "travel"), "mm"),
}

_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\])}>]*?)\s*[\])}>]")
#: Without brackets only a unit of the right kind is one: F_m may be a force's name.
_BARE = (
    re.compile(r"(.*\S)\s+/\s+(\S+)"),
    re.compile(r"(.*\S)\s+in\s+(\S+)"),
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
        targets = set(UNITS.values()) if target is None else {target}
        sized = size_of if pattern is not _BARE[-1] else _exactly  # F_g, F_S may be names
        if match and any(sized(match[2], kind) is not None for kind in targets):
            return match[1], match[2]
    return title, None


def is_unit(text: str) -> bool:
    """Whether ``text`` is a unit of any kind."""
    if text.strip() in ("1", "-"):
        return True
    if not text.strip() or text.strip()[0].isdigit():
        return False
    for spelt in (text, _lower(text)):
        with suppress(Exception):  # pint raises many kinds for malformed text
            ureg.parse_units(spelt)
            return True
    return False


def size_of(unit: str, target: str) -> float | None:
    """What one ``unit`` is in ``target``; None if it is none of that kind.

    Weights count as forces, and a unit may be written large, as in Sec or Kg, where it is none otherwise.
    """
    spelt = dict.fromkeys((unit.strip(), _lower(unit)))
    sizes = (_exactly(text + weight, target) for text in spelt for weight in ("", "*standard_gravity"))
    return next((size for size in sizes if size is not None), None)


def _lower(unit: str) -> str:
    return unit.strip().rstrip(".").lower()


def _exactly(unit: str, target: str) -> float | None:
    """What one ``unit`` is in ``target`` to the letter."""
    if unit in ("1", "-", "mm/mm"):
        return 1.0 if target == "1" else None
    if not unit or unit[0].isdigit():
        return None
    try:
        return parse_quantity(f"1 {unit}", target, key="unit")
    except BadInput:
        return None
