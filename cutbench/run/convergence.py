"""Does a curve depend on how it was computed? Each change of the numerics alone, against the base.

A study of convergence is a TOML file: materials, what all runs have, and ``[[change]]`` sections, each with
a name, what it sets (as ``Case.set`` takes it), and whether it is a refinement, which has to leave the
measures alone, or another choice, whose difference is just shown; ``materials`` keeps it to some of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from cutbench.base.errors import require
from cutbench.base.figure_style import DOUBLE_MM, GREY, LINE_COLOURS, save, style
from cutbench.base.files import check_writable, markdown_table, write_json, write_text
from cutbench.base.progress import OnProgress, silent
from cutbench.base.sections import SOME, Entry, read_section
from cutbench.base.toml import read_toml
from cutbench.base.versions import versions
from cutbench.case.case import Case, load_case
from cutbench.run.figures.choices import MARKERS, plot_choices
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

_NAMES = 'a list of names, such as ["gelatin"]'
_FILE = (
    Entry("title", str, "a title in quotes"),
    Entry("materials", str, _NAMES, needed=True, count=SOME),
    Entry("base", dict, "a section [base] with what all runs have", default={}),
    Entry("change", dict, "at least one section [[change]]", needed=True, count=SOME),
)
_CHANGE = (
    Entry("name", str, "a name, such as 'h/2'", needed=True),
    Entry("kind", default="refinement", choices=("refinement", "choice")),
)


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
    """Read a study of convergence from a TOML file. Raises BadInput with file, line, key and value."""
    file = read_toml(path, "change")
    with file.at():
        top = read_section(file.table, _FILE)
    materials, changes = top["materials"], []
    for number, section in enumerate(top["change"]):
        with file.at("change", number, f"change {number + 1}: "):
            changes.append(_change(section, materials))
            name = changes[-1].name
            require(name not in [each.name for each in changes[:-1]], "name", name, "each name once")
    cases = {}
    for material in materials:
        with file.at("base"):
            start = load_case(material).set(**top["base"])
        cases[material] = {"": start}
        for number, change in enumerate(changes):
            if material in (change.materials or materials):
                with file.at("change", number, f"{change.name}: "):
                    cases[material][change.name] = start.set(**change.values)
    return ConvergencePlan(file.path, top["title"] or file.path.stem, tuple(changes), cases)


def _change(section: Mapping[str, Any], materials: Sequence[str]) -> NumericalChange:
    name, kind = (each.of(section) for each in _CHANGE)
    only = Entry("materials", default=(), choices=materials, count=(0, math.inf)).of(section)
    values = {key: raw for key, raw in section.items() if key not in ("name", "kind", "materials")}
    require(values, name, "(empty)", "something that it sets")
    return NumericalChange(name, kind == "refinement", values, only)


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


#: Beyond this, at the most, a mark sits at the edge as an arrow, %.
EDGE = 30.0


def plot_convergence(rows: Sequence[ConvergenceRow]) -> Figure:
    """Relative changes in per cent, refinements above other choices; the band is the tolerance."""
    tolerance = 100 * TOLERANCE
    materials = list(dict.fromkeys(row.material for row in rows))
    changed = [row for row in rows if row.change]
    largest = max(
        (100 * abs(v) for row in changed for v in row.moved.values() if not math.isnan(v)), default=0
    )
    edge = min(EDGE, max(2 * tolerance, 1.1 * largest))
    names = list(dict.fromkeys(r.change for r in sorted(changed, key=lambda r: not r.refinement)))
    with style():
        figure = Figure(figsize=(DOUBLE_MM / 25.4, (24 + 5.2 * len(names)) / 25.4), layout="constrained")
        axes = figure.subplots(1, len(materials), sharey=True, squeeze=False)[0]
        for ax, material in zip(axes, materials, strict=True):
            ax.axvspan(-tolerance, tolerance, color="0.88", lw=0, zorder=0)
            ax.axvline(0, color=GREY, lw=0.6)
            for k, ((key, (title, _)), marker) in enumerate(zip(COMPARED.items(), MARKERS, strict=True)):
                points = [
                    (100 * row.moved[key], names.index(row.change) + 0.13 * (k - 2))
                    for row in changed
                    if row.material == material and not math.isnan(row.moved[key])
                ]
                inside = [p for p in points if abs(p[0]) <= edge]
                ax.plot(
                    [p[0] for p in inside], [p[1] for p in inside], marker, color=LINE_COLOURS[k],
                    mfc="white" if k % 2 else LINE_COLOURS[k], ms=3.6, mew=0.9, ls="", label=title,
                )  # fmt: skip
                for side, marker_out in ((1, ">"), (-1, "<")):
                    beyond = [p[1] for p in points if side * p[0] > edge]
                    ax.plot(
                        [side * edge] * len(beyond), beyond, marker_out, color=LINE_COLOURS[k], ms=4, ls=""
                    )
            ax.set_title(material)
            ax.set_xlim(-1.08 * edge, 1.08 * edge)
            ax.set_xlabel("change of the measure (%)")
        axes[0].set_yticks(range(len(names)), names)
        axes[0].set_ylim(len(names) - 0.5, -0.5)
        refinements = len({row.change for row in changed if row.refinement})
        for ax in axes:
            if 0 < refinements < len(names):
                ax.axhline(refinements - 0.5, color="black", lw=0.6)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def choices(rows: Sequence[ConvergenceRow]) -> dict[str, dict[str, Mapping[str, float]]]:
    """Measures of the base and of what is no refinement, by material and change."""
    by_material: dict[str, dict[str, Mapping[str, float]]] = {}
    for row in (row for row in rows if not row.refinement):
        by_material.setdefault(row.material, {})[row.change or BASE] = row.measures
    return by_material


def markdown(rows: Sequence[ConvergenceRow]) -> str:
    """One table a material: the base's values, then each change in per cent."""
    lines = []
    heads = [title + (f", {unit}" if unit != "1" else "") for title, unit in COMPARED.values()]
    for material in dict.fromkeys(row.material for row in rows):
        table = []
        for row in (r for r in rows if r.material == material):
            left = f"{100 * row.closure:+.1f} %"
            if not row.change:
                cells = [f"{v:.3g}" if math.isfinite(v) else "none" for v in row.measures.values()]
                table.append([BASE, *cells, "", left])
                continue
            mark = "" if row.holds is None else " ✓" if row.holds else " ✗"
            end = "" if row.outcome == "done" else f" ({row.outcome})"
            worst = _percent(row.worst, sign="") + mark
            table.append([row.change + end, *map(_percent, row.moved.values()), worst, left])
        cut = all(row.cut for row in rows if row.material == material)
        uncut = [] if cut else ["Nothing was cut: no measure of a cut is compared.", ""]
        text = markdown_table(["", *heads, "worst", "energy left open"], table)
        lines += [f"**{material}**", "", *uncut, *text, ""]
    return "\n".join(lines)


def _percent(value: float, sign: str = "+") -> str:
    if math.isnan(value):
        return "–"
    return f"{100 * value:{sign}.1f} %" if math.isfinite(value) else "one alone has it"


def write(plan: ConvergencePlan, rows: Sequence[ConvergenceRow], out: str | os.PathLike[str]) -> list[Path]:
    """convergence.json, convergence.md, convergence.png in ``out``, and choices.png where there are any."""
    folder = check_writable(Path(out))
    rest = {"title": plan.title, "tolerance": TOLERANCE, "versions": versions()}
    described = [vars(r) | {"change": r.change or BASE, "holds": r.holds} for r in rows]
    chosen = any(r.change and not r.refinement for r in rows)
    return [
        write_json({"schema": 1, **rest, "rows": described}, folder / "convergence.json"),
        write_text(markdown(rows), folder / "convergence.md"),
        *save(plot_convergence(rows), folder / "convergence.png"),
        *(save(plot_choices(choices(rows)), folder / "choices.png") if chosen else []),
    ]
