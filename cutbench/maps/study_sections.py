"""The smaller sections of a study: [regime], [plot], [boundary], [sample], [uncertainty]; read strictly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cutbench.base.errors import require
from cutbench.base.sections import Entry, read_section
from cutbench.base.toml import among
from cutbench.case import materials
from cutbench.maps.axes import Axis
from cutbench.run.measures import label, measures
from cutbench.run.result import Result

#: A boundary is sought along so many continuous axes at the most.
MAX_SOUGHT = 3
REGIME = (
    Entry("drop", float, default=0.1, low=0, high=1),
    Entry("surge", float, low=0),
    Entry("onset_length", float, unit="mm", low=0),
    Entry("rest", bool, "true or false: whether each place has a run at rest, too", default=False),
)
UNCERTAINTY = (
    Entry("runs", int, default=10, low=0, high=1000),
    Entry("bands", int, default=3, low=0, high=1000),
)
SAMPLES = (
    Entry("points", int, "[sample] with points = 100 or so", needed=True, low=1, high=100_000),
    Entry("seed", int, default=(1,), low=0, high=2**32, count=(0, math.inf), single=True),
)
_SHOWN = ("x", "y", "panel")
PLOT = (
    *(Entry(key, object) for key in _SHOWN),
    Entry(
        "mark", str, f"a list of materials and case files, such as {[*materials.names(), 'my/gel.toml']}",
        default=(), count=(0, math.inf),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Plot:
    """Which axes a phase diagram shows (empty: none), and which materials it marks."""

    x: str
    y: str = ""
    panel: str = ""
    mark: tuple[str, ...] = ()


@dataclass(frozen=True)
class Regime:
    """What tells smooth from abrupt, as ``cutbench.run.measures`` has it."""

    drop: float
    surge_min: float | None
    #: None: ``cutbench.run.measures.ONSET`` thicknesses of the blade.
    onset_length_mm: float | None
    #: Whether each place has a run at rest, too, for ``cutbench.maps.regimes``.
    rest: bool = False

    def of(self, result: Result) -> tuple[str, dict[str, float]]:
        """The regime of a run and its measures, from its curve."""
        p = result.case.p
        read_off = measures(
            result.curve, window_mm=p.thickness, height_mm=p.height, onset_length_mm=self.onset_length_mm,
            whole=result.whole,
        )  # fmt: skip
        regime = label(
            read_off["drop_rel"], read_off["surge"], drop=self.drop, surge_min=self.surge_min,
            bridged=result.measures.get("front_bridged", 0.0),
        )  # fmt: skip
        return regime, read_off


@dataclass(frozen=True)
class Search:
    """How a boundary is sought: ``start`` points an axis to begin with, then ``batch`` runs at a time,
    ``runs`` at the most; all for each combination of levels."""

    start: int
    batch: int
    runs: int


def read_search(part: Mapping[str, object], axes: tuple[Axis, ...]) -> Search:
    """The section [boundary]; what it may ask for depends on the axes. Raises BadInput."""
    sought = [axis for axis in axes if axis.continuous]
    wanted = f"1 to {MAX_SOUGHT} axes along which the boundary is sought; list values of others"
    require(1 <= len(sought) <= MAX_SOUGHT, "axis", f"{len(sought)} with from and to", wanted)
    most = min(len(axis.values) for axis in sought)
    begin = Entry("start", int, default=5, low=3, high=most)
    batch = Entry("batch", int, default=8 if len(sought) < 3 else 16, low=1, high=1000)
    least = begin.of(part) ** len(sought)
    eighth = math.prod(math.ceil(1 / axis.tolerance - 1e-9) for axis in sought) // 8
    usual = max(eighth, least + 4 * batch.of(part))
    runs = Entry("runs", int, default=usual, low=least, high=100_000)
    return Search(**read_section(part, (begin, batch, runs)))


@dataclass(frozen=True)
class Doubtful:
    """How the uncertainty of a map is found: so many runs beside the line are repeated with refined numerics,
    and so many over what the model leaves open."""

    runs: int = 0
    bands: int = 0


def read_plot(part: Mapping[str, Any], axes: tuple[Axis, ...]) -> Plot:
    """What a section [plot], read by ``PLOT``, says of these axes; those that it leaves out fill up. Raises
    BadInput."""
    free = [axis.name for axis in axes]
    for key in _SHOWN:
        if part[key] is not None:
            among(key, part[key], [axis.name for axis in axes])
            require(part[key] in free, key, part[key], "an axis that the picture does not show already")
            free.remove(part[key])
    x, y, panel = (part[key] or (free.pop(0) if free else "") for key in _SHOWN)
    return Plot(x, y, panel, part["mark"])
