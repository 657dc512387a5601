"""The smaller sections of a study: [regime], [plot], [boundary], [sample], [uncertainty]; read strictly."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cutbench.base.errors import BadInput
from cutbench.base.toml import among
from cutbench.base.units import parse_quantity
from cutbench.case import materials
from cutbench.maps.axes import Axis, refuse_unknown
from cutbench.run.measures import label, measures
from cutbench.run.result import Result

#: A boundary is sought along so many continuous axes at the most.
MAX_SOUGHT = 3


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
        found = measures(
            result.curve, window_mm=p.thickness, height_mm=p.height, onset_length_mm=self.onset_length_mm,
            whole=result.whole,
        )  # fmt: skip
        regime = label(
            found["drop_rel"], found["surge"], drop=self.drop, surge_min=self.surge_min,
            bridged=result.measures.get("front_bridged", 0.0),
        )  # fmt: skip
        return regime, found


@dataclass(frozen=True)
class Search:
    """How a boundary is sought: ``start`` points an axis to begin with, then ``batch`` runs at a time,
    ``runs`` at the most; all for each combination of levels."""

    start: int
    batch: int
    runs: int


def read_search(part: dict, axes: tuple[Axis, ...]) -> Search:
    refuse_unknown(part, ("runs", "batch", "start"))
    sought = [axis for axis in axes if axis.continuous]
    if not 1 <= len(sought) <= MAX_SOUGHT:
        raise BadInput(
            key="axis", value=f"{len(sought)} with from and to",
            expected=f"1 to {MAX_SOUGHT} axes along which the boundary is sought; list values of others",
        )  # fmt: skip
    start = _whole(part, "start", 5, 3, min(len(axis.values) for axis in sought))
    batch = _whole(part, "batch", 8 if len(sought) < 3 else 16, 1, 1000)
    least = start ** len(sought)
    eighth = math.prod(math.ceil(1 / axis.tolerance - 1e-9) for axis in sought) // 8
    return Search(start, batch, _whole(part, "runs", max(eighth, least + 4 * batch), least, 100_000))


@dataclass(frozen=True)
class Doubtful:
    """How the uncertainty of a map is found: so many runs beside the line are repeated with refined numerics,
    and so many over what the model leaves open."""

    runs: int = 0
    bands: int = 0


def read_uncertainty(part: dict) -> Doubtful:
    refuse_unknown(part, ("runs", "bands"))
    return Doubtful(_whole(part, "runs", 10, 0, 1000), _whole(part, "bands", 3, 0, 1000))


def read_sample(part: dict) -> tuple[int, list[int]]:
    """How many points of a sequence, and the seeds of as many sequences."""
    refuse_unknown(part, ("points", "seed"))
    if "points" not in part:
        raise BadInput("sample", "(no points)", "[sample] with points = 100 or so")
    seeds = part.get("seed", 1)
    several = [{"seed": seed} for seed in (seeds if isinstance(seeds, list) else [seeds])]
    return _whole(part, "points", 0, 1, 100_000), [_whole(each, "seed", 1, 0, 2**32) for each in several]


def _whole(part: dict, key: str, default: int, low: int, high: int) -> int:
    value = part.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise BadInput(key, value, f"a whole number, {low} to {high}")
    return value


def read_regime(part: dict) -> Regime:
    refuse_unknown(part, ("drop", "surge", "onset_length", "rest"))
    drop = _between(part, "drop", 0.1, 0, 1)
    surge = _between(part, "surge", None, 0, math.inf) if "surge" in part else None
    length = (
        parse_quantity(part["onset_length"], "mm", key="onset_length") if "onset_length" in part else None
    )
    if length is not None and not 0 < length < math.inf:
        raise BadInput("onset_length", part["onset_length"], "a length above 0, such as '0.1 mm'")
    rest = part.get("rest", False)
    if not isinstance(rest, bool):
        raise BadInput("rest", rest, "true or false: whether each place has a run at rest, too")
    return Regime(drop, surge, length, rest)


def _between(part: dict, key: str, default: float | None, low: float, high: float) -> float:
    value = parse_quantity(part.get(key, default), "1", key=key)
    if not low < value < high:
        wanted = f"{low:g} < {key} < {high:g}" if math.isfinite(high) else f"{low:g} < {key}"
        raise BadInput(key, part.get(key), f"a number, {wanted}")
    return value


def read_plot(part: dict, axes: tuple[Axis, ...]) -> Plot:
    refuse_unknown(part, ("x", "y", "panel", "mark"))
    names = [axis.name for axis in axes]
    chosen: dict[str, str] = {}
    for key in ("x", "y", "panel"):
        if key in part:
            name = part[key]
            among(key, name, names)
            if name in chosen.values():
                raise BadInput(key, name, "an axis that the picture does not show already")
            chosen[key] = name
    free = [name for name in names if name not in chosen.values()]
    for key in ("x", "y", "panel"):
        if key not in chosen:
            chosen[key] = free.pop(0) if free else ""
    mark = part.get("mark", [])
    if not isinstance(mark, list) or not all(isinstance(m, str) for m in mark):
        wanted = f"a list of materials and case files, such as {[*materials.names(), 'my/gel.toml']}"
        raise BadInput("mark", str(mark), wanted)
    return Plot(**chosen, mark=tuple(mark))


def read_section(table: dict, name: str) -> dict:
    part = table.get(name, {})
    if not isinstance(part, dict):
        raise BadInput(name, str(part), f"a section, written [{name}]")
    return part
