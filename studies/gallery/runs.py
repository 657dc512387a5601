"""The runs of a gallery: cases from the folders of ``studies/published``, each computed once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cutbench.case.case import Case, load_case
from cutbench.run.result import Result

PUBLISHED = Path(__file__).parents[1] / "published"
#: The last part of the travel, over which cutting is steady.
LAST = 1 / 3


@dataclass(frozen=True)
class Run:
    """A case of a folder, or a known material, with changes."""

    source: str
    changes: Mapping[str, object] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        file = PUBLISHED / self.source / "case.toml"
        return load_case(file if file.exists() else self.source, self.changes)


def wires(source: str, diameters_mm: Iterable[float], **changes) -> dict[float, Run]:
    """One a diameter, with all lengths of the block in proportion to it."""
    times = {"thickness": 1, "precut": 4, "width": 50, "height": 40, "depth": 9}
    return {
        d: Run(source, {**{name: f"{d * k:g} mm" for name, k in times.items()}, **changes})
        for d in diameters_mm
    }


def steady(result: Result) -> float:
    """Force per length of the blade, N/mm, where cutting is steady."""
    d, F = result.displacement_mm, result.force_N
    last = d > d[-1] * (1 - LAST)
    return float(np.trapezoid(F[last], d[last]) / np.ptp(d[last]) / result.case.p.length)


def onset(result: Result) -> float:
    """Travel at which the cut begins, mm; nan where it does not."""
    return float(result.measures["onset_mm"])


def onset_force(result: Result) -> float:
    """Force there, N."""
    return float(np.interp(onset(result), result.displacement_mm, result.force_N))


def slope(line: Mapping[float, float]) -> tuple[float, float]:
    """Of a straight line through points: where it begins, and how steep it is."""
    steep, begins = np.polyfit([*line], [*line.values()], 1)
    return float(begins), float(steep)


def exponent(line: Mapping[float, float]) -> float:
    """Of a power law through points."""
    return slope({float(np.log(x)): float(np.log(y)) for x, y in line.items()})[1]
