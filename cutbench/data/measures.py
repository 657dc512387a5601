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

from cutbench.base.errors import require
from cutbench.base.toml import among
from cutbench.base.units import parse_quantity
from cutbench.data.experiment import Experiment
from cutbench.data.experiment_section import section_of
from cutbench.data.repetition import Averaged, Repetition
from cutbench.data.table import read_table
from cutbench.run.measures import READ_OFF, ForceCurve

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
        among(key, name, READ_OFF, value=raw)
        text = " ".join(str(raw).replace("+-", "±").replace("+/-", "±").split())
        sign = next((s for s in (*_BELOW, *_ABOVE) if text.startswith(s)), "")
        text = text.removeprefix(sign).strip()
        match = re.fullmatch(rf"({_NUMBER})(?: ?(to|±) ?({_NUMBER}))?(?: ?± ?({_NUMBER}))?(.*)", text)
        first, joint, second, last, unit = match.groups() if match else ("", "", "", "", "")
        good = first and not (sign and joint == "to") and not (joint == "±" and last)
        require(isinstance(raw, str) and good, key, raw, _WRITTEN)

        def number(part: str) -> float:
            return parse_quantity(f"{part} {unit}".strip(), READ_OFF[name][0], key=key)

        low, error = number(first), second if joint == "±" else last
        high = number(second) if joint == "to" else low
        # Without its own ± the end of an interval is meant so sharp, as a part of it.
        sd = number(error) if error else 0.05 * max(abs(low), abs(high))
        known = sd > 0 and (sign or joint == "to" or error)
        require(known, key, raw, "its standard deviation, such as '4.2 ± 0.3 mm'")
        ordered = joint != "to" or low < high
        require(ordered, key, raw, "the smaller end first, such as '12 to 16 N'")
        return cls(name, -math.inf if sign in _BELOW else low, math.inf if sign in _ABOVE else high, sd)

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
        if half < 1e-3:  # so narrow, in standard deviations, it is a value
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
        require(measures, "measures", "none", _WRITTEN)
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
        good = math.isfinite(self.depth_mm) and self.depth_mm > 0
        require(good, "depth", f"{self.depth_mm:g} mm", "a depth above 0, such as '12 mm'")

    def on_grid(self, n: int = 80) -> Averaged:
        """The measures, each by itself."""
        r, one = self.repetitions[0], np.ones(len(self.measures))
        return Averaged(r.x, r.y, 0 * one, one, r.y[None], independent=True)

    def read_off(self, d: np.ndarray, force: np.ndarray) -> list[float]:
        """The measures, each in its unit, of a curve of travel (n,) in mm and force (n,) in N; nan of one
        that the curve does not have."""
        cut = d <= self.depth_mm * (1 + 1e-9)
        curve = ForceCurve(d[cut], force[cut], self.blade["thickness"])
        return [READ_OFF[m.name][2](curve) for m in self.measures]

    def read(self, d: np.ndarray, force: np.ndarray) -> np.ndarray:
        """The same (m,) as readings; one that the curve does not have would come at its end."""
        last = [self.depth_mm if m.unit == "mm" else 0.0 for m in self.measures]
        values = self.read_off(d, force)
        each = zip(self.measures, np.where(np.isnan(values), last, values), strict=True)
        return np.array([m.value / m.sd + m.deviation(float(y)) for m, y in each])


def read_measures(
    table: Mapping[str, object], folder: Path
) -> tuple[tuple[Measure, ...], float, tuple[str, ...]]:
    """The measures of an [[experiment]], the depth in mm, and notes. Raises BadInput."""
    require("depth" in table, "depth", None, "how deep the blade went, as in depth = '12 mm'")
    depth = parse_quantity(table["depth"], "mm", key="depth")
    listed, data = table["measures"], table.get("data")
    if not isinstance(listed, list):
        section = section_of(table, "measures")
        return tuple(Measure.of(name, raw) for name, raw in section.items()), depth, ()
    expected = "the table with a row a specimen, such as data = 'specimens.csv'"
    require(isinstance(data, str), "data", data, expected)
    for name in listed:
        among("measures", name, READ_OFF, value=listed)
    file, titles = folder / str(data), section_of(table, "columns")
    columns = {str(name): titles.get(name, str(name)) for name in listed}
    read = read_table(file, columns, section_of(table, "units"))
    count = read.lines.size
    expected = f"{SPECIMENS} rows or more, a specimen each, or measures with their ± in the campaign"
    require(count >= SPECIMENS, "data", f"{count} rows", expected, file)
    # A mean whose scatter is estimated from few has Student's distribution, and this standard deviation.
    wider, measures = math.sqrt((count - 1) / (count - 3) / count), []
    for name, values in read.columns.items():
        mean, sd = float(values.mean()), wider * float(values.std(ddof=1))
        require(sd > 0, name, "one value", "values that scatter", file)
        measures.append(Measure(name, mean, mean, sd))
    return tuple(measures), depth, (f"means of {count} specimens", *read.notes)
