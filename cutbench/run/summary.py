"""A run in a few lines, in the order in which a person asks."""

from __future__ import annotations

import numpy as np

from cutbench.run.result import Result

#: In the order in which a person asks, with format and unit.
MEASURES = {
    "onset": ("onset_mm", ".3g", "mm"),
    "peak": ("peak_N", ".4g", "N"),
    "force falls by": ("drop_rel", ".1%", ""),
    "steady force": ("steady_N", ".4g", "N"),
    "work": ("energy_mJ", ".4g", "mJ"),
    "energy left open": ("closure", ".2%", ""),
}


def summary_lines(result: Result) -> list:
    """Head, then pairs of words."""
    case, found = result.case, result.measures
    lines = [("found", result.sentence())]
    if not result.outcome.done:
        lines.append(("ended", str(result.outcome)))
    cut = np.isfinite(found.get("onset_mm", np.nan))
    for words, (name, form, unit) in MEASURES.items():
        # Without a cut there is no force of cutting.
        if (cut or name in ("energy_mJ", "closure")) and np.isfinite(value := found.get(name, np.nan)):
            lines.append((words, f"{value:{form}} {unit}".rstrip()))
    steps = f"{len(result.displacement_mm)} steps, {result.timings.get('total', 0):.3g} s"
    return [f"{case.name}, {case.dim}D, run {result.id}", *lines, ("cost", steps)]
