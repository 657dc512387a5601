"""The axes of a study: which quantity or switch, which values, and that no two set the same.

And where its runs lie on them: the order of a grid, and a Sobol sequence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import qmc

from cutbench.base.errors import require
from cutbench.base.sections import SOME, Entry, read_section
from cutbench.base.toml import TomlFile, among
from cutbench.base.units import Parameter
from cutbench.case.case import Case
from cutbench.case.model import Model, groups
from cutbench.case.values import parameter_of, settable
from cutbench.mechanisms import registry

_AXIS = tuple(
    Entry(key, object)
    for key in ("name", "mechanism", "from", "to", "points", "scale", "values", "tolerance")
)
_NAME, _SCALE = Entry("name"), Entry("scale", default="linear", choices=("linear", "log"))
_SPACED = "from, to and points, or values"
_SOUGHT = "it only where mode = 'boundary', on an axis with from and to"
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
    file: TomlFile,
    sections: Sequence[Mapping[str, Any]],
    model: Model,
    changes: Mapping[str, object],
    mode: str = GRID,
) -> tuple[Axis, ...]:
    """The ``[[axis]]`` sections of a study; ``changes`` is what its other sections set.

    ``model`` has every mechanism that an axis switches.

    Raises BadInput that names the axis by its number and the line of the key.
    """
    axes: list[Axis] = []
    # A lattice of half the tolerance: see cutbench.maps.boundary.
    seek = sum("values" not in section and "mechanism" not in section for section in sections)
    for n, section in enumerate(sections):
        with file.at("axis", n, f"axis {n + 1}: "):
            read_section(section, _AXIS)  # what no axis has is refused, whatever its kind
            axis = _axis(section, model, mode, TOLERANCE.get(seek, TOLERANCE[3]))
            _refuse_set_twice(axis, axes, changes)
            axes.append(axis)
            size = math.prod(len(each.values) for each in axes)
            fits = mode == SAMPLE or size <= MAX_POINTS
            require(fits or mode != GRID, "points", size, f"at most {MAX_POINTS} points in all")
            require(
                fits, "tolerance" if axis.continuous else "values", section.get("tolerance", size),
                "fewer axes or larger tolerances: to half of each that is a lattice of"
                f" {size} points, more than {MAX_POINTS}",
            )  # fmt: skip
    return tuple(axes)


def _refuse_set_twice(axis: Axis, others: Sequence[Axis], changes: Mapping[str, object]) -> None:
    for other in others:
        require(other.name != axis.name, "name", axis.name, "each axis once")
        expected = f"an axis that sets something else: '{other.name}' sets {axis.sets} already"
        require(other.sets != axis.sets, "name", axis.name, expected)
    for key in changes:
        expected = f"{key} to be set once: by this axis or in its section"
        require(parameter_of(key) != axis.sets, "name", axis.name, expected)


def switched(sections: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Names under ``mechanism`` in the ``[[axis]]`` sections, as far as they are names."""
    return tuple(name for section in sections if (name := section.get("mechanism")) in [*registry()])


def _axis(section: Mapping[str, Any], model: Model, mode: str, tolerance: float) -> Axis:
    if "mechanism" in section:
        return _switch(section)
    groups_, parameters = model.settable_groups(), model.parameters()
    among("name", section.get("name", "(missing)"), settable(model))
    name = section["name"]
    quantity = groups_[name].quantity if name in groups_ else parameters[name]
    continuous = mode in (SAMPLE, BOUNDARY) and "values" not in section
    part = _read(section, quantity, mode, tolerance if continuous else math.nan)
    scale, values = part["scale"], part.get("values")
    if values is None:
        points = 2 * math.ceil(1 / part["tolerance"] - 1e-9) + 1 if "tolerance" in part else 2
        values = _spaced(section, part | {"points": part.get("points", points)})
    ascending = all(a < b for a, b in pairwise(values))
    require(ascending, "values", section.get("values"), "ascending values, each once")
    require(scale == "linear" or values[0] > 0, "scale", scale, "'linear', since a value is 0 or below")
    symbol, long_name = quantity.symbol, quantity.doc
    if name in groups_:
        symbol, long_name = groups_[name].symbol, groups_[name].title or name
    return Axis(
        name, quantity.unit, symbol, long_name, values, scale, parameter_of(name), continuous,
        part.get("tolerance", math.nan),
    )  # fmt: skip


