"""Studies from a few fields: the TOML file that ``cutbench sweep`` takes, beside the case that it varies."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cutbench.app.case_choices import plain_name, with_unit
from cutbench.base.errors import BadInput
from cutbench.base.files import write_text
from cutbench.base.greek import plain_formula
from cutbench.case.case import Case
from cutbench.case.case_file_text import case_text
from cutbench.emulator.design_space import SIDES
from cutbench.maps.axes import BOUNDARY, GRID
from cutbench.maps.study import load_study

#: How a map comes about, and what the page says of it.
ESTIMATE = "estimate"
WAYS = {
    ESTIMATE: "estimate it at once",
    BOUNDARY: "seek the line between the regimes, with runs",
    GRID: "run every point of a grid",
}
#: An axis begins as far below and above the case's own value.
_REACH = 3.0


@dataclass(frozen=True)
class AxisChoice:
    """A quantity that a map can vary: its name in the file, a plain ``title``, its unit, and from where to
    where it goes to begin with."""

    name: str
    title: str
    unit: str
    low: float
    high: float


def axis_choices(case: Case) -> dict[str, AxisChoice]:
    """All that a map of this case can vary on a logarithmic axis, groups first, by name."""
    found = {}
    held = {side.name: (side.low, side.high) for side in SIDES}
    for name, group in case.model.settable_groups().items():
        title, value = f"{group.title or name} {plain_formula(group.text)}", group.value(case.p)
        # As far as the atlas goes, which can be asked at once.
        low, high = held.get(name, (0.0, math.inf))
        ends = max(value / _REACH, low), min(value * _REACH, high)
        found[name] = AxisChoice(name, title, group.unit, *ends)
    for name, q in case.model.parameters().items():
        value = case.values[name] / q.factor
        title = f"{plain_name(q)} {q.symbol}"
        found[name] = AxisChoice(name, title, q.unit, value / _REACH, value * _REACH)
    return {name: axis for name, axis in found.items() if 0 < axis.low < axis.high}


def write_study(
    case: Case, axes: Sequence[tuple[AxisChoice, str, str]], way: str, count: int, folder: Path
) -> Path:
    """``study.toml`` and ``case.toml`` in ``folder``, read and found good.

    ``axes`` are one or two quantities with the texts of their ends, ``count`` the points along an axis of a
    grid, or the most runs of a search. Raises BadInput, and leaves nothing.
    """
    if way not in WAYS:
        raise BadInput("way", way, f"one of {', '.join(WAYS)}")
    sought = way != GRID and len(axes) > 1
    title = f"{case.name}: {', '.join(axis.name.replace('_', ' ') for axis, *_ in axes)}"
    lines = [
        f"title = {json.dumps(title, ensure_ascii=False)}",
        f'mode = "{BOUNDARY if sought else GRID}"',
        'base = "case.toml"',
        "",
        "[protocol]",
        'until = "transition"',
    ]
    for axis, low, high in axes:
        lines += ["", "[[axis]]", f'name = "{axis.name}"', 'scale = "log"']
        for key, end in (("from", low), ("to", high)):
            lines.append(f"{key} = {json.dumps(with_unit(end, axis.unit), ensure_ascii=False)}")
        if not sought:
            lines.append(f"points = {count}")
    if sought and way == BOUNDARY:
        lines += ["", "[boundary]", "start = 3", f"runs = {count}"]
    lines += ["", "[plot]", 'mark = ["case.toml"]']
    return keep_study(folder, "\n".join(lines), case_text(case))


def keep_study(folder: Path, study: str, case: str | None = None) -> Path:
    """``study.toml`` in ``folder``, with the ``case.toml`` that it varies. Raises BadInput."""
    folder.mkdir(parents=True)
    target = write_text(study, folder / "study.toml")
    if case is not None:
        write_text(case, folder / "case.toml")
    try:
        load_study(target)
    except BadInput:
        shutil.rmtree(folder)
        raise
    return target
