"""Units as laboratories and instruments spell them: KPa, N/mm2, kp, gms, Sec.

Where a force is due, a unit of mass is that of its weight: g is gram-force, kg/cm^2 a pressure.
"""

from __future__ import annotations

import difflib
import re
from contextlib import suppress

from cutbench.base.errors import BadInput
from cutbench.base.units import parse_quantity, ureg

#: Units that laboratories use, by what they are in inside. One that is written in other letters, as in KPa or
#: MM, is the one among these that differs in nothing else.
COMMON = {
    "mm": ("mm", "µm", "um", "nm", "cm", "m", "in", "inch", "ft", "mil", "micron"),
    "N": (
        "N", "mN", "kN", "MN", "cN", "daN", "µN", "uN", "gf", "kgf", "g", "kg", "lbf", "lb", "ozf", "kp", "p",
    ),
    "s": ("s", "ms", "min", "h", "sec", "µs", "us"),
    "1": ("1", "%", "mm/mm"),
    "N/mm": ("N/mm", "N/m", "N/cm", "kN/m", "mN/mm", "gf/mm", "g/mm"),
    "mJ": ("mJ", "J", "µJ", "uJ", "N*mm", "N*m", "mN*m", "gf*mm", "g*mm"),
    "MPa": (
        "MPa", "kPa", "Pa", "mPa", "GPa", "hPa", "bar", "mbar", "psi", "ksi", "N/mm^2", "N/cm^2", "N/m^2",
        "kN/m^2", "kgf/cm^2", "kgf/mm^2", "gf/cm^2", "kg/cm^2", "kg/mm^2", "kp/cm^2", "kp/mm^2",
    ),
}  # fmt: skip
#: What instruments write, in the words of pint, which takes gr for grains, p for nothing and px for a length.
_HABITS = {
    **dict.fromkeys(("kp", "kilopond", "kilograms"), "kgf"),
    **dict.fromkeys(("p", "pond", "gr", "grs", "gm", "gms"), "gf"),
    **dict.fromkeys(("sek", "sekunden", "secs"), "s"),
    **dict.fromkeys(("mil", "mils"), "thou"),
    **dict.fromkeys(("µe", "με", "µstrain", "ustrain"), "ppm"),
    "pct": "percent",
    "px": "pixel",
    '"': "inch",
}


def is_unit(text: str) -> bool:
    """Whether ``text`` is a unit of any kind."""
    if any(size_of(text, target) is not None for target in COMMON):
        return True
    spelt = _plain(text)
    if not spelt or spelt[0].isdigit():
        return False
    for each in (spelt, spelt.lower()):
        with suppress(Exception):  # pint raises many kinds for malformed text
            ureg.parse_units(each)
            return True
    return False


def size_of(unit: str, target: str) -> float | None:
    """What one ``unit`` is in ``target``; None if it is none of that kind, or may be either of two.

    Weights count as forces. Letters may be large or small where that leaves one meaning: of mPa and MPa,
    ``mpa`` is neither, ``Mpa`` and ``MPA`` are the second.
    """
    spelt = _plain(unit)
    if len(same := _same_but_for_case(spelt, target)) > 1:
        return None
    words = (*same, _worded(spelt), spelt, _worded(spelt.lower()))
    for word in dict.fromkeys(words):
        for weight in ("", "*standard_gravity"):
            if (size := exactly(_worded(word) + weight, target)) is not None:
                return size
    return None


def meant_unit(unit: str, target: str) -> str:
    """Which units of this kind there are, and which may be meant, for a message.

    Units that differ by a prefix alone are no guess for each other.
    """
    spelt, known = _plain(unit), COMMON[target]
    near = _same_but_for_case(spelt, target)
    if not near:
        close = [guess for guess in difflib.get_close_matches(spelt, known, n=5) if guess[0] == spelt[0]]
        near = [guess for guess in close if guess[:2] == spelt[:2]][:1] or close[:1]
    guess = "' or '".join(near)
    wanted = "a number without unit, written '1', or %" if target == "1" else f"a unit such as '{target}'"
    listed = "" if target == "1" else f" ({', '.join(known[1:6])}, …)"
    return f"{wanted}{listed}" + (f"; did you mean '{guess}'?" if guess else "")


def _same_but_for_case(spelt: str, target: str) -> list[str]:
    """The common units that ``spelt`` may be: itself, else all that differ in large and small letters alone,
    of which a large first letter tells mega from milli."""
    known = COMMON.get(target, ())
    if spelt in known:
        return [spelt]
    same = [each for each in known if each.casefold() == spelt.casefold()]
    return [each for each in same if each[0] == spelt[0]] if len(same) > 1 and spelt[0].isupper() else same


def _plain(unit: str) -> str:
    """``unit`` without brackets and full stop, powers as in mm^2."""
    text = unit.strip().strip("[](){}<> ").rstrip(".")
    for sign, plain in (("²", "2"), ("³", "3"), ("⁻", "-"), ("μ", "µ"), ("·", "*"), ("⋅", "*")):
        text = text.replace(sign, plain)
    text = re.sub(r"(?<=[a-z])\.(?=[a-z])", "*", text, flags=re.IGNORECASE)
    return re.sub(r"(?<=[a-z])(-?\d+)$", r"^\1", text, flags=re.IGNORECASE)


def _worded(spelt: str) -> str:
    """``spelt`` in the words of pint."""
    return re.sub(r"""[^\W\d_]+|["]""", lambda word: _HABITS.get(word[0].lower(), word[0]), spelt)


def exactly(unit: str, target: str) -> float | None:
    """What one ``unit`` is in ``target`` to the letter."""
    if unit in ("1", "-", "mm/mm"):
        return 1.0 if target == "1" else None
    if not unit or unit[0].isdigit():
        return None
    try:
        return parse_quantity(f"1 {unit}", target, key="unit")
    except BadInput:
        return None
