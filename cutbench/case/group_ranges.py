"""How far a case's dimensionless groups are from those of the shipped materials: a slip of a unit shows here.

Each value of a case can be in its bounds and all of them together be of no material: a modulus in the wrong
unit, a viscous time that belongs to another speed. Which groups there are, and of what they are made, the
mechanisms say.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from cutbench.base.toml import read_toml
from cutbench.base.units import powers_of
from cutbench.case import materials
from cutbench.case.model import PROTOCOL, Model
from cutbench.case.values import SECTIONS, resolve

#: A group this many times beyond all shipped materials is far: what it does there nobody has measured, and a
#: wrong unit, or a time of another speed, is farther off.
MAX_RATIO = 3.0


@dataclass(frozen=True)
class UntypicalGroup:
    """A group outside ``low`` to ``high``, the range of the shipped materials; ``parameters`` make it up."""

    group: str
    value: float
    low: float
    high: float
    parameters: tuple[str, ...]
    advice: str = ""

    @property
    def times(self) -> float:
        """How many times it is beyond the nearest end of the range."""
        return self.value / self.high if self.value > self.high else self.low / self.value

    def __str__(self) -> str:
        span = f"{self.low:.3g}" if self.low == self.high else f"{self.low:.3g} to {self.high:.3g}"
        return (
            f"{self.group} = {self.value:.3g} is {self.times:.2g} times"
            f" {'above' if self.value > self.high else 'below'} what the known materials have ({span})."
            f" If that is not meant, look at the units of {', '.join(self.parameters)}{self.advice}"
        )


def untypical_groups(model: Model, values: Mapping[str, float]) -> list[UntypicalGroup]:
    """The groups of ``model`` with ``values`` (internal units) that are ``MAX_RATIO`` times beyond those of
    all shipped materials.

    Groups of numbers without units are left out: they are what a person has written. So are those that no
    shipped material has, and small ones that switching a mechanism off makes nought: less of it is nearer to
    nothing, which is always of interest.
    """
    far, ranges, known = [], _ranges(), model.parameters()

    def moved(group: str, name: str, to: float) -> float:
        return model.groups(model.namespace({**values, name: to}))[group]

    for group, value in model.groups(model.namespace(values)).items():
        low, high = ranges.get(group, (0.0, 0.0))
        if high <= 0 or value <= 0 or low / MAX_RATIO <= value <= MAX_RATIO * high:
            continue
        parts = [
            name for name, q in known.items()
            if q.unit != "1" and abs(moved(group, name, 1.5 * values[name]) - value) > 1e-9 * value
        ]  # fmt: skip
        offs = {name: known[name].off for name in parts}
        small = value < low and any(
            off is not None and moved(group, name, off * known[name].factor) == 0
            for name, off in offs.items()
        )
        if parts and not small:
            far.append(UntypicalGroup(group, value, low, high, tuple(parts), _rates(model, parts)))
    return far


def _rates(model: Model, parts: list[str]) -> str:
    """What to say of times in a group with the blade's speed: they go with it."""
    powers = {name: powers_of(q.unit) for name, q in model.parameters().items() if name in parts}
    rates = [name for name in parts if powers[name][0] == 0 and powers[name][1]]
    speeds = [q.name for q in PROTOCOL if q.name in rates]
    times = [name for name in rates if name not in speeds]
    if not speeds or not times:
        return ""
    many = len(times) > 1
    return (
        f", or {', '.join(times)} {'are' if many else 'is'} of another {speeds[0]}: "
        f"{'they count' if many else 'it counts'} by the product with it"
    )


@lru_cache(maxsize=1)
def _ranges() -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each group in the shipped materials."""
    seen: dict[str, list[float]] = {}
    for name in materials.names():
        table = read_toml(materials.find(name)).table
        model = Model(tuple(table["mechanisms"])) if "mechanisms" in table else Model()
        raw = {key: value for section in SECTIONS for key, value in table.get(section, {}).items()}
        groups = model.groups(model.namespace(resolve({}, raw, model)))
        for group, value in groups.items():
            seen.setdefault(group, []).append(value)
    return {group: (min(values), max(values)) for group, values in seen.items()}
