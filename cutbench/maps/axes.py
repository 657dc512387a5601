"""The axes of a study: which quantity or switch, which values, and that no two set the same."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.toml import among, located, one_of
from cutbench.base.units import Parameter, parse_quantity
from cutbench.case.case import Case
from cutbench.case.model import Model, groups
from cutbench.case.values import parameter_of, settable
from cutbench.mechanisms import registry

_AXIS = ("name", "mechanism", "from", "to", "points", "scale", "values", "tolerance")
#: More points than this are a slip of the pen.
MAX_POINTS = 100_000
#: How a study may spread its runs over its axes.
GRID, SAMPLE, BOUNDARY = "grid", "sobol", "boundary"
MODES = (GRID, SAMPLE, BOUNDARY)
#: Part of an axis to which a boundary is sought unless the study says otherwise: in a plane, in a box.
TOLERANCE = {1: 1 / 32, 2: 1 / 32, 3: 1 / 16}


@dataclass(frozen=True)
class Axis:
    """One quantity that is varied, or a mechanism that is switched (0: out of the model, 1: in it).

    ``values`` in ``unit``, ascending, on a ``log`` or ``linear`` scale; where a boundary is sought,
    the values at which runs may be asked for. A sampled axis has its two ends only.
    """

    name: str
    unit: str
    symbol: str
    long_name: str
    values: tuple[float, ...]
    scale: str
    #: The parameter that ends up with a value; for a group the one it is solved for.
    sets: str
    #: Whether runs may lie between the values; else each value is a level of its own.
    continuous: bool = False
    #: Part of the axis to which a boundary is sought.
    tolerance: float = math.nan
    #: The mechanism that this axis switches; empty for a quantity.
    mechanism: str = ""

    def text(self, value: float) -> str | float:
        """A value as ``Case.set`` takes it."""
        return value if self.unit == "1" else f"{value!r} {self.unit}"

    def place(self, value: float) -> float:
        """Where a value lies between the axis' ends, 0 to 1 on its scale."""
        return float(places(np.array([value]), self.values[0], self.values[-1], self.scale)[0])

    def value(self, place: float) -> float:
        """The value at a place, to six digits."""
        low, high = self.values[0], self.values[-1]
        if self.scale == "log":
            return short(low * (high / low) ** place)
        return short(low + (high - low) * place)


def places(values: np.ndarray, low: float, high: float, scale: str) -> np.ndarray:
    """Values of an axis as parts of its length."""
    v = np.asarray(values, dtype=float)
    if scale == "log":
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(v / low) / math.log(high / low)
    return (v - low) / (high - low)


def short(value: float) -> float:
    """Six digits: numbers that a person can type, and the same id with any version of numpy."""
    return float(f"{value:.6g}")


def read_axes(
    table: dict, path: Path, text: str, model: Model, changes: Mapping[str, object], mode: str = GRID
) -> tuple[Axis, ...]:
    """The ``[[axis]]`` sections of a study in ``path``; ``changes`` is what its other sections set.

    ``model`` has every mechanism that an axis switches.

    Raises BadInput that names the axis by its number and the line of the key.
    """
    entries = table.get("axis", [])
    with located(path, text):
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise BadInput("axis", str(entries), "sections written [[axis]], one an axis")
        if not entries:
            raise BadInput("axis", "(missing)", "at least one [[axis]] with name and values")
    axes: list[Axis] = []
    # A lattice of half the tolerance: see cutbench.maps.boundary.
    seek = sum("values" not in e and "mechanism" not in e for e in entries)
    for n, entry in enumerate(entries):
        try:
            axis = _axis(entry, model, mode, TOLERANCE.get(seek, TOLERANCE[3]))
            for other in axes:
                if other.name == axis.name:
                    raise BadInput("name", axis.name, "each axis once")
                if other.sets == axis.sets:
                    raise BadInput(
                        key="name", value=axis.name,
                        expected=f"an axis that sets something else: '{other.name}' sets {axis.sets} already",
                    )  # fmt: skip
            for key in changes:
                if parameter_of(key) == axis.sets:
                    raise BadInput("name", axis.name, f"{key} to be set once: by this axis or in its section")
            axes.append(axis)
            size = math.prod(len(a.values) for a in axes)
            if mode == GRID and size > MAX_POINTS:
                raise BadInput("points", size, f"at most {MAX_POINTS} points in all")
            if mode == BOUNDARY and size > MAX_POINTS:
                raise BadInput(
                    key="tolerance" if axis.continuous else "values", value=entry.get("tolerance", size),
                    expected="fewer axes or larger tolerances: to half of each that is a lattice of"
                    f" {size} points, more than {MAX_POINTS}",
                )  # fmt: skip
        except BadInput as error:
            raise BadInput(
                file=str(path), line=_axis_line(text, n, error.key), key=f"axis {n + 1}: {error.key}",
                value=error.value, expected=error.expected,
            ) from error  # fmt: skip
    return tuple(axes)


