"""The runs of a gallery: cases from the folders of ``studies/published``, each computed once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cutbench.case.case import Case, load_case
from cutbench.data.campaign import load_campaign
from cutbench.run.result import Result

PUBLISHED = Path(__file__).parents[1] / "published"


@dataclass(frozen=True)
class Run:
    """A case of a folder, or a known material, with changes."""

    source: str
    changes: Mapping[str, object] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        file = PUBLISHED / self.source / "case.toml"
        return load_case(file if file.exists() else self.source, self.changes)

    def saturating(self, times: float = 1.0) -> Run:
        """The same with friction that saturates at the pressure G/``times``."""
        inverse = f"{times / (1e3 * self.case.p.G):.6g} 1/kPa"
        return Run(self.source, {**self.changes, "with_": "coulomb_saturating", "inv_p_s": inverse})


def wires(source: str, diameters_mm: Iterable[float], travel: float = 11, **changes) -> dict[float, Run]:
    """One a diameter, all lengths of the block in proportion to it, to so many diameters of ``travel``."""
    times = {"thickness": 1, "precut": 4, "width": 50, "height": 40, "depth": travel}
    return {
        d: Run(source, {**{name: f"{d * k:g} mm" for name, k in times.items()}, **changes})
        for d in diameters_mm
    }


def steady(result: Result) -> float:
    """F/(b G_c) where the cut keeps pace with the blade; nan where it does not."""
    return float(result.measures["steady_N"]) / (result.case.p.length * result.case.p.G_c)


def onset(result: Result) -> float:
    """Travel at which the cut begins, mm; nan where it does not."""
    return float(result.measures["onset_mm"])


def onset_force(result: Result) -> float:
    """Force there, N."""
    return float(np.interp(onset(result), result.displacement_mm, result.force_N))


def measured_onset(material: str) -> tuple[float, float]:
    """Travel at which indentation is published to end, mm, and its error."""
    (first, *_) = load_campaign(PUBLISHED / f"{material}.toml").experiments
    (one,) = (m for m in first.measures if m.name == "onset")
    return one.value, one.sd


def slope(line: Mapping[float, float]) -> tuple[float, float]:
    """Of a straight line through points: where it begins, and how steep it is."""
    steep, begins = np.polyfit([*line], [*line.values()], 1)
    return float(begins), float(steep)


def exponent(line: Mapping[float, float]) -> float:
    """Of a power law through points."""
    return slope({float(np.log(x)): float(np.log(y)) for x, y in line.items()})[1]
