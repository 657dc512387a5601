"""Units at the edges, one consistent system inside: mm, N, s (so MPa and mJ).

A person writes ``"7.5 kPa"``; a law computes with ``0.0075``. Nothing between the two carries
units, and nothing a person writes or reads lacks them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

import pint

from cutbench.base.errors import BadInput

ureg: pint.UnitRegistry = pint.UnitRegistry()

#: One number, then a unit or nothing. Pint alone would read "7,5 kPa" as 75 kPa and "7 5 kPa" as 35 kPa.
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf))\s*(.*?)\s*")

#: The consistent unit of each base dimension; every derived unit follows from these.
_BASE = {"[length]": "mm", "[time]": "s", "[mass]": "tonne"}

#: Force (N), travel (mm) and duration (s) of the tests that typical values are typical of.
TYPICAL_TESTS = (1.0, 10.0, 100.0)


@dataclass(frozen=True)
class Parameter:
    """A parameter is one number of a mechanism, as a person sees it: with name, unit, meaning and bounds.

    A value that a person writes or reads is in the parameter's own ``unit``; laws compute in the consistent
    system of mm, N and s (so MPa and mJ), which is called internal here.

    Attributes
    ----------
    name : str
        Its name in files and in keywords, such as ``G_c``.
    unit : str
        The unit shown and expected at the edges, such as ``kPa``; ``1`` for a number without one.
    symbol : str
        Its symbol as on paper.
    doc : str
        What it is, in words.
    low : float or None
        The lower bound in ``unit``; None where there is none.
    high : float or None
        The upper bound in ``unit``; None where there is none.
    off : float or None
        The value, in ``unit``, that removes the mechanism's effect; None where no value does.
    default : float or None
        The value, in ``unit``, that it has where none is given; None where one has to be.
    typical : float
        A value, in ``unit``, in the middle of the field's experience: a start for fits and tests. Where it is
        not given, ``default`` where that has an effect, else 1.
    open_low : bool
        Whether ``low`` itself is not allowed; bounds are inclusive unless they are open.
    open_high : bool
        Whether ``high`` itself is not allowed.
    lever : str
        What a designer calls it who can change it, for guides; empty where nobody can.
    sought : bool
        Whether a fit looks for it by itself.
    trial : tuple of (str, float) or None
        A further test that would change it, in words, and by which factor.
    unmeasured : tuple of float
        Factors by which it could as well be another, for all that tests have told; of the typical value where
        a case has switched it off.
    """

    name: str
    unit: str
    symbol: str
    doc: str
    low: float | None = None
    high: float | None = None
    off: float | None = None
    default: float | None = None
    typical: float = math.nan
    open_low: bool = False
    open_high: bool = False
    lever: str = ""
    sought: bool = True
    trial: tuple[str, float] | None = None
    unmeasured: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if math.isnan(self.typical):
            shows = self.default if self.default not in (None, self.off) else 1.0
            object.__setattr__(self, "typical", shows)

    @classmethod
    def positive(cls, name: str, unit: str, symbol: str, doc: str, **rest: Any) -> Parameter:
        """Make the parameter of a size: its value must be above 0."""
        return cls(name, unit, symbol, doc, low=0.0, open_low=True, **rest)

    @classmethod
    def effect(
        cls, name: str, unit: str, symbol: str, doc: str, low: float | None = 0.0, **rest: Any
    ) -> Parameter:
        """Make the parameter of an effect that 0, its default, switches off."""
        return cls(name, unit, symbol, doc, low=low, off=0.0, default=0.0, **rest)

    @property
    def factor(self) -> float:
        """This is what a value in ``unit`` is multiplied by to have it in internal units (mm, N, s)."""
        return unit_factor(self.unit)

    @property
    def bounds(self) -> tuple[float, float]:
        """These are ``low`` and ``high`` in internal units (mm, N, s), infinite where there is none."""
        low, high = -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high
        return low * self.factor, high * self.factor

    @property
    def off_value(self) -> float:
        """This is ``off`` in internal units (mm, N, s), nan where no value removes the effect."""
        return math.nan if self.off is None else self.off * self.factor

    def in_tests(self, force: float, length: float, time: float) -> Parameter:
        """Say what is typical in tests of another size: as many of their forces, lengths and times."""
        parts = zip((force, length, time), TYPICAL_TESTS, dimensions_of(self.unit), strict=True)
        return replace(self, typical=self.typical * math.prod((x / x0) ** power for x, x0, power in parts))

    def range_text(self) -> str:
        """Write the admissible range in words, as error messages show it: ``"0 kPa < G"``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        left = "" if self.low is None else f"{self.low:g}{unit} {'<' if self.open_low else '<='} "
        right = "" if self.high is None else f" {'<' if self.open_high else '<='} {self.high:g}{unit}"
        return f"{left}{self.name}{right}"

    def check(self, value: float, *, key: str | None = None) -> float:
        """Return a value if it lies within the bounds. Raises BadInput."""
        # A bound that was written and read back is one, but for rounding.
        near = (
            end
            for end in (self.low, self.high)
            if end is not None and math.isclose(value, end, rel_tol=1e-12)
        )
        value = next(near, value)
        bad = not math.isfinite(value)
        if self.low is not None:
            bad |= value < self.low or (self.open_low and value == self.low)
        if self.high is not None:
            bad |= value > self.high or (self.open_high and value == self.high)
        if bad:
            shown = f"{value:g}" if self.unit == "1" else f"{value:g} {self.unit}"
            raise BadInput(key or self.name, shown, self.range_text())
        return value

    def parse(self, raw: object, *, key: str | None = None) -> float:
        """Read what a person wrote, such as ``"7.5 kPa"``, into internal units. Raises BadInput."""
        return self.check(parse_quantity(raw, self.unit, key=key or self.name), key=key) * self.factor

    def show(self, internal: float) -> str:
        """Write a value as a person reads it, such as ``"7.5 kPa"``."""
        value = internal / self.factor
        return f"{value:.6g}" if self.unit == "1" else f"{value:.6g} {self.unit}"


