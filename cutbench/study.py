"""A study: a base case, the axes over which it is varied, and how its regimes are told apart.

``load_study`` reads TOML strictly: whatever it would have to guess or ignore is refused, with the
file, the line, the key, the value, and what would be right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from cutbench import materials
from cutbench.axes import Axis, read_axes, refuse_unknown, value_on
from cutbench.case import Case, load_case
from cutbench.errors import BadInput
from cutbench.model import Model, section_of
from cutbench.quantities import parse_quantity
from cutbench.reading import line_of, located, one_of, read_toml

_SECTIONS = ("parameters", "specimen", "blade", "protocol", "numerics")
_TOP = ("title", "base", "mechanisms", *_SECTIONS, "axis", "regime", "plot")


@dataclass(frozen=True)
class Plot:
    """Which axes a phase diagram shows (empty: none), and which materials it marks."""

    x: str
    y: str = ""
    panel: str = ""
    mark: tuple[str, ...] = ()


@dataclass(frozen=True)
class Mark:
    """Where a material lies: axis name -> value in the axis' unit."""

    name: str
    at: Mapping[str, float]


@dataclass(frozen=True)
class Study:
    """A validated study; every point is a valid case."""

    path: Path
    title: str
    text: str
    base: Case
    axes: tuple[Axis, ...]
    grid: tuple[Case, ...]
    drop: float
    surge_min: float | None
    onset_length_mm: float
    plot: Plot

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def points(self) -> Iterator[tuple[tuple[int, ...], Case]]:
        """All points with their index in the grid, row by row."""
        return zip(np.ndindex(self.shape), self.grid, strict=True)

    def cases(self) -> list[Case]:
        """All points, coarse to fine: any beginning of the list is spread over the whole map."""
        return [self.grid[i] for i in self._order]

    @cached_property
    def _order(self) -> tuple[int, ...]:
        return coarse_to_fine(self.shape)

    def marks(self) -> list[Mark]:
        """The marked materials on the study's axes."""
        found = []
        for name in self.plot.mark:
            case = load_case(name)
            at = {axis.name: value_on(axis, case) for axis in self.axes}
            missing = [n for n, value in at.items() if value is None]
            if missing:
                raise BadInput(
                    file=str(self.path), key="mark", value=name, line=line_of(self.text, "mark", "plot"),
                    expected=f"materials that have a value of {', '.join(missing)}",
                )  # fmt: skip
            found.append(Mark(case.name, at))
        return found


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


def load_study(path: str | Path) -> Study:
    """The study in a TOML file; every error a person can make in it is a BadInput."""
    path = Path(path)
    table, text = read_toml(path)
    with located(path, text):
        refuse_unknown(table, _TOP)
        title = table.get("title", path.stem)
        if not isinstance(title, str) or not title.strip():
            raise BadInput(key="title", value=title, expected="a title, such as 'Smooth and abrupt cutting'")
        start = _base(table, path)
    changes = _changes(table, path, text, start.model)
    with located(path, text):
        base = start.set(**changes)
    axes = read_axes(table, path, text, base.model, changes)
    with located(path, text, "regime"):
        drop, surge_min, onset_length_mm = _regime(_section(table, "regime"))
    with located(path, text, "plot"):
        plot = _plot(_section(table, "plot"), axes)
    with located(path, text):
        # Groups of the sections are solved anew at each point: they hold along the axes.
        grid = tuple(
            start.set(**changes, **{a.name: a.text(i) for a, i in zip(axes, index, strict=True)})
            for index in np.ndindex(*(len(a.values) for a in axes))
        )
    study = Study(path, title, text, base, axes, grid, drop, surge_min, onset_length_mm, plot)
    study.marks()
    return study


def _base(table: dict, path: Path) -> Case:
    if "base" not in table:
        raise BadInput(
            key="base",
            value="(missing)",
            expected=f"a material ({', '.join(materials.names())}) or a case file",
        )
    source = table["base"]
    if not isinstance(source, str):
        raise BadInput(key="base", value=source, expected="a material's name or a case file")
    near = path.parent / source
    case = load_case(near if near.is_file() else source)
    return case.set(mechanisms=table["mechanisms"]) if "mechanisms" in table else case


def _changes(table: dict, path: Path, text: str, model: Model) -> dict[str, object]:
    """What the sections set, as ``Case.set`` takes it."""
    known = model.parameters()
    changes: dict[str, object] = {}
    for section in _SECTIONS:
        with located(path, text, section):
            part = _section(table, section)
            for key, raw in part.items():
                if key in known and section_of(key) != section:
                    raise BadInput(
                        key=key, value=raw, expected=f"it in [{section_of(key)}], not in [{section}]"
                    )
                if key in ("name", "with", "with_", "without", "mechanisms"):
                    raise BadInput(key=key, value=raw, expected=f"a quantity in [{section}]")
                if key in changes:
                    raise BadInput(key=key, value=raw, expected="each quantity once")
            changes |= part
    return changes


def _regime(part: dict) -> tuple[float, float | None, float]:
    refuse_unknown(part, ("drop", "surge", "onset_length"))
    drop = _between(part, "drop", 0.1, 0, 1)
    surge = _between(part, "surge", None, 0, math.inf) if "surge" in part else None
    length = parse_quantity(part.get("onset_length", "0.1 mm"), "mm", key="onset_length")
    if not 0 < length < math.inf:
        raise BadInput(
            key="onset_length", value=part["onset_length"], expected="a length above 0, such as '0.1 mm'"
        )
    return drop, surge, length


def _between(part: dict, key: str, default: float | None, low: float, high: float) -> float:
    value = parse_quantity(part.get(key, default), "1", key=key)
    if not low < value < high:
        wanted = f"{low:g} < {key} < {high:g}" if math.isfinite(high) else f"{low:g} < {key}"
        raise BadInput(key=key, value=part.get(key), expected=f"a number, {wanted}")
    return value


def _plot(part: dict, axes: tuple[Axis, ...]) -> Plot:
    refuse_unknown(part, ("x", "y", "panel", "mark"))
    names = [axis.name for axis in axes]
    chosen: dict[str, str] = {}
    for key in ("x", "y", "panel"):
        if key in part:
            name = part[key]
            if name not in names:
                raise BadInput(key=key, value=name, expected=one_of(str(name), names))
            if name in chosen.values():
                raise BadInput(key=key, value=name, expected="an axis that the picture does not show already")
            chosen[key] = name
    free = [name for name in names if name not in chosen.values()]
    for key in ("x", "y", "panel"):
        if key not in chosen:
            chosen[key] = free.pop(0) if free else ""
    mark = part.get("mark", [])
    if not isinstance(mark, list) or not all(isinstance(m, str) for m in mark):
        raise BadInput(
            key="mark", value=str(mark), expected=f"a list of materials, such as {materials.names()}"
        )
    for name in mark:
        if name not in materials.names():
            raise BadInput(key="mark", value=name, expected=one_of(name, materials.names()))
    return Plot(**chosen, mark=tuple(mark))


def _section(table: dict, name: str) -> dict:
    part = table.get(name, {})
    if not isinstance(part, dict):
        raise BadInput(key=name, value=str(part), expected=f"a section, written [{name}]")
    return part
