"""The design spaces of the atlas: the ranges of dimensionless groups that its runs fill, a blade each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cutbench.case.case import Case, load_case
from cutbench.case.model import Model, groups
from cutbench.emulator.groups import Coordinate, Groups

#: A run ends this far down, in halves of the blade's thickness.
MAX_DEPTH = 40.0


@dataclass(frozen=True)
class GroupRange:
    """The range of one group: a side of the box that the runs fill.

    Attributes
    ----------
    name : str
        The group, as ``Groups.reduced`` names it: a parameter in units of the modulus, of half the blade's
        thickness and of the time in which the blade goes as far. ``cohesion``, ``viscosity`` and
        ``adhesion`` are the groups of these names.
    low, high : float
        Its ends.
    kind : {"log", "asinh", "incompressible"}
        Along what it is even: the logarithm; the inverse hyperbolic sine, from 0 on, where a value switches
        its effect off; the logarithm of 1 − 2 ν.
    unit : float
        Below it, the inverse hyperbolic sine goes in proportion.
    least : float
        What is not 0 is at least this: a slit that is shorter than the edge is round is none.
    off : float
        Part of a side that ends in a value of 0, in which the value *is* 0: many a user has no friction, and
        most have no slit.
    """

    name: str
    low: float
    high: float
    kind: str = "log"
    unit: float = 1.0
    least: float = 0.0
    off: float = 0.2

    def coordinate(self, value: np.ndarray) -> np.ndarray:
        """Where values are, as the emulator takes them."""
        if self.kind == "incompressible":
            return -np.log1p(-2 * np.minimum(value, 0.5 - 1e-9))  # what is above counts as a half
        return Coordinate(self.name, self.kind, self.unit).of_values(np.asarray(value, dtype=float))

    def holds(self, value: np.ndarray | float, margin: float = 0.0) -> np.ndarray | bool:
        """Whether values are within it, and a ``margin`` of so many of its lengths."""
        low, high = self.coordinate(np.array([self.low, self.high]))
        more, at = (margin + 1e-6) * (high - low), self.coordinate(np.asarray(value))
        return (low - more <= at) & (at <= high + more)

    def value(self, part: float) -> float:
        """The value at a part (0 to 1) of the side, six digits."""
        if self.kind == "asinh":
            part = (part - self.off) / (1 - self.off)
            if part <= 0:
                return 0.0
        low, high = self.coordinate(np.array([self.low or self.least, self.high]))
        at = low + part * (high - low)
        back = {
            "log": math.exp,
            "asinh": lambda x: self.unit * math.sinh(x),
            "incompressible": lambda x: -math.expm1(-x) / 2,
        }
        return float(f"{back[self.kind](at):.6g}")


@dataclass(frozen=True)
class DesignSpace:
    """The sides, and the material and the blade whose model and units its cases have."""

    material: str
    blade: str
    ranges: tuple[GroupRange, ...]

    @cached_property
    def base(self) -> Case:
        """The case whose groups are set."""
        return load_case(self.material, {"with_": self.blade})

    @cached_property
    def parameters(self) -> dict[str, str]:
        """By side the parameter that sets it."""
        known = groups()
        return {s.name: known[s.name].parameter if s.name in known else s.name for s in self.ranges}

    def of_values(self, units: Groups, model: Model, values: Mapping[str, Any]) -> list[Any]:
        """The groups, a side each, of values in internal units, numbers or arrays; 0 where there is none."""
        reduced, p, known = units.reduced(values), model.namespace(values), groups()
        return [
            0.0 * values[units.modulus] if self.parameters[s.name] not in values
            else known[s.name].value(p) if s.name in known else reduced[s.name]
            for s in self.ranges
        ]  # fmt: skip

    def beyond(
        self, found: Sequence[float], margins: Mapping[str, float] | None = None
    ) -> list[tuple[GroupRange, float]]:
        """Sides that do not hold their values, with these; ``margins``: by side, the part beyond it that is
        held, too."""
        more = margins or {}
        return [
            (s, v) for s, v in zip(self.ranges, found, strict=True) if not s.holds(v, more.get(s.name, 0.0))
        ]

    def outside(self, side: GroupRange, value: float, case: Case) -> tuple[str, str, str]:
        """What is wrong with a value of a side, for a case that has it: the parameter, its value, and the
        nearest value within."""
        name, nearest = self.parameters[side.name], min(max(value, side.low), side.high)
        q, group = case.model.parameters()[name], groups().get(side.name)
        at = case.values[name] * nearest / value if group is None else group.solve(case.p, nearest)
        text = group.text if group else f"{name}/a" if q.unit == "mm" else name
        found = f"the atlas has {text} from {side.low:g} to {side.high:g}, and here it is {value:.3g}"
        return name, q.show(case.values[name]), f"{q.show(at)} or another blade or speed: {found}"

    def points(self, count: int, seed: int) -> np.ndarray:
        """Parts (count, d) of the sides: the first of Sobol's sequence, scrambled, so that the first half of
        them fills the box, too (10.1145/641876.641879)."""
        from scipy.stats import qmc  # takes a while to load, and estimates do without

        made = qmc.Sobol(len(self.ranges), scramble=True, seed=np.random.default_rng(seed))
        return made.random_base2(math.ceil(math.log2(max(count, 2))))[:count]

    def case(self, parts: np.ndarray) -> Case:
        """The case at parts (d,) of the sides."""
        return self.case_of([side.value(float(part)) for side, part in zip(self.ranges, parts, strict=True)])

    def case_of(self, values: Sequence[float]) -> Case:
        """The case whose groups have values (d,)."""
        asked = dict(zip([side.name for side in self.ranges], values, strict=True))
        half, known = self.base.values["thickness"] / 2, self.base.model.parameters()
        units = {"mm": (half, "mm"), "deg": (math.degrees(1), "deg")}

        def text(name: str, value: float) -> object:
            size, unit = units.get(known[name].unit if name in known else "", (1.0, ""))
            return f"{size * value:.6g} {unit}" if unit else value

        changes = {name: text(name, value) for name, value in asked.items()}
        # No blade goes deeper than four fifths of its specimen.
        return self.base.set(**changes, depth=f"{half * min(0.8 * asked['height'], MAX_DEPTH):.6g} mm")


#: What blades of every kind have.
COMMON = (
    GroupRange("cohesion", 1.0, 50.0),
    GroupRange("viscosity", 0.0, 10.0, "asinh", unit=0.02, least=0.003, off=0.1),
    GroupRange("adhesion", 0.0, 0.3, "asinh", 0.03),
    GroupRange("mu", 0.0, 0.4, "asinh", 0.05),
    GroupRange("delta_c", 0.08, 0.4),
    GroupRange("surface_length", 0.03, 0.4),
    GroupRange("width", 40.0, 160.0),
    GroupRange("height", 30.0, 120.0),
    GroupRange("nu", 0.45, 0.4995, "incompressible"),
    GroupRange("precut", 0.0, 8.0, "asinh", unit=1.0, least=0.5, off=0.75),
)
#: By the name of the blade's law: what the atlas has runs of.
BLADES = {
    "contact": DesignSpace("gelatin", "contact", (*COMMON, GroupRange("tip", 1.0, 6.0))),
    "wedge": DesignSpace(
        "gelatin_recalibrated",
        "wedge",
        (
            *COMMON,
            GroupRange("angle", math.radians(12), math.radians(40)),
            GroupRange("edge_radius", 0.05, 0.3),
            GroupRange("shoulder", 0.3, 1.2),
        ),
    ),
    "wire": DesignSpace("gelatin", "wire", COMMON),
}
#: All sides that a blade has; a case has no number of those of other blades.
SIDES = tuple({side.name: side for space in BLADES.values() for side in space.ranges}.values())
