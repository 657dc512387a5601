"""What a study of convergence leaves: tables, and how far each change moves each measure as a picture."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from cutbench.base.figure_style import DOUBLE_MM, GREY, LINE_COLOURS, save, style
from cutbench.base.files import check_writable, replacing, write_json
from cutbench.base.versions import versions
from cutbench.verification.convergence import COMPARED, TOLERANCE, ConvergencePlan, ConvergenceRow

#: Beyond this, at the most, a mark sits at the edge as an arrow, %.
EDGE = 30.0
_TITLES = {
    "onset_mm": ("onset", "o"),
    "peak_N": ("peak", "s"),
    "drop_rel": ("drop", "^"),
    "steady_N": ("steady force", "D"),
    "slope_N_per_mm": ("slope", "v"),
}


def plot_convergence(rows: Sequence[ConvergenceRow], tolerance: float = 3.0) -> Figure:
    """Relative changes in per cent, refinements above other choices; the band is the tolerance."""
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
        colours = LINE_COLOURS
        for ax, material in zip(axes, materials, strict=True):
            ax.axvspan(-tolerance, tolerance, color="0.88", lw=0, zorder=0)
            ax.axvline(0, color=GREY, lw=0.6)
            for k, (key, (title, marker)) in enumerate(_TITLES.items()):
                points = [
                    (100 * row.moved[key], names.index(row.change) + 0.13 * (k - 2))
                    for row in changed
                    if row.material == material and not math.isnan(row.moved[key])
                ]
                inside = [p for p in points if abs(p[0]) <= edge]
                ax.plot(
                    [p[0] for p in inside], [p[1] for p in inside], marker, color=colours[k],
                    mfc="white" if k % 2 else colours[k], ms=3.6, mew=0.9, ls="", label=title,
                )  # fmt: skip
                for side, marker_out in ((1, ">"), (-1, "<")):
                    beyond = [p[1] for p in points if side * p[0] > edge]
                    ax.plot([side * edge] * len(beyond), beyond, marker_out, color=colours[k], ms=4, ls="")
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


def markdown(rows: Sequence[ConvergenceRow]) -> str:
    """One table a material: the base's values, then each change in per cent."""
    lines = []
    for material in dict.fromkeys(row.material for row in rows):
        heads = [f"{title}" + (f", {unit}" if unit != "1" else "") for title, unit in COMPARED.values()]
        lines += [f"**{material}**", "", "| | " + " | ".join(heads) + " | worst | energy left open |"]
        lines += ["|---" * (len(heads) + 3) + "|"]
        for row in (r for r in rows if r.material == material):
            if not row.change:
                cells = [f"{v:.3g}" if math.isfinite(v) else "none" for v in row.measures.values()]
                lines.append("| defaults | " + " | ".join(cells) + f" | | {100 * row.closure:+.1f} % |")
                continue
            cells = [_percent(v) for v in row.moved.values()]
            mark = "" if row.holds is None else " ✓" if row.holds else " ✗"
            end = "" if row.outcome == "done" else f" ({row.outcome})"
            lines.append(
                f"| {row.change}{end} | " + " | ".join(cells)
                + f" | {_percent(row.worst, sign='')}{mark} | {100 * row.closure:+.1f} % |"
            )  # fmt: skip
        lines.append("")
    return "\n".join(lines)


def _percent(value: float, sign: str = "+") -> str:
    if math.isnan(value):
        return "–"
    return f"{100 * value:{sign}.1f} %" if math.isfinite(value) else "one alone has it"


def write(plan: ConvergencePlan, rows: Sequence[ConvergenceRow], out: str | os.PathLike[str]) -> list[Path]:
    """convergence.json, convergence.md and convergence.png in ``out``."""
    folder = check_writable(Path(out))
    record = {
        "schema": 1,
        "title": plan.title,
        "tolerance": TOLERANCE,
        "rows": [
            {
                "material": r.material, "change": r.change or "defaults", "refinement": r.refinement,
                "run": r.id, "outcome": r.outcome, "measures": dict(r.measures), "moved": dict(r.moved),
                "holds": r.holds, "seconds": r.seconds, "closure": r.closure,
            }
            for r in rows
        ],
        "versions": versions(),
    }  # fmt: skip
    write_json(record, folder / "convergence.json")
    with replacing(folder / "convergence.md") as draft:
        draft.write_text(markdown(rows), encoding="utf-8")
    picture = save(plot_convergence(rows), folder / "convergence.png")[0]
    return [folder / "convergence.json", folder / "convergence.md", picture]
