"""The axes of a study: which quantity, which values, and that no two set the same."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from cutbench.case import Case
from cutbench.errors import BadInput
from cutbench.model import GROUPS, Model
from cutbench.quantities import Parameter, parse_quantity
from cutbench.reading import located, one_of
from cutbench.values import ETA_V, settable

_AXIS = ("name", "from", "to", "points", "scale", "values")
#: More points than this are a slip of the pen.
MAX_POINTS = 100_000

#: How pictures write a group and call it.
_GROUP_TEXTS = {
    "opening": (r"$\delta_\mathrm{c}/a$", "opening"),
    "cohesion": (r"$(G_\mathrm{c}/\delta_\mathrm{c})/G$", "cohesion"),
    "adhesion": (r"$\tau_\mathrm{W}/(G_\mathrm{c}/\delta_\mathrm{c})$", "adhesion"),
    "viscosity": (r"$\eta_\mathrm{reg}\,v/\delta_\mathrm{c}$", "viscosity"),
    "friction": (r"$\mu$", "friction"),
    "sharpness": (r"$b/a$", "sharpness"),
}


@dataclass(frozen=True)
class Axis:
    """One quantity that is varied: ``values`` in ``unit``, ascending, on a ``log`` or ``linear`` scale."""

    name: str
    unit: str
    symbol: str
    long_name: str
    values: tuple[float, ...]
    scale: str
    #: The parameter that ends up with a value; for a group the one it is solved for.
    sets: str

    def text(self, i: int) -> str | float:
        """Value ``i`` as ``Case.set`` takes it."""
        return self.values[i] if self.unit == "1" else f"{self.values[i]!r} {self.unit}"


def read_axes(
    table: dict, path: Path, text: str, model: Model, changes: Mapping[str, object]
) -> tuple[Axis, ...]:
    """The ``[[axis]]`` sections of a study in ``path``; ``changes`` is what its other sections set.

    Raises BadInput that names the axis by its number and the line of the key.
    """
    entries = table.get("axis", [])
    with located(path, text):
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise BadInput(key="axis", value=str(entries), expected="sections written [[axis]], one an axis")
        if not entries:
            raise BadInput(
                key="axis", value="(missing)", expected="at least one [[axis]] with name and values"
            )
    axes: list[Axis] = []
    for n, entry in enumerate(entries):
        try:
            axis = _axis(entry, model)
            for other in axes:
                if other.name == axis.name:
                    raise BadInput(key="name", value=axis.name, expected="each axis once")
                if other.sets == axis.sets:
                    raise BadInput(
                        key="name", value=axis.name,
                        expected=f"an axis that sets something else: '{other.name}' sets {axis.sets} already",
                    )  # fmt: skip
            for key in changes:
                if _sets(key) == axis.sets:
                    raise BadInput(
                        key="name",
                        value=axis.name,
                        expected=f"{key} to be set once: by this axis or in its section",
                    )
            axes.append(axis)
            if (size := math.prod(len(a.values) for a in axes)) > MAX_POINTS:
                raise BadInput(key="points", value=size, expected=f"at most {MAX_POINTS} points in all")
        except BadInput as error:
            raise BadInput(
                file=str(path), line=_axis_line(text, n, error.key), key=f"axis {n + 1}: {error.key}",
                value=error.value, expected=error.expected,
            ) from error  # fmt: skip
    return tuple(axes)


def _axis(entry: dict, model: Model) -> Axis:
    refuse_unknown(entry, _AXIS)
    groups, parameters, names = model.settable_groups(), model.parameters(), settable(model)
    name = entry.get("name", "(missing)")
    if not isinstance(name, str) or name not in names:
        raise BadInput(key="name", value=name, expected=one_of(str(name), names))
    scale = entry.get("scale", "linear")
    if scale not in ("linear", "log"):
        raise BadInput(key="scale", value=scale, expected="'linear' or 'log'")
    quantity = groups[name].quantity if name in groups else ETA_V if name == ETA_V.name else parameters[name]
    values = _listed(entry, quantity) if "values" in entry else _spaced(entry, quantity, scale)
    if scale == "log" and values[0] <= 0:
        raise BadInput(key="scale", value=scale, expected="'linear', since a value is 0 or below")
    symbol, long_name = _GROUP_TEXTS.get(name, (quantity.symbol, quantity.doc))
    return Axis(name, quantity.unit, symbol, long_name, values, scale, _sets(name))


def _listed(entry: dict, quantity: Parameter) -> tuple[float, ...]:
    for key in ("from", "to", "points"):
        if key in entry:
            raise BadInput(key=key, value=entry[key], expected="either values, or from, to and points")
    raw = entry["values"]
    if not isinstance(raw, list) or not raw:
        raise BadInput(
            key="values", value=str(raw), expected="a list with at least one value, such as [1, 3, 10]"
        )
    values = tuple(_read(item, quantity, "values") for item in raw)
    if any(b <= a for a, b in pairwise(values)):
        raise BadInput(key="values", value=str(raw), expected="ascending values, each once")
    return values


def _spaced(entry: dict, quantity: Parameter, scale: str) -> tuple[float, ...]:
    for key in ("from", "to", "points"):
        if key not in entry:
            raise BadInput(key=key, value="(missing)", expected="from, to and points, or values")
    low, high = (_read(entry[key], quantity, key) for key in ("from", "to"))
    if low >= high:
        raise BadInput(key="from", value=entry["from"], expected=f"less than to = {entry['to']}")
    if scale == "log" and low <= 0:
        raise BadInput(key="from", value=entry["from"], expected="more than 0 on a log scale")
    points = entry["points"]
    if isinstance(points, bool) or not isinstance(points, int) or not 2 <= points <= MAX_POINTS:
        raise BadInput(
            key="points", value=points, expected="a whole number, 2 or more (or values = [...] for one)"
        )
    spaced = np.geomspace(low, high, points) if scale == "log" else np.linspace(low, high, points)
    # Six digits: numbers that a person can type, and the same id with any version of numpy.
    values = tuple(float(f"{v:.6g}") for v in spaced)
    if len(set(values)) < points:
        raise BadInput(key="points", value=points, expected="values that differ in their first six digits")
    return values


def _read(raw: object, quantity: Parameter, key: str) -> float:
    return quantity.check(parse_quantity(raw, quantity.unit, key=key), key=key)


def refuse_unknown(part: Mapping[str, object], known: tuple[str, ...]) -> None:
    """BadInput for the first key of ``part`` that is not ``known``."""
    for key, value in part.items():
        if key not in known:
            shown = value if isinstance(value, (str, int, float)) else type(value).__name__
            raise BadInput(key=key, value=shown, expected=one_of(key, known))


def _sets(name: str) -> str:
    if name == ETA_V.name:
        return "eta_reg"
    return GROUPS[name].parameter if name in GROUPS else name


def value_on(axis: Axis, case: Case) -> float | None:
    """Where a case lies on an axis, in the axis' unit; None if its model lacks the quantity."""
    if axis.sets not in case.values:
        return None
    if axis.name in GROUPS:
        return float(f"{GROUPS[axis.name].value(case.p):.6g}")
    if axis.name == ETA_V.name:
        return case.p.eta_reg * case.p.speed
    return case.values[axis.name] / case.model.parameters()[axis.name].factor


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
