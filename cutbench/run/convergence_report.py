"""What a study of convergence leaves: tables, and how far each change moves each measure as a picture."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from cutbench.base.figure_style import DOUBLE_MM, GREY, LINE_COLOURS, save, style
from cutbench.base.files import check_writable, markdown_table, write_json, write_text
from cutbench.base.versions import versions
from cutbench.run.convergence import BASE, COMPARED, TOLERANCE, ConvergencePlan, ConvergenceRow
from cutbench.run.figures.choices import MARKERS, plot_choices

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
    found: dict[str, dict[str, Mapping[str, float]]] = {}
    for row in (row for row in rows if not row.refinement):
        found.setdefault(row.material, {})[row.change or BASE] = row.measures
    return found


def markdown(rows: Sequence[ConvergenceRow]) -> str:
    """One table a material: the base's values, then each change in per cent."""
    lines = []
    heads = [title + (f", {unit}" if unit != "1" else "") for title, unit in COMPARED.values()]
    for material in dict.fromkeys(row.material for row in rows):
        made = []
        for row in (r for r in rows if r.material == material):
            left = f"{100 * row.closure:+.1f} %"
            if not row.change:
                cells = [f"{v:.3g}" if math.isfinite(v) else "none" for v in row.measures.values()]
                made.append([BASE, *cells, "", left])
                continue
            mark = "" if row.holds is None else " ✓" if row.holds else " ✗"
            end = "" if row.outcome == "done" else f" ({row.outcome})"
            worst = _percent(row.worst, sign="") + mark
            made.append([row.change + end, *map(_percent, row.moved.values()), worst, left])
        table = markdown_table(["", *heads, "worst", "energy left open"], made)
        cut = all(row.cut for row in rows if row.material == material)
        uncut = [] if cut else ["Nothing was cut: no measure of a cut is compared.", ""]
        lines += [f"**{material}**", "", *uncut, *table, ""]
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
