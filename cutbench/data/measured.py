"""Cuts of which no curve is known but some numbers: where it gave way, by how much the force fell.

Literature and texture analysers give such measures. Each is a value with its standard deviation, an interval
or one end of one. All are counted in their own standard deviations, and none is correlated with another: on
that grid they are readings as those of a curve are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import log_ndtr

from cutbench.base.errors import BadInput, in_short
from cutbench.base.toml import among
from cutbench.base.units import parse_quantity
from cutbench.data.experiment import Experiment
from cutbench.data.experiment_kinds import section_of
from cutbench.data.repetition import Averaged, Repetition
from cutbench.data.table import read_table
from cutbench.run.read_off import READ_OFF, ForceCurve

#: How sharp the end of an interval is meant that is written without its own ±, as a part of it.
SHARP = 0.05
#: An interval that is narrower than this, in standard deviations, is a value.
NARROW = 1e-3
#: Fewest specimens whose scatter says how well their mean is known.
SPECIMENS = 4
_NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
_BELOW, _ABOVE = ("<", "at most"), (">", "at least")
_WRITTEN = "a value such as '4.2 ± 0.3 mm', an interval such as '12 to 16 N', or one end, '> 0.3' or '< 5 %'"


@dataclass(frozen=True)
class Measure:
    """A measured number of a cut.

    Attributes
    ----------
    name : str
        Which of ``READ_OFF``.
    low, high : float
        The ends of the interval in which it lies; infinite where there is none, both the same of a value.
    sd : float
        Standard deviation of the value, or of either end.
    """

    name: str
    low: float
    high: float
    sd: float

    @classmethod
    def of(cls, name: str, raw: object, key: str = "") -> Measure:
        """Read what a person wrote. Raises BadInput."""
        key = key or f"measures.{name}"
        among(key, name, READ_OFF, value=in_short(raw))
        unit = READ_OFF[name][0]
        if not isinstance(raw, str):
            raise BadInput(key=key, value=in_short(raw), expected=_WRITTEN)
        text = " ".join(raw.replace("+-", "±").replace("+/-", "±").split())
        sign = next((s for s in (*_BELOW, *_ABOVE) if text.startswith(s)), "")
        text = text.removeprefix(sign).strip()
        match = re.fullmatch(rf"({_NUMBER})(?: ?(to|±) ?({_NUMBER}))?(?: ?± ?({_NUMBER}))?(.*)", text)
        if match is None or (sign and match[2] == "to") or (match[2] == "±" and match[4]):
            raise BadInput(key=key, value=raw, expected=_WRITTEN)

        def number(part: str) -> float:
            return parse_quantity(f"{part} {match[5]}".strip(), unit, key=key)

        first = number(match[1])
        second = number(match[3]) if match[2] == "to" else first
        given = match[3] if match[2] == "±" else match[4]
        sd = number(given) if given else SHARP * max(abs(first), abs(second))
        alone = not sign and match[2] != "to"
        if not sd > 0 or (alone and not given):
            raise BadInput(key=key, value=raw, expected="its standard deviation, such as '4.2 ± 0.3 mm'")
        if match[2] == "to" and not first < second:
            raise BadInput(key=key, value=raw, expected="the smaller end first, such as '12 to 16 N'")
        low, high = -math.inf if sign in _BELOW else first, math.inf if sign in _ABOVE else second
        return cls(name, low, high, sd)

    @property
    def unit(self) -> str:
        """As in ``READ_OFF``."""
        return READ_OFF[self.name][0]

    @property
    def value(self) -> float:
        """The value, the middle of the interval, or its only end."""
        ends = [end for end in (self.low, self.high) if math.isfinite(end)]
        return sum(ends) / len(ends)

    def deviation(self, y: float) -> float:
        """How far ``y`` is off, in standard deviations: minus half its square is the logarithm of the
        likelihood, 0 at its largest."""
        half = (self.high - self.low) / 2 / self.sd
        if half < NARROW:
            return (y - self.value) / self.sd
        a, b = (y - self.low) / self.sd, (y - self.high) / self.sd
        if math.isfinite(half):
            side, most = math.copysign(1.0, y - self.value), _log_between(half, -half)
        else:
            side, most = (-1.0 if math.isfinite(self.low) else 1.0), 0.0
        return side * math.sqrt(max(2 * (most - _log_between(a, b)), 0.0))

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.low == self.high:
            return f"{self.value:.4g} ± {self.sd:.2g}{unit}"
        if math.isinf(self.low) or math.isinf(self.high):
            return f"{'<' if math.isinf(self.low) else '>'} {self.value:.4g}{unit}"
        return f"{self.low:.4g} to {self.high:.4g}{unit}"


def _log_between(a: float, b: float) -> float:
    """log(Φ(a) − Φ(b)) for a > b, in the tail where nothing is lost."""
    if b > 0:
        a, b = -b, -a
    upper, lower = float(log_ndtr(a)), float(log_ndtr(b))
    return upper + math.log1p(-math.exp(lower - upper))


@dataclass(frozen=True, eq=False)
class MeasuredCut(Experiment):
    """A cut of which ``measures`` are known, to ``depth_mm``. What an ``Experiment`` has of readings it has
    of them: one repetition, at 1, 2, …, in standard deviations."""

    measures: tuple[Measure, ...] = ()
    depth_mm: float = math.nan

    @classmethod
    def of(
        cls,
        id: str,
        measures: tuple[Measure, ...],
        depth_mm: float,
        specimen: Mapping[str, float],
        blade: Mapping[str, float],
        speed: float | None,
        role: str = "train",
        notes: tuple[str, ...] = (),
    ) -> MeasuredCut:
        """Make one; lengths in mm, speed in mm/s. Raises BadInput."""
        if not measures:
            raise BadInput(key="measures", value="none", expected=_WRITTEN)
        number = np.arange(1.0, len(measures) + 1)
        readings = Repetition(number, np.array([m.value / m.sd for m in measures]))
        return cls(
            id, "cut", (readings,), role, specimen, blade, speed, notes=notes, measures=measures,
            depth_mm=depth_mm,
        )  # fmt: skip

    curve = False
    x_name, y_name, x_unit, y_unit = "measure", "measure", "1", "sd"

    @property
    def reach(self) -> float:
        return self.depth_mm

    def _faults(self, r: Repetition):
        return iter(())

    def _common_range(self) -> None:
        if not (math.isfinite(self.depth_mm) and self.depth_mm > 0):
            raise BadInput(
                key="depth", value=f"{self.depth_mm:g} mm", expected="a depth above 0, such as '12 mm'"
            )

    def on_grid(self, n: int = 80) -> Averaged:
        """The measures, each by itself."""
        r, one = self.repetitions[0], np.ones(len(self.measures))
        return Averaged(r.x, r.y, 0 * one, one, r.y[None], independent=True)

    def read_off(self, d: np.ndarray, force: np.ndarray) -> list[float]:
        """The measures, each in its unit, of a curve of travel (n,) in mm and force (n,) in N; nan of one
        that the curve does not have."""
        there = d <= self.depth_mm * (1 + 1e-9)
        curve = ForceCurve(d[there], force[there], self.blade["thickness"])
        return [READ_OFF[m.name][2](curve) for m in self.measures]

    def read(self, d: np.ndarray, force: np.ndarray) -> np.ndarray:
        """The same (m,) as readings; one that the curve does not have would come at its end."""
        last = [self.depth_mm if m.unit == "mm" else 0.0 for m in self.measures]
        found = np.where(np.isnan(values := self.read_off(d, force)), last, values)
        each = zip(self.measures, found, strict=True)
        return np.array([m.value / m.sd + m.deviation(float(y)) for m, y in each])


def read_measured(
    table: Mapping[str, object], folder: Path
) -> tuple[tuple[Measure, ...], float, tuple[str, ...]]:
    """The measures of an [[experiment]], the depth in mm, and notes. Raises BadInput."""
    if "depth" not in table:
        raise BadInput(
            key="depth", value="(missing)", expected="how deep the blade went, as in depth = '12 mm'"
        )
    depth = parse_quantity(table["depth"], "mm", key="depth")
    listed = table["measures"]
    if not isinstance(listed, list):
        written = section_of(table, "measures")
        return tuple(Measure.of(name, raw) for name, raw in written.items()), depth, ()
    if not isinstance(data := table.get("data"), str):
        expected = "the table with a row a specimen, such as data = 'specimens.csv'"
        raise BadInput(key="data", value=in_short(data), expected=expected)
    for name in listed:
        among("measures", name, READ_OFF, value=in_short(listed))
    titles = section_of(table, "columns")
    columns = {str(name): titles.get(name, str(name)) for name in listed}
    read = read_table(folder / data, columns, section_of(table, "units"))
    count = read.lines.size
    if count < SPECIMENS:
        expected = f"{SPECIMENS} rows or more, a specimen each, or measures with their ± in the campaign"
        raise BadInput(key="data", value=f"{count} rows", file=str(folder / data), expected=expected)
    # A mean whose scatter is estimated from few has Student's distribution, and this standard deviation.
    wider, found = math.sqrt((count - 1) / (count - 3) / count), []
    for name, values in read.columns.items():
        mean, sd = float(values.mean()), wider * float(values.std(ddof=1))
        if not sd > 0:
            raise BadInput(
                key=name, value="one value", file=str(folder / data), expected="values that scatter"
            )
        found.append(Measure(name, mean, mean, sd))
    return tuple(found), depth, (f"means of {count} specimens", *read.notes)
