"""The design space of the atlas: the ranges of dimensionless groups that its runs fill."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutbench.case.case import Case, load_case

#: Part of a side that ends in a value of 0, in which the value *is* 0: many a user has no friction.
FRACTION_SWITCHED_OFF = 0.2
#: A run ends this far down: as a part of the specimen's height, and in halves of the blade's thickness.
MAX_DEPTH_FRACTION, MAX_DEPTH = 0.8, 40.0


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
    """

    name: str
    low: float
    high: float
    kind: str = "log"
    unit: float = 1.0

    def coordinate(self, value: np.ndarray) -> np.ndarray:
        """Where values are, as the emulator takes them."""
        value = np.asarray(value, dtype=float)
        if self.kind == "log":
            return np.log(np.maximum(value, 1e-300))
        return np.arcsinh(value / self.unit) if self.kind == "asinh" else -np.log1p(-2 * value)

    def value(self, part: float) -> float:
        """The value at a part (0 to 1) of the side, six digits."""
        if self.kind == "asinh":
            part = max(0.0, (part - FRACTION_SWITCHED_OFF) / (1 - FRACTION_SWITCHED_OFF))
        low, high = self.coordinate(np.array([self.low, self.high]))
        at = low + part * (high - low)
        back = {
            "log": math.exp,
            "asinh": lambda x: self.unit * math.sinh(x),
            "incompressible": lambda x: -math.expm1(-x) / 2,
        }
        return float(f"{back[self.kind](at):.6g}")


@dataclass(frozen=True)
class DesignSpace:
    """The sides, and the material whose model and units its cases have."""

    material: str
    ranges: tuple[GroupRange, ...]

    @cached_property
    def base(self) -> Case:
        """The case whose groups are set."""
        return load_case(self.material)

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
        groups = dict(zip([side.name for side in self.ranges], values, strict=True))
        half, known = self.base.values["thickness"] / 2, self.base.model.parameters()
        lengths = {name for name in groups if name in known and known[name].unit == "mm"}
        changes = {n: f"{half * v:.6g} mm" if n in lengths else v for n, v in groups.items()}
        return self.base.set(
            **changes, depth=f"{half * min(MAX_DEPTH_FRACTION * groups['height'], MAX_DEPTH):.6g} mm"
        )


#: A blunt blade with an elliptic tip.
BLUNT_BLADES = DesignSpace(
    "gelatin",
    (
        GroupRange("cohesion", 1.0, 15.0),
        GroupRange("viscosity", 0.003, 10.0),
        GroupRange("adhesion", 0.0, 0.3, "asinh", 0.03),
        GroupRange("mu", 0.0, 0.5, "asinh", 0.05),
        GroupRange("delta_c", 0.1, 0.4),
        GroupRange("surface_length", 0.05, 0.4),
        GroupRange("width", 40.0, 160.0),
        GroupRange("height", 30.0, 120.0),
        GroupRange("nu", 0.45, 0.4995, "incompressible"),
        GroupRange("tip", 1.5, 6.0),
    ),
)