def switched(table: dict) -> tuple[str, ...]:
    """Names under ``mechanism`` in the ``[[axis]]`` sections, as far as they are names."""
    entries = table.get("axis", [])
    entries = entries if isinstance(entries, list) else []
    found = (e.get("mechanism") for e in entries if isinstance(e, dict))
    return tuple(name for name in found if isinstance(name, str) and name in registry())


def _axis(entry: dict, model: Model, mode: str, tolerance: float) -> Axis:
    refuse_unknown(entry, _AXIS)
    if "mechanism" in entry:
        return _switch(entry, model)
    there, parameters, names = model.settable_groups(), model.parameters(), settable(model)
    name = entry.get("name", "(missing)")
    among("name", name, names)
    scale = entry.get("scale", "linear")
    if scale not in ("linear", "log"):
        raise BadInput("scale", scale, "'linear' or 'log'")
    quantity = there[name].quantity if name in there else parameters[name]
    continuous = mode in (SAMPLE, BOUNDARY) and "values" not in entry
    if "tolerance" in entry and not (mode == BOUNDARY and continuous):
        raise BadInput(
            "tolerance", entry["tolerance"], "it only where mode = 'boundary', on an axis with from and to"
        )
    if "values" in entry:
        values = _listed(entry, quantity)
    elif continuous:
        if "points" in entry:
            instead = "the tolerance says how fine" if mode == BOUNDARY else "[sample] says how many"
            raise BadInput("points", entry["points"], f"only from and to: {instead}")
        tolerance = _tolerance(entry.get("tolerance", tolerance))
        points = 2 * math.ceil(1 / tolerance - 1e-9) + 1 if mode == BOUNDARY else 2
        values = _spaced(entry | {"points": points}, quantity, scale)
    else:
        values = _spaced(entry, quantity, scale)
    if scale == "log" and values[0] <= 0:
        raise BadInput("scale", scale, "'linear', since a value is 0 or below")
    symbol, long_name = quantity.symbol, quantity.doc
    if name in there:
        symbol, long_name = there[name].symbol, there[name].title or name
    return Axis(
        name, quantity.unit, symbol, long_name, values, scale, parameter_of(name), continuous,
        tolerance if continuous and mode == BOUNDARY else math.nan,
    )  # fmt: skip


def _switch(entry: dict, model: Model) -> Axis:
    name = entry["mechanism"]
    among("mechanism", name, registry())
    for key in entry:
        if key not in ("mechanism", "values"):
            raise BadInput(key, entry[key], "only values beside a mechanism")
    raw = entry.get("values", [False, True])
    if not isinstance(raw, list) or raw not in ([False, True], [True, False], [False], [True]):
        raise BadInput("values", str(raw), "[false, true]: without and with the mechanism")
    values = tuple(sorted(float(v) for v in raw))
    title = registry()[name].title
    return Axis(f"with_{name}", "1", title, f"{title} in the model", values, "linear", name, mechanism=name)