def _read(section: Mapping[str, Any], quantity: Parameter, mode: str, tolerance: float) -> dict[str, Any]:
    """What the section of a ``quantity`` says: values; or from, to and how many, by the ``mode``."""
    ends = [Entry(key, quantity, _SPACED, needed=True) for key in ("from", "to")]
    points = Entry("points", int, _SPACED, needed=True, low=2, high=MAX_POINTS)
    fine = Entry("tolerance", _tolerance, default=tolerance)
    by_mode = {
        GRID: ([*ends, points], "from, to and points alone"),
        SAMPLE: (ends, "only from and to: [sample] says how many"),
        BOUNDARY: ([*ends, fine], "only from and to: the tolerance says how fine"),
    }
    values = Entry("values", quantity, "a list with at least one value, such as [1, 3, 10]", count=SOME)
    listed = [values], "either values, or from, to and points"
    entries, others = listed if "values" in section else by_mode[mode]

    wrong = {"tolerance": _SOUGHT}
    return read_section(section, [_NAME, _SCALE, *entries], instead=lambda key: wrong.get(key, others))


def _switch(section: Mapping[str, Any]) -> Axis:
    among("mechanism", section["mechanism"], registry())
    entries = (Entry("mechanism"), Entry("values", _levels, default=(0.0, 1.0)))
    part = read_section(section, entries, instead=lambda key: "only values beside a mechanism")
    name = part["mechanism"]
    title = registry()[name].title
    return Axis(
        f"with_{name}", "1", title, f"{title} in the model", part["values"], "linear", name, mechanism=name
    )


def _levels(raw: object, *, key: str) -> tuple[float, ...]:
    levels: Any = raw
    known = levels in ([False, True], [True, False], [False], [True])
    require(known, key, raw, "[false, true]: without and with the mechanism")
    return tuple(sorted(map(float, levels)))


def _tolerance(raw: object, *, key: str) -> float:
    """A part of an axis: 0.05, or "1/32"."""
    part: Any = raw
    if isinstance(raw, str) and (parts := re.fullmatch(r"\s*1\s*/\s*(\d+)\s*", raw)) and int(parts[1]):
        part = 1 / int(parts[1])
    number = isinstance(part, (int, float)) and not isinstance(part, bool) and 0 < part <= 0.25
    require(number, key, raw, "a part of the axis, above 0 and up to '1/4', such as '1/32'")
    return float(part)


def _spaced(section: Mapping[str, Any], part: Mapping[str, Any]) -> tuple[float, ...]:
    """So many values from one end to the other; the section is as it was written."""
    low, high, points, log = part["from"], part["to"], part["points"], part["scale"] == "log"
    require(low < high, "from", section["from"], f"less than to = {section['to']}")
    require(low > 0 or not log, "from", section["from"], "more than 0 on a log scale")
    values = tuple(short(v) for v in (np.geomspace if log else np.linspace)(low, high, points))
    require(len(set(values)) == points, "points", points, "values that differ in their first six digits")
    return values


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
    values = {axis.name: value_on(axis, case) for axis in axes}
    return {n: v for n, v in values.items() if v is not None}, [n for n, v in values.items() if v is None]


def coarse_to_fine(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Flat indices of a grid so that each is as far as can be from all before it, the middle first.

    Distances are relative to the axes' lengths; ties go to the lower index, so the order is fixed.
    """
    index = np.stack(np.unravel_index(np.arange(math.prod(shape)), shape), axis=1).astype(float)
    place = index / np.maximum(np.array(shape) - 1, 1)
    order = [int(np.argmin(((place - 0.5) ** 2).sum(axis=1).round(9)))]
    gap = np.full(len(place), np.inf)
    for _ in range(len(place) - 1):
        gap = np.minimum(gap, ((place - place[order[-1]]) ** 2).sum(axis=1).round(9))
        gap[order[-1]] = -1.0  # taken
        order.append(int(np.argmax(gap)))
    return tuple(order)


def sobol(axes: Sequence[Axis], points: int, seed: int) -> tuple[tuple[float, ...], ...]:
    """``points`` places of a scrambled Sobol sequence (Sobol 1967; Owen 1998): more points keep those before.

    An axis of levels has each of them about equally often.
    """
    rows = qmc.Sobol(len(axes), seed=seed).random_base2(math.ceil(math.log2(points)))[:points]
    return tuple(
        tuple(
            axis.value(float(place)) if axis.continuous else axis.values[int(place * len(axis.values))]
            for axis, place in zip(axes, row, strict=True)
        )
        for row in rows
    )
