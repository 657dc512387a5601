"""Dimensionless groups: in which units cuts of one kind are samples of one function.

Without inertia a cut knows no stress, length and time but its own (Buckingham 1914, 10.1103/PhysRev.4.345):
in units of a modulus, of half the blade's thickness and of the time in which the blade goes as far, cuts at
several speeds, of softer and tougher gels and with thicker blades are samples of one function.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cutbench.base.units import Parameter, dimensions_of
from cutbench.case.case import Case
from cutbench.case.model import Model


@dataclass(frozen=True)
class Groups:
    """Groups make the values of a model's cuts dimensionless.

    The units are a modulus, half the blade's thickness, and the blade's speed.

    Attributes
    ----------
    modulus : str
        The parameter, in MPa, that is the unit of stress.
    powers : mapping of str to (float, float, float)
        By parameter that a cut depends on: its powers of force, length and time.
    plane : bool
        Whether forces are in proportion to the length along the blade.
    """

    modulus: str
    powers: Mapping[str, tuple[float, float, float]]
    plane: bool

    @classmethod
    def of(cls, case: Case) -> Groups | None:
        """Make the groups of a case's model."""
        powers, values = _powers(case.mechanisms), case.values
        stress = [n for n, (force, length, time) in powers.items() if (force, length, time) == (1, -2, 0)]
        modulus = next((n for n in stress if values[n] > 0), None)
        if modulus is None or not (values["speed"] > 0 and values.get("thickness", 0) > 0):
            return None
        plane = case.dim == 2
        return cls(modulus, {n: p for n, p in powers.items() if not (plane and n == "length")}, plane)

    def reduced(self, values: Mapping[str, float]) -> dict[str, float]:
        """Compute all parameters that a cut depends on, in these units."""
        stress, length = values[self.modulus], self.length(values)
        time = length / values["speed"]
        return {
            n: values[n] / (stress**force * length ** (2 * force + of_length) * time**of_time)
            for n, (force, of_length, of_time) in self.powers.items()
        }

    def length(self, values: Mapping[str, float]) -> float:
        """Return the unit of length, half the blade's thickness."""
        return values["thickness"] / 2

    def force(self, values: Mapping[str, float]) -> float:
        """Return the unit of force."""
        along = values["length"] if self.plane else self.length(values)
        return values[self.modulus] * self.length(values) * along


@lru_cache
def _powers(mechanisms: tuple[str, ...]) -> dict[str, tuple[float, float, float]]:
    """Of all that the course of a run depends on: neither rigs, nor speed, nor how far it goes."""
    model = Model(mechanisms)
    no_part = {q.name for law in model.laws("rig") for q in law.parameters} | {"speed", "depth"}
    return {n: dimensions_of(q.unit) for n, q in model.parameters().items() if n not in no_part}


@dataclass(frozen=True)
class Coordinate:
    """How a group is a coordinate: by its logarithm where it is above 0 by its nature, by its inverse
    hyperbolic sine where a value switches its effect off, else as it is.

    ``unit``: below it, a tenth of what is typical, the inverse hyperbolic sine goes in proportion.
    """

    name: str
    kind: str
    unit: float = 1.0

    @classmethod
    def of(cls, q: Parameter, groups: Groups, values: Mapping[str, float]) -> Coordinate:
        """Of a parameter; ``values``: those of a case, whose units make the typical value a group."""
        if q.off is not None:
            typical = abs(q.typical * q.factor) or 1.0
            reduced = groups.reduced({**values, q.name: typical})[q.name]
            return cls(q.name, "asinh", 0.1 * abs(reduced) or 1.0)
        return cls(q.name, "log" if q.low == 0 and q.open_low else "as it is")

    def of_values(self, group: np.ndarray) -> np.ndarray:
        """The coordinate of values of the group."""
        if self.kind == "log":
            return np.log(np.maximum(group, 1e-300))
        return np.arcsinh(group / self.unit) if self.kind == "asinh" else np.asarray(group, dtype=float)


def is_same_value(a: float, b: float) -> bool:
    """Whether two values of a group are one."""
    return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-300)
