"""Does a curve depend on how it was computed? Each change of the numerics alone, against the base.

A study of convergence is a TOML file: materials, what all runs have, and ``[[change]]`` sections, each with
a name, what it sets (as ``Case.set`` takes it), and whether it is a refinement, which has to leave the
measures alone, or another choice, whose difference is just shown; ``materials`` keeps it to some of them.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.files import check_writable
from cutbench.base.progress import OnProgress, silent
from cutbench.base.toml import among, line_of, located, read_toml, refuse_other, written
from cutbench.case.case import Case, load_case
from cutbench.run.pool.batch import Batch
from cutbench.run.pool.worker import Run
from cutbench.run.store.runs import Store

#: What is compared: measure -> (heading, unit).
COMPARED = {
    "onset_mm": ("onset", "mm"),
    "peak_N": ("peak", "N"),
    "drop_rel": ("drop", "1"),
    "steady_N": ("steady force", "N"),
    "slope_N_per_mm": ("slope", "N/mm"),
}
#: A refinement may move a measure by this part of it.
TOLERANCE = 0.03
#: A drop and a slope may be zero; they are compared against no less than these: the slope, over a blade's
#: thickness, against this part of the steady force.
MIN_DROP, MIN_SLOPE = 0.1, 0.07

#: What the base is called, which has what its material and the study's [base] say.
BASE = "as given"

_TOP = ("title", "materials", "base", "change")
_KINDS = ("refinement", "choice")


@dataclass(frozen=True)
class NumericalChange:
    """``values`` as ``Case.set`` takes them; a ``refinement`` has to leave the measures alone."""

    name: str
    refinement: bool
    values: Mapping[str, object]
    #: Materials that it is computed for; empty: all of the study's.
    materials: tuple[str, ...] = ()


@dataclass(frozen=True)
class ConvergencePlan:
    """A study of convergence: all cases by material, the unchanged one under ``""``."""

    path: Path
    title: str
    changes: tuple[NumericalChange, ...]
    cases: Mapping[str, Mapping[str, Case]]


@dataclass(frozen=True)
class ConvergenceRow:
    """One run against its material's base: measures, their relative changes, the worst of these."""

    material: str
    change: str
    refinement: bool
    run: str
    outcome: str
    measures: Mapping[str, float]
    moved: Mapping[str, float] = field(default_factory=dict)
    seconds: float = math.nan
    closure: float = math.nan
    #: Whether the base was cut; if not there is nothing that a refinement could leave alone.
    cut: bool = True

    @property
    def worst(self) -> float:
        return max((abs(v) for v in self.moved.values() if math.isfinite(v)), default=math.nan)

    @property
    def holds(self) -> bool | None:
        """Whether a refinement leaves all measures within ``TOLERANCE``; None for a choice, and where the
        base was not cut."""
        asked = self.refinement and self.cut
        return self.outcome == "done" and bool(self.worst <= TOLERANCE) if asked else None


def load_plan(path: str | Path) -> ConvergencePlan:
    """Read a study of convergence from a TOML file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    ConvergencePlan
        Its changes, and all cases by material.

    Raises
    ------
    BadInput
        With file, line, key, value and what would be right.
    """
    path = Path(path)
    table, text = read_toml(path)
    refuse_other(table, path, "change")
    with located(path, text):
        for key in table:
            among(key, key, _TOP, value=str(table[key]))
        names = table.get("materials", [])
        if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
            raise BadInput(key="materials", value=str(names), expected='a list of names, such as ["gelatin"]')
        base = table.get("base", {})
        if not isinstance(base, dict):
            raise BadInput(key="base", value=str(base), expected="a section [base] with what all runs have")
        entries = table.get("change", [])
        if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) for e in entries):
            raise BadInput(key="change", value=str(entries)[:40], expected="at least one section [[change]]")
        changes = tuple(_change(entry, n, names) for n, entry in enumerate(entries, start=1))
        for name, count in Counter(c.name for c in changes).items():
            if count > 1:
                raise BadInput(key="name", value=name, expected="each name once")
        cases = {}
        for material in names:
            with located(path, text, "base"):
                start = load_case(material).set(**base)
            cases[material] = {"": start} | {
                c.name: _set(start, c, path, text) for c in changes if material in (c.materials or names)
            }
    return ConvergencePlan(path, str(table.get("title", path.stem)), changes, cases)


def _change(entry: dict, number: int, names: list[str]) -> NumericalChange:
    name, kind = entry.get("name"), entry.get("kind", "refinement")
    name = written(f"change {number}: name", name, "a name, such as 'h/2'", value=str(name))
    among("kind", kind, _KINDS)
    only = entry.get("materials", [])
    if not isinstance(only, list) or any(m not in names for m in only):
        raise BadInput(key=f"{name}: materials", value=str(only), expected=f"a list of some of {names}")
    values = {key: value for key, value in entry.items() if key not in ("name", "kind", "materials")}
    if not values:
        raise BadInput(key=f"change {number}: {name}", value="(empty)", expected="something that it sets")
    return NumericalChange(name, kind == "refinement", values, tuple(only))


def _set(start: Case, change: NumericalChange, path: Path, text: str) -> Case:
    try:
        return start.set(**{("with_" if k == "with" else k): v for k, v in change.values.items()})
    except BadInput as error:
        place, key = line_of(text, error.key), f"{change.name}: {error.key}"
        raise BadInput(key, error.value, error.expected, file=str(path), line=place) from error


def compute(
    plan: ConvergencePlan,
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    on_progress: OnProgress = silent,
    run: Run | None = None,
) -> list[ConvergenceRow]:
    """Run what is missing of ``plan`` and compare; runs are kept in ``out/runs``."""
    folder = check_writable(Path(out))
    runner = Batch(Store(folder / "runs"), workers=workers, on_progress=on_progress)
    runner.go((case for cases in plan.cases.values() for case in cases.values()), run)
    refinements = {c.name: c.refinement for c in plan.changes}
    rows = []
    for material, cases in plan.cases.items():
        base = runner.results[cases[""].id]
        cut = not math.isnan(base.measures.get("onset_mm", math.nan))
        for name, case in cases.items():
            result = runner.results[case.id]
            rows.append(
                ConvergenceRow(
                    material, name, refinements.get(name, False), case.id, result.outcome.kind,
                    {key: result.measures.get(key, math.nan) for key in COMPARED},
                    relative_changes(base.measures, result.measures, case.unit_mm) if name else {},
                    result.timings.get("total", math.nan), result.measures.get("closure", math.nan), cut,
                )
            )  # fmt: skip
    return rows


def relative_changes(
    base: Mapping[str, float], other: Mapping[str, float], thickness_mm: float
) -> dict[str, float]:
    """Relative changes by measure; nan where neither run has it, infinite where one alone has it."""
    least = {
        "drop_rel": MIN_DROP,
        "slope_N_per_mm": MIN_SLOPE * abs(base.get("steady_N", 0.0)) / thickness_mm,
    }

    def change(key: str) -> float:
        a, b = base.get(key, math.nan), other.get(key, math.nan)
        if math.isnan(a) or math.isnan(b):
            return math.nan if math.isnan(a) and math.isnan(b) else math.inf
        return (b - a) / max(abs(a), least.get(key, 0.0), 1e-300)

    return {key: change(key) for key in COMPARED}