@cache
def unit_factor(unit: str) -> float:
    """Size of ``unit`` in the consistent system (mm, N, s): kPa -> 1e-3, J/m^2 -> 1e-3."""
    if unit == "1":
        return 1.0
    quantity = ureg.Quantity(1.0, unit)
    target = ureg.Unit("")
    for dim, power in quantity.dimensionality.items():
        target = target * ureg.Unit(_BASE[dim]) ** power
    # Rounded to 15 digits: 1 kPa must be 1e-3, not 1.0000000000000002e-3.
    return float(f"{quantity.to(target).magnitude:.15g}")


@cache
def powers_of(unit: str) -> tuple[float, float]:
    """Powers of force and of time in ``unit``, where these and lengths are all there is: 1 and 0 of kPa and
    J/m^2, 1 and -1 of N/s."""
    if unit == "1":
        return 0.0, 0.0
    powers: Mapping[str, Any] = ureg.Unit(unit).dimensionality
    mass, time = float(powers.get("[mass]", 0)), float(powers.get("[time]", 0))
    return mass, time + 2 * mass


def dimensions_of(unit: str) -> tuple[float, float, float]:
    """Powers of force, length and time in ``unit``, where these are all there is: 1, -1 and 0 of J/m^2."""
    if unit in ("1", "deg"):
        return 0.0, 0.0, 0.0
    force, time = powers_of(unit)
    powers: Mapping[str, Any] = ureg.Unit(unit).dimensionality
    return force, float(powers.get("[length]", 0)) - force, time


def parse_quantity(raw: object, unit: str, *, key: str = "") -> float:
    """Read a quantity with its unit, and return its value in another unit. Raises BadInput."""
    wanted = "a number without unit" if unit == "1" else f"a value with a unit, such as '1 {unit}'"
    if isinstance(raw, bool) or raw is None or isinstance(raw, (list, dict, tuple)):
        raise BadInput(key, raw, wanted)
    if isinstance(raw, (int, float)):
        if unit == "1":
            return float(raw)
        raise BadInput(key, raw, f"a unit beside the number, as in '… {unit}'")
    try:
        return _value(str(raw), unit)
    except _Unreadable as error:
        raise BadInput(key, raw, error.expected or wanted) from error


class _Unreadable(ValueError):
    """No quantity of this dimension; ``expected`` says more than that, where there is more to say."""

    def __init__(self, expected: str = ""):
        super().__init__(expected)
        self.expected = expected


@lru_cache(maxsize=20_000)
def _value(text: str, unit: str) -> float:
    """Of ``text`` in ``unit``: maps and fits read the same few texts thousands of times."""
    if "±" in text or "+/-" in text:
        raise _Unreadable(f"one value in {unit}; how far it is known is no part of a case")
    if (parts := _QUANTITY.fullmatch(text.replace("²", "^2").replace("³", "^3"))) is None:
        raise _Unreadable
    number, written = parts.groups()
    try:
        # A unit holds no number of its own: parse_units refuses "5 kPa".
        quantity = ureg.Quantity(
            float(number), ureg.parse_units(f"1{written}" if written[:1] == "/" else written)
        )
        magnitude = quantity.magnitude
    except Exception as error:  # pint raises many kinds for malformed text
        raise _Unreadable from error
    if unit != "1" and quantity.dimensionless and quantity.units == ureg.dimensionless:
        raise _Unreadable(f"a unit beside the number, as in '… {unit}'")
    try:
        # Through the two factors, so that "7.5 kPa" read in kPa is 7.5 to the last bit.
        if quantity.units == ureg.Unit("" if unit == "1" else unit):
            return magnitude
        return float(f"{quantity.to('' if unit == '1' else unit).magnitude:.15g}")
    except pint.DimensionalityError as error:
        raise _Unreadable from error