def _tolerance(raw: object) -> float:
    """A part of an axis: 0.05, or "1/32"."""
    text = raw
    if isinstance(raw, str) and (parts := re.fullmatch(r"\s*1\s*/\s*(\d+)\s*", raw)) and int(parts[1]):
        text = 1 / int(parts[1])
    if isinstance(text, bool) or not isinstance(text, (int, float)) or not 0 < text <= 0.25:
        raise BadInput("tolerance", raw, "a part of the axis, above 0 and up to '1/4', such as '1/32'")
    return float(text)


def _listed(entry: dict, quantity: Parameter) -> tuple[float, ...]:
    for key in ("from", "to", "points"):
        if key in entry:
            raise BadInput(key, entry[key], "either values, or from, to and points")
    raw = entry["values"]
    if not isinstance(raw, list) or not raw:
        raise BadInput("values", str(raw), "a list with at least one value, such as [1, 3, 10]")
    values = tuple(_read(item, quantity, "values") for item in raw)
    if any(b <= a for a, b in pairwise(values)):
        raise BadInput("values", str(raw), "ascending values, each once")
    return values


def _spaced(entry: dict, quantity: Parameter, scale: str) -> tuple[float, ...]:
    for key in ("from", "to", "points"):
        if key not in entry:
            raise BadInput(key, "(missing)", "from, to and points, or values")
    low, high = (_read(entry[key], quantity, key) for key in ("from", "to"))
    if low >= high:
        raise BadInput("from", entry["from"], f"less than to = {entry['to']}")
    if scale == "log" and low <= 0:
        raise BadInput("from", entry["from"], "more than 0 on a log scale")
    points = entry["points"]
    if isinstance(points, bool) or not isinstance(points, int) or not 2 <= points <= MAX_POINTS:
        raise BadInput("points", points, "a whole number, 2 or more (or values = [...] for one)")
    spaced = np.geomspace(low, high, points) if scale == "log" else np.linspace(low, high, points)
    values = tuple(short(v) for v in spaced)
    if len(set(values)) < points:
        raise BadInput("points", points, "values that differ in their first six digits")
    return values


def _read(raw: object, quantity: Parameter, key: str) -> float:
    return quantity.check(parse_quantity(raw, quantity.unit, key=key), key=key)


def refuse_unknown(part: Mapping[str, object], known: tuple[str, ...]) -> None:
    """BadInput for the first key of ``part`` that is not ``known``."""
    for key, value in part.items():
        if key not in known:
            shown = value if isinstance(value, (str, int, float)) else type(value).__name__
            raise BadInput(key, shown, one_of(key, known))


def value_on(axis: Axis, case: Case) -> float | None:
    """Where a case lies on an axis, in the axis' unit; None if its model lacks the quantity."""
    if axis.mechanism:
        return float(axis.mechanism in case.mechanisms)
    if axis.sets not in case.values:
        return None
    known = groups()
    if axis.name in known:
        value = known[axis.name].value(case.p)
        return short(value) if axis.unit == "1" else value
    return case.values[axis.name] / case.model.parameters()[axis.name].factor


def values_on(axes: Sequence[Axis], case: Case) -> tuple[dict[str, float], list[str]]:
    """Where a case lies on each axis, by its name; and the names of those it has no value of."""
    found = {axis.name: value_on(axis, case) for axis in axes}
    return {n: v for n, v in found.items() if v is not None}, [n for n, v in found.items() if v is None]


def _axis_line(text: str, n: int, key: str) -> int | None:
    """Line of ``key`` in the ``n``-th [[axis]], or of its head."""
    head = None
    for number, line in enumerate(text.splitlines(), start=1):
        if re.match(r"\s*\[\[\s*axis\s*\]\]", line):
            n -= 1
            head = number if n == -1 else head
        elif re.match(r"\s*\[", line) and n < 0:
            break
        if n == -1 and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
            return number
    return head
